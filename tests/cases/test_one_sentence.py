"""Inputs that ended in a traceback, a warning of a library, or without a word, end in one sentence."""

from contextlib import nullcontext, suppress

import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect import InputError
from sdm_deflect.cases.run.metrics import travels
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body, joined, two_bodies
from tests.deform.test_mesh_motion import SLAT_AND_FLAP

TURN = {"hinge": [[0, -0.6, 0], [0, 0.6, 0]], "angle": 5.0}


def wedge(degrees):
    """One layer of hexahedra around the x axis, radii .5 to 1.5, with a flap in the inner wall."""
    x, r, half = np.linspace(0, 2, 13), np.linspace(0.5, 1.5, 7), np.radians(degrees) / 2
    at = np.arange(x.size * r.size).reshape(x.size, r.size)
    long, far = np.meshgrid(x, r, indexing="ij")
    sides = [np.stack([long, far * np.cos(half), way * far * np.sin(half)], -1).reshape(-1, 3) for way in (-1, 1)]
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], -1).reshape(-1, 4)
    wall = np.stack([at[:-1, 0], at[1:, 0], at[1:, 0] + at.size, at[:-1, 0] + at.size], -1)
    outer = np.stack([at[:-1, -1], at[:-1, -1] + at.size, at[1:, -1] + at.size, at[1:, -1]], -1)
    ends = [np.stack([at[i, :-1], at[i, 1:], at[i, 1:] + at.size, at[i, :-1] + at.size], -1) for i in (0, -1)]
    parts = {
        "front": quads[:, ::-1], "back": quads + at.size, "flap": wall[5:7], "body": np.delete(wall, [5, 6], 0),
        "rest": np.vstack([outer, *ends]),
    }  # fmt: skip
    patches = tuple(Patch(name, (Cells("quad", nodes),)) for name, nodes in parts.items())
    return Mesh(np.vstack(sides), (Cells("hexahedron", np.hstack([quads, quads + at.size])),), patches)


@pytest.mark.parametrize("degrees", [170.0, 179.9])
@pytest.mark.parametrize("sides", [{"periodic": [["front", "back"]]}, {"slide": {"front": "plane", "back": "plane"}}])
def test_a_wedge_of_half_a_turn_ends_in_a_result_or_a_sentence(degrees, sides):
    mesh = wedge(degrees)
    points = mesh.points[mesh.on("flap")]
    vectors = 0.02 * points * [0, 1, 1]
    if "periodic" in sides:
        sides = {"periodic": [{"patches": ["front", "back"]}]}
    with suppress(InputError):  # one sentence
        given = {"table": (points, vectors), "fixed": ["body", "rest"], "margin": 0.4, **sides}
        found = sd.deflect(mesh, "flap", None, 1.0, **given)
        assert np.isfinite(found.points).all()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"motion": "root", "on": "x-"}, "body shares no node with x-, on which it turns"),
        ({"section": [{"patch": "x-", "point": [-1.9, 0, 0], "axis": "x"}], "margin": 0.4}, "section of x-: its plane"),
        ({"box": [[-1e308] * 3, [1e308] * 3]}, "^the box: corners: a coordinate is not finite, or beyond 1e"),
        ({"box": [[np.nan] * 3, [1.0] * 3]}, r"box\[0\]\[0\] = nan is not a finite number"),
    ],
)
def test_settings_that_ended_in_a_traceback(given, said):
    with pytest.raises(InputError, match=said):
        sd.deflect(block_with_body(8), "body", **TURN, **given)


def test_a_tail_that_stands_on_nothing():
    """A flat plate: the skins around its root look all ways."""
    mesh = block_with_body(16)
    body = mesh.patch("body").faces[0].nodes
    half = mesh.points[body].mean(axis=1)[:, 0] > 0.0
    cut = (Patch("tail", (Cells("quad", body[half]),)), Patch("stub", (Cells("quad", body[~half]),)))
    mesh = Mesh(mesh.points, mesh.cells, (*cut, *mesh.patches[1:]))
    with pytest.raises(InputError) as caught:
        sd.deflect(mesh, "tail", [[0, 0, 0], [1, 0, 0]], 5.0, motion="root", on="stub", force=True)
    assert "\n" not in str(caught.value)


def test_a_range_alone_says_how_far_the_surface_moves():
    plan = sd.plan(two_bodies(), {"left": SLAT_AND_FLAP["left"]}, fixed="right", margin=0.3).plan
    (text,) = (text for _, text in travels(plan, plan.largest))
    assert not text.startswith("0,")
    assert plan.largest == (8,)


@pytest.mark.parametrize(("slip", "warns"), [(0.0, False), (1e-12, False), (0.01, True), (0.05, True)])
def test_another_shape_is_no_reflection(slip, warns):
    """A flap .05 away from the reflection had the note of one that differs by rounding."""
    one = block_with_body(8)
    port = Mesh(one.points * 0.5 + [-0.5, 1.25, 0.0], one.cells, one.patches)
    points = port.points * [1, -1, 1]
    nodes = port.on("body")
    points[nodes] += [slip, 0.0, 0.0]
    cells = Cells("hexahedron", one.cells[0].nodes[:, [3, 2, 1, 0, 7, 6, 5, 4]])
    mesh = joined(port, Mesh(points, (cells,), one.patches))
    given = {"hinge": [[-0.5, 1.0, 0], [-0.5, 1.5, 0]], "mirror": "body'", "margin": 0.3}
    said = f"body': its nodes are up to {slip:g} from the reflection of body: is it"
    with pytest.warns(UserWarning, match=said) if warns else nullcontext():
        found = sd.deflect(mesh, "body", angle=5.0, **given)
    alone = [note for note in found.notes if "fitted by itself" in note]
    assert bool(alone) == (slip == 1e-12)
