"""A plan as point fields of OpenFOAM: what its motion solver adds up is the plan's mesh."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect import InputError, plan
from sdm_deflect.deform.surface.motions import Powers
from tests.deform.blocks import two_bodies
from tests.deform.test_mesh_motion import AROUND_BOTH, SLAT_AND_FLAP

TRACK = "controlParameter,angle,dx,dy,dz\n-1,-4,-0.02,0,0\n0,0,0,0,0\n0.5,3,0.03,0,0\n1,4,0.05,0,0.02\n"
ROUNDING = 1e-14


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """A body that turns, and one on a track with kinks."""
    table = tmp_path_factory.mktemp("track") / "track.csv"
    table.write_text(TRACK)
    right = {"hinge": SLAT_AND_FLAP["right"]["hinge"], "track": str(table), "range": (-0.8, 1)}
    return plan(two_bodies(), {"left": SLAT_AND_FLAP["left"], "right": right}, box=AROUND_BOTH)


def numbers(text):
    """A list of OpenFOAM, of numbers or of lists."""
    rows = re.findall(r"\(([^()]+)\)", text)
    return np.array([row.split() for row in rows], dtype=np.float64)


def entries(case):
    """The entries of each surface."""
    text = re.sub(r"//[^\n]*", "", (case / "constant" / "sdmMotion").read_text().partition("}")[2])
    found = re.findall(r"(\S+)\s*\{([^{}]*)\}", text)
    return {name: dict(re.findall(r"(\w+) ([^;]+);", content)) for name, content in found}


def field(path):
    """The values (N, 3) of a field."""
    data = path.read_bytes()
    assert b"class pointVectorField" in data
    found = re.compile(rb"List<vector> (\d+)\n\(").search(data)
    return np.frombuffer(data, "<f8", 3 * int(found[1]), found.end()).reshape(-1, 3)


def values(surface, amount, count):
    """The functions of an amount, as the solver has them."""
    if surface["functions"] == "turn":
        angles = np.radians(amount) * (np.arange(count) // 2 + 1)
        return np.where(np.arange(count) % 2, 2 * np.sin(angles / 2) ** 2, np.sin(angles))
    if surface["functions"] == "powers":
        return (amount / float(surface["scale"])) ** (np.arange(count) + 1)
    at, value, rate = (numbers(surface[name]) for name in ("amounts", "values", "rates"))
    i = np.clip(np.searchsorted(at[0], amount, "right") - 1, 0, at.shape[1] - 2)
    h = at[0, i + 1] - at[0, i]
    t, s = (amount - at[0, i]) / h, (at[0, i + 1] - amount) / h
    left = s * s * ((1 + 2 * t) * value[i] + t * h * rate[i])
    return left + t * t * ((1 + 2 * s) * value[i + 1] - s * h * rate[i + 1])


def moved(case, amounts):
    """What the solver adds up."""
    out = field(case / "0" / "X0").copy()
    for (_, surface), amount in zip(entries(case).items(), amounts, strict=True):
        names = surface["fields"].strip("()").split()
        for value, name in zip(values(surface, amount, len(names)), names, strict=True):
            out += value * field(case / "0" / name)
    return out


def test_the_sum_of_fields_is_the_mesh(held, tmp_path):
    (tmp_path / "constant").mkdir()
    held.save_openfoam(tmp_path)
    assert [surface["functions"] for surface in entries(tmp_path).values()] == ["turn", "table"]
    for amounts in ((0.0, 0.0), (6.0, -0.8), (-3.3, 0.49999), (8.0, 0.50001), (0.0, 0.9), (1.0, -0.123)):
        assert np.abs(moved(tmp_path, amounts) - held.at(amounts)).max() <= ROUNDING, amounts


def test_powers_and_amounts_of_a_user(held, tmp_path):
    controls = tuple(replace(one, functions=Powers(2, 2.0)) for one in held.controls[:1])
    one = replace(held, controls=controls, rows=held.rows[:1], fields=held.fields[:1])
    (tmp_path / "constant").mkdir()
    (tmp_path / "constant" / "dynamicMeshDict").write_text("my own\n")
    assert [path.name for path in one.save_openfoam(tmp_path)] == ["X0", "left.1", "left.2", "sdmMotion"]
    assert (tmp_path / "constant" / "dynamicMeshDict").read_text() == "my own\n"
    assert np.abs(moved(tmp_path, (5.0,)) - one.at((5.0,))).max() <= ROUNDING


def test_what_cannot_be_written_is_refused_and_leaves_nothing(held, tmp_path):
    with pytest.raises(InputError, match="is no case of OpenFOAM: it has no folder constant"):
        held.save_openfoam(tmp_path)
    (tmp_path / "constant").mkdir()
    twice = tuple(replace(one, name="a#b") for one in held.controls)
    with pytest.raises(InputError, match="two surfaces are called a_b in OpenFOAM"):
        replace(held, controls=twice).save_openfoam(tmp_path)
    single = plan(two_bodies(), "left", SLAT_AND_FLAP["left"]["hinge"], 4.0, fixed="right", box=AROUND_BOTH)
    with pytest.raises(InputError, match="the plan is of 4 alone; make one with a range"):
        single.save_openfoam(tmp_path, held.plan.mesh.points)
    with pytest.raises(InputError, match="the plan is of 4 alone; make one with a range"):
        single.save_openfoam(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["constant"]
