"""Patches between cells follow the mesh, slits stay closed, and crossed faces are put in order."""

from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect import InputError, MeshMotion
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.faces import corners_in_order, inner_patches, on_boundary
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body, joined
from tests.deform.plates import plate
from tests.deform.sheets import with_sheet, with_slit
from tests.limits import limited

BODY = {"hinge": [[0, -0.6, 0], [0, 0.6, 0]]}
HOLE = {"hinge": [-0.2, 0.0]}


def aft(centres):
    """In the plane behind the body, up to the outer boundary."""
    return (np.abs(centres[:, 2]) < 1e-9) & (centres[:, 0] > 0.5) & (np.abs(centres[:, 1]) < 0.5)


def line(centres):
    """On the line behind the hole."""
    return (np.abs(centres[:, 1]) < 1e-9) & (centres[:, 0] > 0.25)


def around(centres):
    """A closed surface around the body: a box of refinement."""
    far = np.abs(centres).max(axis=1)
    return np.abs(far - 1.0) < 1e-9


CASES = {
    "wake of a body": (lambda: block_with_body(8), aft, "body", BODY),
    "box of refinement": (lambda: block_with_body(16), around, "body", BODY),
    "wake line in triangles": (lambda: plate(24, "triangle"), line, "hole", HOLE),
    "wake line in quadrilaterals": (lambda: plate(24, "quad"), line, "hole", HOLE),
}


def deflected(mesh, surface, given, angle=6.0, **more):
    return sd.deflect(mesh, surface, given["hinge"], angle, margin=0.45, **more)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("form", ["", "su2", "cgns", "pieces"])
def test_a_patch_between_cells_follows_the_mesh(case, form, tmp_path, monkeypatch):
    make, inside, surface, given = CASES[case]
    form = "su2" if form == "pieces" and make().plane else form  # a plane mesh is read as a whole
    bare = make()
    mesh = with_sheet(bare, inside)
    assert inner_patches(mesh.patches, lambda: mesh.cells, len(mesh.points)) == {"wake"}
    expected = deflected(bare, surface, given)
    path = tmp_path / f"wake.{form if form in ('su2', 'cgns') else 'su2'}"
    if form:
        FORMATS[path.suffix[1:]].write(mesh, path)
    if form != "pieces":
        found = deflected(sd.read(path) if form else mesh, surface, given)
        np.testing.assert_array_equal(found.points, expected.points)
        assert found.passed == expected.passed
        assert any("wake: faces between cells, which follow the mesh" in note for note in found.notes)
        return
    limited(monkeypatch, file=0, in_memory=0, points=97, cells=61)
    plan = sd.plan(path, surface, given["hinge"], 6.0, margin=0.45)
    assert plan.plan.mesh.whole
    np.testing.assert_array_equal(plan.at(6.0), expected.points)


@pytest.mark.parametrize("suffix", [".cgns", ".vtu", ".msh", ".su2"])
def test_it_is_written_where_it_was_read(suffix, tmp_path):
    mesh = with_sheet(block_with_body(8), aft)
    FORMATS["su2"].write(mesh, tmp_path / "wake.su2")
    found = deflected(sd.read(tmp_path / "wake.su2"), "body", BODY)
    stored = sd.read(found.save(tmp_path / f"out{suffix}"))
    assert {*stored.names} == {*mesh.names}
    assert len(stored["wake"]) == len(mesh.patch("wake"))
    np.testing.assert_array_equal(stored.points[stored["wake"].nodes].min(axis=0), found.points[mesh.on("wake")].min(0))


def test_a_role_of_its_own_stands_and_does_not_stop_the_surface():
    mesh = with_sheet(block_with_body(8), aft)
    for role in ({"fixed": "wake"}, {"slide": "wake:plane"}, {"slide": "wake:surface"}):
        with pytest.raises(InputError, match="wake lies between cells and has nodes of the moving surface: give it no"):
            deflected(mesh, "body", BODY, **role)
    deflected(mesh, "body", BODY, fixed="*")  # a wildcard means walls
    disk = with_sheet(block_with_body(16), lambda c: (np.abs(c - [0.75, 0.0, 0.0]) < [1e-9, 0.4, 0.4]).all(axis=1))
    found = deflected(disk, "body", BODY, fixed="wake")
    assert not found.displacement[disk.on("wake")].any()
    assert np.abs(deflected(disk, "body", BODY).displacement[disk.on("wake")]).max() > 1e-4


SLITS = {
    "plane": (lambda: plate(24, "triangle"), line, lambda c: c[:, 1] > 0.0, "hole", HOLE, "plane"),
    "space": (lambda: block_with_body(16), aft, lambda c: c[:, 2] > 0.0, "body", BODY, "plane"),
}


def gaps(mesh, points):
    """Distances between nodes at one place of the undeflected mesh."""
    nodes = mesh.on(*(name for name in ("front", "back", "internal") if name in mesh.names))
    order = nodes[np.lexsort(mesh.points[nodes].T)]
    pair = np.flatnonzero((np.diff(mesh.points[order], axis=0) == 0.0).all(axis=1))
    return np.linalg.norm(points[order[pair]] - points[order[pair + 1]], axis=1)


def test_the_nodes_of_a_slit_stay_together_in_a_repair(tmp_path):
    """The repair moved the two nodes of a pair apart by nearly as much as the surface moved, and no check saw it."""
    make, inside, above, surface, given, _ = SLITS["plane"]
    for names in (("front", "back"), ("internal",)):
        mesh = with_slit(make(), lambda c: inside(c) & (c[:, 0] > 0.3) & (c[:, 0] < 0.8), above, names)
        for angle in (10.0, 40.0):
            found = deflected(mesh, surface, given, angle, slide=dict.fromkeys(names, "plane"), repair="always")
            assert found.deflection.repairs
            assert len(gaps(mesh, found.points)) > 3
            assert gaps(mesh, found.points).max() == 0.0
            (check,) = [check for check in found.checks if check.name == "nodes_parted"]
            assert check.passed
            assert 3 < check.over <= len(gaps(mesh, found.points))
        one = sd.plan(mesh, surface, given["hinge"], range=(-10, 10), slide=dict.fromkeys(names, "plane"), margin=0.45)
        one.save(tmp_path / "p.npz")
        again = MeshMotion.load(tmp_path / "p.npz", mesh.points)
        np.testing.assert_array_equal(again.at(10), one.at(10))


def test_pairs_that_part_are_counted_but_moving_beside_fixed(tmp_path):
    make, inside, above, surface, given, _ = SLITS["plane"]
    mesh = with_slit(make(), lambda c: inside(c) & (c[:, 0] > 0.3) & (c[:, 0] < 0.8), above)
    found = deflected(mesh, surface, given, slide={"front": "plane", "back": "plane"}).deflection
    torn = found.points.copy()
    torn[mesh.patch("back").nodes[2:4], 1] += 0.02
    (check,) = [c for c in sd.deform.checks.checks_of(type(found).at(found.plan, torn)) if c.name == "nodes_parted"]
    assert (check.value, check.passed) == (2.0, False)
    assert "the farthest, on front, back, is now 0.02 apart" in check.where
    sealed = joined(block_with_body(8), solid())  # a moving skin beside a fixed one
    checks = sd.deflect(sealed, "body", BODY["hinge"], 3.0, fixed="body'").checks
    assert not [check for check in checks if check.name == "nodes_parted" and not check.passed]


def solid():
    """The cube that fills the hole of `block_with_body`."""
    from tests.cases.test_left_behind import solid as cube

    return cube()


@pytest.mark.parametrize("pieces", [False, True])
def test_a_node_inside_another_zone_is_nobodys_copy(pieces, tmp_path, monkeypatch):
    """A background grid with a node where the flap has one was told to move."""
    near, far = block_with_body(8), block_with_body(8)
    background = Mesh(far.points * 0.5 + 0.5, far.cells, far.patches)  # its inner nodes lie on the body's skin
    moving = near.points[near.on("body")]
    moving = moving[np.hypot(moving[:, 0], moving[:, 2]) > 0.0]  # the others are on the hinge
    hits = (np.abs(background.points[:, None] - moving).max(axis=2) < 1e-12).any(axis=1)
    skin = np.isin(np.flatnonzero(hits), background.on(*background.names))
    assert hits.any()
    assert not skin.all()
    both = joined(near, background)
    FORMATS["cgns"].write(both, tmp_path / "overset.cgns")
    mesh = sd.read(tmp_path / "overset.cgns")
    if pieces:
        limited(monkeypatch, file=0, in_memory=0, points=97, cells=61)
        plan = sd.plan(tmp_path / "overset.cgns", "body", BODY["hinge"], range=(-3, 3), margin=0.45)
        value = {name for row in plan.measured[0] for name in row.failed}
        assert ("left_behind" in value) == bool(skin.any())
        return
    found = sd.deflect(mesh, "body", BODY["hinge"], 3.0, margin=0.45)
    (check,) = [check for check in found.checks if check.name == "left_behind"]
    assert check.value == np.count_nonzero(skin)


def test_nodes_on_the_boundary_are_those_of_faces_of_one_cell():
    for mesh in (block_with_body(6), plate(12, "triangle"), plate(12, "quad")):
        nodes = np.arange(len(mesh.points))
        expected = mesh.on(*mesh.names)
        assert np.array_equal(on_boundary(mesh.cells, len(nodes), nodes), expected)
        some = np.random.default_rng(3).permutation(nodes)[: len(nodes) // 2]
        assert np.array_equal(on_boundary(mesh.cells, len(nodes), np.sort(some)), np.intersect1d(some, expected))


ORDERS = [[0, 2, 1, 3], [0, 1, 3, 2], [1, 0, 2, 3], [3, 1, 2, 0], [2, 0, 1, 3]]


@pytest.mark.parametrize("order", ORDERS)
def test_crossed_faces_are_put_in_order(order):
    mesh = block_with_body(8)
    mesh = mesh.with_points(mesh.points + 0.02 * np.random.default_rng(5).normal(size=mesh.points.shape))
    body = mesh.patch("body").faces[0].nodes
    crossed = body.copy()
    crossed[::2] = crossed[::2][:, order]
    (fixed,), (note,) = corners_in_order([Patch("body", (Cells("quad", crossed),))], mesh.points)
    edges = [{frozenset((face[i], face[i - 1])) for i in range(4)} for face in fixed.faces[0].nodes.tolist()]
    assert edges == [{frozenset((face[i], face[i - 1])) for i in range(4)} for face in body.tolist()]
    assert note == "body: 12 of 24 faces have their corners out of order; read in order"
    assert corners_in_order(mesh.patches, mesh.points) == (mesh.patches, [])


@pytest.mark.parametrize("form", ["mesh", "su2", "cgns", "ugrid", "pieces"])
def test_a_mesh_with_crossed_faces_deflects_as_the_right_one(form, tmp_path, monkeypatch):
    right = block_with_body(8)
    body = right.patch("body").faces[0].nodes.copy()
    body[1::2] = body[1::2][:, [0, 2, 1, 3]]
    wrong = replace(right, patches=(Patch("body", (Cells("quad", body),)), *right.patches[1:]))
    expected = deflected(right, "body", BODY)
    if form == "mesh":
        found = deflected(wrong, "body", BODY)
    else:
        path = tmp_path / {"ugrid": "wrong.b8.ugrid", "cgns": "wrong.cgns"}.get(form, "wrong.su2")
        FORMATS[path.suffix[1:]].write(wrong, path)
        if form == "pieces":
            limited(monkeypatch, file=0, in_memory=0, points=97, cells=61)
            plan = sd.plan(path, "body", BODY["hinge"], 6.0, margin=0.45)
            np.testing.assert_array_equal(plan.at(6.0), expected.points)
            return
        found = deflected(sd.read(path), "body", BODY)
    np.testing.assert_array_equal(found.points, expected.points)
    assert any("12 of 24 faces have their corners out of order" in note for note in found.notes)


def test_a_concave_face_is_not_crossed():
    points = np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0], [1, 1, 0.1]], dtype=float)
    faces = Cells("quad", np.array([[0, 1, 2, 3], [0, 1, 4, 3], [3, 2, 1, 0]]))
    patches = [Patch("p", (faces,))]
    assert corners_in_order(patches, points) == (tuple(patches), [])
