"""Patches hold the boundary, and nothing else: faces by their nodes, and by their owners where a mesh has these."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.faces import BoundaryGaps
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body
from tests.deform.jobs import job
from tests.meshing.formats.examples import polyhedral


def with_baffle(whole):
    """A block with a plate without thickness in it, at z = 1: both sides are patches, of the same nodes."""
    mesh = block_with_body(8)
    x, y, z = mesh.points.T
    plate = (np.abs(x) < 0.6) & (np.abs(y) < 0.6) & (z == 1.0)
    one = polyhedral(mesh)
    (cells,) = one.cells
    inner = len(cells.neighbour)
    own = np.array(
        [
            plate[cells.faces.nodes[a:b]].all()
            for a, b in zip(cells.faces.offsets[:-1], cells.faces.offsets[1:], strict=True)
        ]
    )
    cut = np.flatnonzero(own[:inner])
    rows = [np.setdiff1d(np.arange(inner), cut), np.arange(inner, len(cells.faces)), cut, cut]
    faces = cells.faces.nodes.reshape(-1, 4)
    owner = np.concatenate([cells.owner[rows[0]], cells.owner[rows[1]], cells.owner[cut], cells.neighbour[cut]])
    nodes = np.concatenate([*(faces[row] for row in rows[:3]), faces[cut][:, ::-1]])
    block = Polyhedra(Polygons(nodes.ravel(), np.arange(0, nodes.size + 1, 4)), owner, cells.neighbour[rows[0]])
    sides = [Patch(name, (Cells("quad", faces[cut]),)) for name in ("upper", "lower")]
    return Mesh(mesh.points, (block,) if whole else mesh.cells, (*mesh.patches, *sides))


@pytest.mark.parametrize(("owned", "inner"), [(True, 0), (False, 8)])
def test_two_faces_of_one_owner_each_are_no_face_between_two(owned, inner):
    """Only where a mesh has owners: in a mesh of hexahedra both patches name the face between two."""
    mesh = with_baffle(owned)
    gaps = BoundaryGaps.of(
        AffectedCells.of(mesh, np.arange(len(mesh.points))), np.arange(len(mesh.points)), ("upper", "lower")
    )
    assert (gaps.faces, gaps.loose, gaps.inner) == (0, 0, inner)


def test_a_plate_without_thickness_turns():
    mesh = with_baffle(True)
    hinge = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]]
    plan = Plan.of(mesh, [job(("upper", "lower"), hinge=hinge, angle=8.0, fixed=("body",))])
    failed = [check.name for check in checks_of(deflect(plan, (8.0,))) if not check.passed]
    assert failed == []
    inside = replace(mesh, cells=with_baffle(False).cells)
    assert "faces_off_boundary" in {
        check.name for check in checks_of(deflect(Plan.of(inside, [plan.job]), (8.0,))) if not check.passed
    }
