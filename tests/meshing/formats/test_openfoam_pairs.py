"""Patches of OpenFOAM that bind nodes to one another: cyclic ones, AMI, empty and wedge sides, planes of symmetry."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.openfoam_case import pairs_of
from sdm_deflect.meshing.formats.openfoam_files import MESH, FoamPatch
from sdm_deflect.meshing.formats.openfoam_pieces import in_pieces
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from tests.deform import paired

SMALL = {"around": 16, "outwards": 4}
LEFT = {"left": "cyclic", "right": "cyclic"}
AXIS = "rotationAxis (1 0 0); rotationCentre (0 0 0);"


def cyclic(case, kind="cyclic", more=""):
    sides = ("side0", "side1")
    return paired.written(paired.airfoil(2, 0.25, **SMALL), case, dict.fromkeys(sides, kind), [sides], more)


def sector(case, more="", kind="cyclic"):
    return paired.written(paired.sector(), case, dict.fromkeys(LEFT, kind), [("left", "right")], more)


MADE = {
    "translation": cyclic,
    "rotation": sector,
    "empty": lambda case: paired.written(
        paired.airfoil(1, 0.25, **SMALL), case, {"side0": "empty", "side1": "empty"}
    ),
    "wedge": lambda case: paired.written(paired.wedge(), case, {"front": "wedge", "back": "wedge"}),
    "ring": lambda case: paired.written(paired.wedge(axis=0.5), case, {"front": "wedge", "back": "wedge"}),
}  # fmt: skip
ROTATIONS = {"rotation": paired.about_x(-30.0), "wedge": paired.about_x(5.0), "ring": paired.about_x(5.0)}


def edited(case, change):
    boundary = case / MESH / "boundary"
    boundary.write_text(change(boundary.read_text()))
    return case


@pytest.mark.parametrize("name", MADE)
def test_pairs_are_read_whole_and_in_pieces(name, tmp_path):
    case = MADE[name](tmp_path / "case")
    mesh, pieces = OpenFoam().read(case), in_pieces(case)
    (pair,) = mesh.periodic
    rotation = ROTATIONS.get(name, np.eye(3))
    one, other = mesh.points[pair.nodes[:, 0]], mesh.points[pair.nodes[:, 1]]
    if "back" in pair.patches and one[0, 2] > other[0, 2]:
        rotation = rotation.T
    np.testing.assert_allclose(pair.rotation, rotation, atol=1e-13)
    np.testing.assert_allclose(pair.image(one), other, atol=1e-13)
    if name in ("translation", "empty"):
        assert np.array_equal(pair.shift, [0.0, 0.25, 0.0])
        assert np.array_equal(pair.rotation, np.eye(3))
    on = [mesh.patch(patch).nodes for patch in pair.patches]
    assert np.array_equal(np.sort(pair.nodes[:, 0]), on[0])
    assert np.array_equal(np.sort(pair.nodes[:, 1]), on[1])
    assert np.array_equal(pieces.periodic[0].nodes, pair.nodes)
    assert [patch.constraint for patch in pieces.patches] == [patch.constraint for patch in mesh.patches]


@pytest.mark.parametrize(("kind", "layers"), [("empty", 1), ("cyclic", 2)])
def test_sides_of_one_patch(kind, layers, tmp_path):
    """One patch of both empty sides; one cyclic patch with both halves, as long ago."""
    flat = paired.airfoil(layers, 0.25, **SMALL)
    front, back = flat.patch("side0"), flat.patch("side1")
    flat = replace(flat, patches=(*flat.patches[:3], Patch("sides", (*front.faces, *back.faces))))
    (pair,) = OpenFoam().read(paired.written(flat, tmp_path / "case", {"sides": kind})).periodic
    assert pair.patches == ("sides", "sides")
    assert len(pair.nodes) == len(front.nodes)
    assert np.array_equal(np.abs(pair.shift), [0.0, 0.25, 0.0])


@pytest.mark.parametrize("kind", ["cyclic", "cyclicAMI", "cyclicACMI"])
def test_the_axis_of_the_case_serves_where_faces_are_not_in_order(kind):
    mesh = paired.sector()
    quads = mesh.patch("right").faces[0].nodes
    patches = mesh.patch("left"), Patch("right", (Cells("quad", np.random.default_rng(2).permutation(quads)),))
    axis = {"rotationAxis": "( 1 0 0 )", "rotationCentre": "( 5 0 0 )"}
    for more, count in (({}, 0), (axis, len(mesh.patch("left").nodes))):
        left = FoamPatch("left", kind, 360, 0, {"neighbourPatch": "right", **more})
        right = FoamPatch("right", kind, 360, 360, {"neighbourPatch": "left", **more})
        (pair,) = pairs_of([left, right], patches, lambda nodes: mesh.points[nodes])
        assert len(pair.nodes) == count
        if count:
            np.testing.assert_allclose(pair.rotation, ROTATIONS["rotation"], atol=1e-13)
            np.testing.assert_allclose(pair.image(mesh.points[pair.nodes[:, 0]]), mesh.points[pair.nodes[:, 1]])


def test_sides_that_do_not_match_are_a_pair_without_nodes(tmp_path):
    case = cyclic(tmp_path / "case", "cyclicAMI")

    def cut(text):
        first = re.search(r"side1\n\{[^}]*nFaces (\d+);\s*startFace (\d+);", text)
        count, start = int(first[1]), int(first[2])
        less = first[0].replace(f"nFaces {count}", f"nFaces {count - 3}")
        return text.replace(first[0], less).replace("\n5\n(", "\n6\n(").replace(
            "\n)", f"\nrest\n{{ type wall; nFaces 3; startFace {start + count - 3}; }}\n)"
        )  # fmt: skip

    (pair,) = OpenFoam().read(edited(case, cut)).periodic
    assert pair.patches == ("side0", "side1")
    assert not len(pair.nodes)


def test_a_neighbour_that_is_not_there_binds_nothing(tmp_path):
    case = edited(cyclic(tmp_path / "case"), lambda text: text.replace("neighbourPatch", "neighbourpatch"))
    assert not any(len(pair.nodes) for pair in OpenFoam().read(case).periodic)


def test_constraints_are_those_of_the_types(tmp_path):
    kinds = {"side0": "symmetryPlane", "side1": "symmetry", "far": "patch"}
    case = paired.written(paired.airfoil(2, 0.25, **SMALL), tmp_path / "case", kinds)
    found = {patch.name: patch.constraint for patch in OpenFoam().read(case).patches}
    assert found == {"wing": "", "flap": "", "far": "", "side0": "symmetry", "side1": "symmetry"}
    more = sector(tmp_path / "known", f"transform rotational; {AXIS}"), sector(tmp_path / "unknown")
    said = [{p.name: p.constraint for p in OpenFoam().read(case).patches}["left"] for case in more]
    assert said == ["", "symmetry"]


def test_what_is_written_anew_says_what_became_of_pairs(tmp_path):
    thin, pair = (OpenFoam().read(MADE[name](tmp_path / name)) for name in ("empty", "translation"))
    for mesh, lost in ((thin, ()), (pair, ("side0 and side1 are periodic, which the file does not say",))):
        assert write_mesh(None, mesh, mesh.points, tmp_path / f"case{len(lost)}") == lost
        assert len(OpenFoam().read(tmp_path / f"case{len(lost)}").periodic) == 1 - len(lost)
