"""Meshes that have inverted cells already: those that invert now are counted one by one, never against the others."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.box.automatic import Given
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.options import Repair
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.submesh import submesh
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.compiled_quality import CORNERS
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import FACES, grid
from tests.deform.jobs import placed
from tests.deform.volume.test_submesh import Elsewhere, in_pieces

BOX = Given.at(np.array([[0.05, 0.05, -0.1], [1.15, 0.75, 0.55]]))
# A node over the flap that was pulled through the cells beside it, and the node of the flap that moves.
ABOVE, PULLED = (0.6, 0.4, 0.1), (0.5, 0.3, 0.0)
# Nodes of the tetrahedra of a cube beside its first and its seventh.
SPLIT = ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))


def floor(shape):
    """A block of cubes, or of their tetrahedra, on a floor with a flap; cells over it are inverted already."""
    points, cells = grid([0, 0, 0], [1.2, 0.8, 0.6], [12, 8, 6])
    quads = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True)
    quads = quads[first[count == 1]]
    centre = points[quads].mean(axis=1)
    faces, name = (Cells("quad", quads),), "hexahedron"
    if shape == "tetra":
        cells, name = np.concatenate([cells[:, [0, a, b, 6]] for a, b in SPLIT]), "tetra"
        sides = np.concatenate([cells[:, f] for f in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))])
        _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        faces = (Cells("triangle", sides[first[count == 1]]),)
        centre = points[faces[0].nodes].mean(axis=1)
    x, y, z = centre.T
    low = z < 1e-9
    flap = low & (np.abs(x - 0.6) < 0.2) & (np.abs(y - 0.4) < 0.2)
    parts = {"flap": flap, "wall": low & ~flap, "far": ~low}
    patches = tuple(Patch(key, (Cells(faces[0].shape, faces[0].nodes[own]),)) for key, own in parts.items())
    points[_at(points, ABOVE), 2] += 0.12
    return Mesh(points, (Cells(name, cells),), patches)


def _at(points, place):
    return int(np.argmin(np.linalg.norm(points - place, axis=1)))


def pulled(mesh, amount, repair):
    """A job in which one node of the flap goes up and beyond its neighbours."""
    nodes = mesh.patch("flap").nodes
    way = np.zeros((len(nodes), 3))
    way[nodes == _at(mesh.points, PULLED), :2] = 0.13 * amount
    moving = Moving(("flap",), Table(mesh.points[nodes], way), 1.0)
    return Job((moving,), fixed=("wall", "far"), box=BOX, repair=Repair(repair), allow_inverted=True)


def inverted(mesh, points):
    """Rows of the cells inverted at points, by NumPy's determinants alone."""
    (block,) = mesh.cells
    corners = points[block.nodes]
    edges = [np.stack([corners[:, k] - corners[:, o] for k in ends], 1) for o, *ends in CORNERS[block.shape]]
    return np.flatnonzero(np.min([np.linalg.det(one) for one in edges], axis=0) <= 0.0)


def checked(found):
    return {check.name: check for check in checks_of(found)}


@pytest.mark.parametrize(("shape", "amount"), [("tetra", 0.9), ("tetra", 1.0), ("hexahedron", 0.4)])
@pytest.mark.parametrize(("repair", "order"), [("auto", 1), ("off", 1), ("off", -1)])
def test_cells_that_invert_are_not_made_up_for_by_others_that_a_repair_mended(shape, amount, repair, order):
    mesh = floor(shape)
    mesh = replace(mesh, cells=(Cells(mesh.cells[0].shape, mesh.cells[0].nodes[::order]),))
    before = inverted(mesh, mesh.points)
    found = deflect(Plan.of(mesh, [pulled(mesh, amount, repair)]), (1.0,))
    new = np.setdiff1d(inverted(mesh, found.points), before)
    check = checked(found)["inverted_cells"]
    assert len(before)
    assert (check.value, check.limit, found.inverted) == (len(new), 0, len(new))
    assert len(new)
    assert not check.passed
    assert f"without {len(before)} that were inverted before; the first is cell {new[0]}" in check.where


@pytest.mark.parametrize("shape", ["tetra", "hexahedron"])
def test_cells_that_were_good_keep_their_quality_beside_one_that_was_inverted(shape):
    mesh = floor(shape)
    plan = Plan.of(mesh, [pulled(mesh, 0.1, "off")])
    found = deflect(plan, (1.0,))
    (old,) = plan.before
    quality, was_inverted = plan.affected.scores(mesh.points)
    good = ~was_inverted & (quality > 0.0)
    check = checked(found)[f"quality_min:{shape}"]
    assert old.min <= 0.0
    assert check.limit == 0.1 * quality[good].min() > 0.0
    assert check.value == plan.affected.scores(found.points).quality[good].min()
    assert check.over == good.sum() < plan.affected.count
    assert check.passed
    flat = found.points.copy()
    (block,) = mesh.cells
    corner, *ends = block.nodes[plan.affected.rows[0][good][0]][list(CORNERS[shape][0])]
    flat[corner] += 0.999 * (flat[ends].mean(axis=0) - flat[corner])
    assert not checked(placed(found, flat))[f"quality_min:{shape}"].passed


def test_a_repair_ends_where_no_cell_is_inverted_that_was_not_before():
    mesh = floor("tetra")
    job = pulled(mesh, 0.7, "auto")
    alone = deflect(Plan.of(mesh, [pulled(mesh, 0.7, "off")]), (1.0,))
    found = deflect(Plan.of(mesh, [job]), (1.0,))
    assert alone.inverted == 2
    assert found.inverted == len(found.boxes[0].repaired.inverted) == 0
    assert all(check.passed for check in checked(found).values())


def test_a_submesh_counts_the_same_cells():
    mesh = floor("tetra")
    job = pulled(mesh, 0.9, "off")
    part = submesh(in_pieces(mesh), (job,), ((1.0,),), Elsewhere())
    whole, found = (checked(deflect(Plan.of(one, [job]), (1.0,))) for one in (mesh, part))
    assert found["inverted_cells"].value > 0
    for name in ("inverted_cells", "quality_min:tetra"):
        assert found[name].as_dict() == whole[name].as_dict()
