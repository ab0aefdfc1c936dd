"""The geometric part of a hinge moment's derivative in a flow study: ``python -m studies.flow.frozen_hinge FOLDER A``.

FOLDER is that of ``python -m studies flow``, whose mesh is still in the cache; A is one of its angles. The pressures
that the solver has left on the deflected mesh are kept while the surface turns on: once by `hinge_moment_rate` and the
deflection's sensitivity, once by the difference of two deflected meshes.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import resolve
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.volume.deflection import deflect
from studies.flow.frozen import hinge_moment, hinge_moment_rate
from studies.flow.members import DEFLECTED, Member, study_of, undeflected_mesh
from studies.flow.pictures import Skin
from studies.flow.reference import surface_reference
from studies.flow.solve import FOLDER, SETTINGS

STEP = 0.01
"""Degrees to either side."""


def rates(folder: Path, angle: float) -> tuple[float, float]:
    """Return dCh per degree at frozen pressures: by the sensitivity, and by a difference."""
    kept = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
    case = replace(resolve(kept["case"], kept["scale"], assignments=kept["set"]), repair="off")
    study = study_of(case, (angle,))
    skin = Skin.of(study, folder / FOLDER / Member(DEFLECTED, angle).name)
    flow = undeflected_mesh(study, Stopwatch())
    plan = plan_of(study.at(angle), flow)
    here = deflect(plan)
    np.testing.assert_array_equal(here.points, skin.points)  # the mesh whose flow was computed
    own = skin.own == 1
    pressure, triangles = study.stream.dynamic_pressure * skin.pressure[own], skin.triangles[own]
    hinge = next(one for one in study.setup(True).hinges if one.name == study.surface)
    moments = []
    for step in (STEP, -STEP):
        one = deflect(plan, tuple(own + step * own / angle for own in plan.pose), earlier=here)
        moments.append(hinge_moment(one.points, triangles, pressure, hinge))
    reference = surface_reference(case.fighter, study.surface)
    scale = study.stream.dynamic_pressure * reference.area * reference.chord
    own = zip(here.sensitivity().values(), plan.pose, strict=True)
    speeds = np.sum([rate * amount / angle for rate, amount in own], axis=0)
    rate = hinge_moment_rate(here.points, speeds, triangles, pressure, hinge)
    return rate / scale, (moments[0] - moments[1]) / (2.0 * STEP) / scale


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("angle", type=float)
    given = parser.parse_args()
    exact, difference = rates(given.folder, given.angle)
    print(f"dCh per degree at frozen pressures: {exact:+.6g} by the sensitivity, {difference:+.6g} by a difference")


if __name__ == "__main__":
    main()
