"""What follows from a submesh of a mesh has the same bits as what follows from all of it."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Threads
from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.volume import submesh
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import pose_of
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from tests.deform.blocks import block_with_body, joined, two_bodies
from tests.deform.jobs import job
from tests.limits import limited


@dataclass(frozen=True, slots=True, eq=False)
class MeshPieces:
    """A mesh in memory as if it were in a file."""

    mesh: Mesh
    source: str = "held"
    files: tuple = ()

    @property
    def points(self):
        return len(self.mesh.points)

    @property
    def blocks(self):
        return tuple((own.shape, len(own)) for own in self.mesh.cells)

    def coordinates(self, start, stop):
        assert 0 <= start < stop <= self.points
        return self.mesh.points[start:stop]

    def places(self, nodes):
        return self.mesh.points[nodes]

    def cells_of(self, block, start, stop):
        own = self.mesh.cells[block]
        return Cells(own.shape, own.nodes[start:stop].astype(np.int32))


class Elsewhere:
    """Does all work on copies, as another process would, the last piece first."""

    shares_memory = False

    def map(self, work, shared, items):
        done = [work(pickle.loads(pickle.dumps(shared)), pickle.loads(pickle.dumps(item))) for item in items[::-1]]
        yield from done[::-1]


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch):
    limited(monkeypatch, points=90, cells=70, in_memory=0)


def in_pieces(mesh: Mesh) -> MeshOnDisk:
    return MeshOnDisk(mesh.name, MeshPieces(mesh), mesh.patches, mesh.zones)


def shuffled(mesh: Mesh) -> Mesh:
    order = np.random.default_rng(5).permutation(len(mesh.points))
    number = np.argsort(order)
    cells = tuple(Cells(own.shape, number[own.nodes]) for own in mesh.cells)
    patches = tuple(Patch(p.name, tuple(Cells(f.shape, number[f.nodes]) for f in p.faces)) for p in mesh.patches)
    return Mesh(mesh.points[order], cells, patches)


def far(names, *moving):
    return tuple(name for name in names if name not in moving)


def beside(mesh: Mesh) -> Mesh:
    """The same, over a part of where it was."""
    return mesh.with_points(mesh.points + np.array([0.7, 0.11, 0.13]))


MESHES = {
    "block": (block_with_body(16), ("body",)),
    "shuffled": (shuffled(block_with_body(16)), ("body",)),
    "two zones": (joined(block_with_body(), beside(block_with_body())), ("body",)),
    "the other zone": (joined(beside(block_with_body()), block_with_body()), ("body'",)),
    "two bodies": (two_bodies(), ("left", "right")),
}


@pytest.mark.parametrize("runner", [Threads(), Elsewhere()], ids=["threads", "elsewhere"])
@pytest.mark.parametrize("name", MESHES)
def test_points_and_cells_of_a_deflection(name, runner):
    mesh, moving = MESHES[name]
    own = job(moving, angle=4.0, fixed=far(mesh.names, *moving), box=Automatic(margin=0.6))
    part = submesh.submesh(in_pieces(mesh), (own,), ((4.0,),), runner)
    assert len(part.points) < len(mesh.points)
    numbers = part.numbers(np.arange(len(part.points)))
    assert (np.diff(numbers) > 0).all()
    np.testing.assert_array_equal(part.points, mesh.points[numbers])
    whole, found = (deflect(Plan.of(one, [own]), (4.0,)) for one in (mesh, part))
    np.testing.assert_array_equal(found.points, whole.points[numbers])
    rest = np.setdiff1d(np.arange(len(mesh.points)), numbers)
    np.testing.assert_array_equal(whole.points[rest], mesh.points[rest])
    assert found.plan.affected.count == whole.plan.affected.count == sum(len(rows) for rows in part.whole.rows)
    for rows, wanted in zip(part.whole.rows, whole.plan.affected.rows, strict=True):
        np.testing.assert_array_equal(rows, wanted)
    assert found.quality == whole.quality


def test_a_submesh_holds_what_lies_in_any_of_several_boxes():
    mesh, hinges = two_bodies(), {"left": -1.25, "right": 1.25}
    jobs = [
        job((name,), [[x, 0, 0], [x, 1, 0]], 4.0, box=[[x - 0.9, -1.4, -1.5], [x + 0.9, 1.4, 1.5]])
        for name, x in hinges.items()
    ]
    part = submesh.submesh(in_pieces(mesh), jobs, (pose_of(jobs),), Elsewhere())
    numbers = part.numbers(np.arange(len(part.points)))
    (whole, _), (found, _) = (next(run(Plan.of(one, jobs))) for one in (mesh, part))
    np.testing.assert_array_equal(found.points, whole.points[numbers])
    assert found.plan.affected.count == whole.plan.affected.count
    assert found.quality == whole.quality


@pytest.mark.parametrize("runner", [Threads(), Elsewhere()], ids=["threads", "elsewhere"])
def test_cells_of_the_other_hand_are_judged_as_such(runner):
    mesh = block_with_body()
    turned = Mesh(mesh.points, (Cells("hexahedron", mesh.cells[0].nodes[:, [0, 3, 2, 1, 4, 7, 6, 5]]),), mesh.patches)
    own = job(("body",), angle=4.0, fixed=far(mesh.names, "body"))
    part = submesh.submesh(in_pieces(turned), (own,), ((4.0,),), runner)
    assert (part.whole.orientation, part.whole.inverted) == ((-1.0,), (0,))
    assert Plan.of(turned, [own]).affected.orientation == (-1.0,)


def test_a_job_that_does_not_suit_is_refused_before_cells_are_read():
    mesh = block_with_body()

    class NoCells(MeshPieces):
        def cells_of(self, block, start, stop):
            raise AssertionError

    one = MeshOnDisk("block", NoCells(mesh), mesh.patches, mesh.zones)
    for own, said in ((job(("bod",)), "'bod' is no patch"), (job(("body",), fixed=("bogus",)), "'bogus' is no patch")):
        with pytest.raises(InputError, match=said):
            submesh.submesh(one, (own,), ((4.0,),), Threads())


def test_a_mesh_without_cells_and_a_patch_beyond_the_points():
    mesh = block_with_body()
    own = job(("body",), angle=4.0, fixed=far(mesh.names, "body"))
    with pytest.raises(InputError, match="there are no volume cells"):
        submesh.submesh(in_pieces(Mesh(mesh.points, (), mesh.patches)), (own,), ((4.0,),), Threads())
    short = MeshPieces(Mesh(mesh.points[:700], (), ()))
    with pytest.raises(InputError, match="patches name points that are not among the 700"):
        submesh.submesh(MeshOnDisk("block", short, mesh.patches, ()), (own,), ((4.0,),), Threads())
