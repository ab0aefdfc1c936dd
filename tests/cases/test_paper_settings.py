"""What the paper's cases ask of the engine, any job may ask: the same Chimera deflection from plain settings."""

from dataclasses import replace

import numpy as np

from sdm_deflect.cases.aircraft.job import block_stations, hexahedron_of, job_of, open_faces, plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.api import deflect
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from tests.frozen.test_frozen import SAME, frozen_mesh


def test_a_chimera_block_is_deflected_by_settings_alone():
    case = replace(case_named("aileron-chimera"), angle=-12.0)
    mesh = frozen_mesh("block")
    plan = plan_of(case, mesh)
    expected = carried_out(plan)
    moving = job_of(case, mesh, case.deflections[0]).surfaces[0]
    fitting = expected.plan.job.fitting
    result = deflect(
        mesh,
        "aileron_left",
        None,
        -12.0,
        motion=moving.motion,
        fixed=[name for name in mesh.names if name not in ("aileron_left", "chimera")],
        box=hexahedron_of(case, "aileron_left").corners.tolist(),
        open_faces=sorted(open_faces(case, "aileron_left")),
        section=[
            {"patch": "chimera", "point": [0.0, float(y), 0.0], "axis": "y"}
            for y in block_stations(case, "aileron_left")
        ],
        near_wall=False,
        **{name: getattr(fitting, name) for name in fitting.__slots__},
    )
    assert result.passed
    assert np.abs(result.points - expected.points).max() < SAME
    face = np.flatnonzero(result.points[:, 1] != mesh.points[:, 1])
    assert not np.isin(mesh.on("chimera"), face).any()
