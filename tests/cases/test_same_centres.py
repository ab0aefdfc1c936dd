"""The same centres wherever rounding differs: on meshes whose coordinates differ by one unit in the last place.

Zero sites form a regular lattice. Without `sdm_deflect.base.ties` the last bit decides which of them is first.
"""

import tomllib
from dataclasses import replace

import pytest

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import CASES, case_named
from sdm_deflect.cases.api import deflect, read
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from tests import calls
from tests.ties import SEEDS, chosen, rounded_otherwise

AILERON = {
    "surfaces": "aileron_left", "fixed": "wing_left", "motion": "blended",
    "hinge": [[0.69181, -0.3048, 0.0], [0.6767, -0.11627, 0.0]],
}  # fmt: skip
WING = {"surfaces": "flap", "fixed": "wing", "hinge": [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], "motion": "blended"}


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """The folder with the meshes of `sdm example`."""
    folder = tmp_path_factory.mktemp("examples")
    assert calls.sdm("example", folder) == calls.sdm("example", folder, "--fighter") == 0
    return folder


def fighter(examples, **more):
    settings = tomllib.loads((examples / "fighter.toml").read_text())
    return {"surfaces": settings["surface"], "fixed": settings["fixed"], **more}


@pytest.mark.parametrize("boxes", ["each", "one"])
def test_five_surfaces_of_the_fighter(examples, boxes):
    mesh, settings = read(examples / "fighter.su2"), fighter(examples, box_each=boxes == "each", repair="off")
    if boxes == "one":
        settings["surfaces"] = [{k: v for k, v in one.items() if k != "box"} for one in settings["surfaces"]]
        settings["force"] = True
    first = chosen(deflect(mesh, **settings).deflection)
    for seed in SEEDS:
        assert chosen(deflect(rounded_otherwise(mesh, seed), **settings).deflection) == first, seed


@pytest.mark.parametrize(
    ("name", "settings", "angle"),
    [
        ("fighter", AILERON, 12.0),
        ("fighter", AILERON, 75.0),
        ("fighter", {**AILERON, "strategy": "mv"}, 75.0),
        ("naca", WING, 15.0),
        ("naca", {**WING, "rule": "worst"}, 15.0),
        ("naca", WING, -30.0),
    ],
    ids=["aileron", "aileron 75", "aileron 75 MV", "wing", "wing, worst", "wing -30"],
)
def test_one_surface(examples, name, settings, angle):
    mesh, settings = read(examples / f"{name}.su2"), {**settings, "angle": angle, "repair": "off", "force": True}
    first = chosen(deflect(mesh, **settings).deflection)
    for seed in SEEDS:
        assert chosen(deflect(rounded_otherwise(mesh, seed), **settings).deflection) == first, seed


@pytest.mark.parametrize("name", CASES)
def test_the_paper_s_cases(make_mesh, name):
    case = replace(case_named(name), repair="off")
    mesh, _ = make_mesh(case)
    first = chosen(carried_out(plan_of(case, mesh)))
    for seed in SEEDS:
        assert chosen(carried_out(plan_of(case, rounded_otherwise(mesh, seed)))) == first, seed
