"""The points of every kind of deflection stay what they were on fixed meshes.

They were kept by the first version that chooses equal centres on every processor (`sdm_deflect.base.ties`). The version
before chose others among equally good ones: its points were within 1.5 tolerances of these. Those of `wing_blended`
and `wing_sliding` are younger: layers are rigid farther from their wall, which moved nodes by up to 2e-4. Each
``.npz`` holds the rows of the nodes that moved and where they were; `mesh_*.npz` the meshes of the cases.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.api import deflect
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from sdm_deflect.meshing.mesh.labelled import Skin, tetrahedral
from tests.meshing.formats.wing import wing

SAME = 1e-10  # m
FOLDER = Path(__file__).parent


def frozen(name):
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as arrays:
        return dict(arrays)


def expected(before, kept, rows="rows", values="points"):
    out = np.array(before)
    out[kept[rows]] = kept[values]
    return out


def frozen_tets(name):
    kept = frozen(f"mesh_{name}")
    tets, triangles, patch, face = (kept[key].astype(np.intp) for key in ("tets", "triangles", "patch", "face"))
    names = tuple(map(str, kept["names"]))[1:]
    return tetrahedral(kept["points"], tets, Skin(triangles, patch - 1, face), names, name)


def frozen_mesh(name):
    return frozen_tets(name)


@pytest.fixture(scope="module")
def meshes():
    return {name: frozen_mesh(name) for name in ("aircraft", "block")}


@pytest.mark.parametrize(
    ("name", "angle", "strategy"),
    [
        ("aileron", -12.0, "squv"),
        ("aileron", -12.0, "mv"),
        ("aileron", -30.0, "squv"),
        ("aileron", -30.0, "mv"),
        ("aileron-chimera", -12.0, None),
        ("aileron-chimera", -30.0, None),
        ("tail", 12.0, None),
        ("rudder", 15.0, None),
        ("all", 12.0, None),
    ],
)
def test_cases(meshes, name, angle, strategy):
    case = case_named(name)
    adaptation = replace(case.adaptation, strategy=strategy or case.adaptation.strategy)
    fuselage = replace(case.fighter.fuselage, panel_front=0.770, panel_rear=0.932, panel_angle=55.0)
    fighter = replace(case.fighter, fuselage=fuselage)
    case = replace(case, angle=angle, adaptation=adaptation, repair="off", fighter=fighter)
    mesh = meshes["block" if case.domain == "block" else "aircraft"]
    kept = frozen(f"{name}{angle:+g}" + (f"_{strategy}" if strategy else ""))
    plan = plan_of(case, mesh)
    found = carried_out(plan)
    results, points = found.boxes, found.points
    assert np.abs(points - expected(mesh.points, kept)).max() < SAME
    centers = [[len(fit.chosen) for fit in one.steps[0].fits.adaptations] for one in results]
    assert centers == kept["centers"].tolist()
    assert [len(one.steps) for one in results] == kept["steps"].tolist()


def hybrid(name):
    """The hybrid wing, or the one whose flap ends at the symmetry plane, and what moves it in a given box."""
    middle, inboard = wing(cells=4), wing(flap=(0.0, 0.5), cells=4)
    whole, flap, fixed, slide = ("wing_*", "flap_*"), ("flap_*",), ("wing_*",), {"symmetry": "plane"}

    def blended(one):
        return Blended(Rotation.about(*one.hinge), held=OnPatches(fixed))

    one, surfaces, hinge, angle, box, options = {
        "wing_rigid": (middle, whole, middle.hinge, 10.0, (-0.5, -0.5, -0.8, 1.5, 1.5, 0.8), {"slide": slide}),
        "wing_blended": (
            middle, flap, middle.hinge, 10.0, (0.4, 0.03, -0.35, 1.3, 1.0, 0.35),
            {"motion": blended(middle), "fixed": fixed},
        ),
        "wing_sliding": (
            inboard, flap, inboard.hinge, 10.0, (0.41, -0.5, -0.33, 1.32, 1.03, 0.37),
            {"motion": blended(inboard), "fixed": fixed, "slide": slide},
        ),
        "wing_table": (
            middle, whole, None, 1.0, (-0.5, -0.5, -0.55, 1.5, 1.5, 0.6),
            {"motion": Table(**frozen("wing_table_input")), "slide": slide},
        ),
    }[name]  # fmt: skip
    return deflect(one.mesh, surfaces, hinge, angle, repair="off", box=np.reshape(box, (2, 3)), **options)


@pytest.mark.filterwarnings("ignore:hinge")
@pytest.mark.parametrize("name", ["wing_rigid", "wing_blended", "wing_sliding", "wing_table"])
def test_hybrid_wing_and_its_sensitivity(name):
    kept, result = frozen(name), hybrid(name)
    before = result.deflection.plan.mesh.points
    assert np.abs(result.points - expected(before, kept)).max() < SAME
    assert np.abs(result.sensitivity - expected(np.zeros_like(before), kept, "srows", "rates")).max() < SAME
    assert len(result.deflection.boxes[0].steps) == kept["steps"]
