"""Meshes one cell thick: their thickness, or the opening angle of a wedge, changes nothing."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import HERE
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.submesh import submesh
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.thin import MidPlane, ThinMesh
from tests.deform.blocks import block_with_body
from tests.deform.jobs import job
from tests.deform.paired import about_x, bound, section, wedge
from tests.deform.volume.test_images import made
from tests.deform.volume.test_submesh import in_pieces
from tests.limits import limited

THICKNESSES = (0.01, 1.0, 100.0)
SMALL = {"around": 32, "outwards": 8}
MOTION = Blended(Rotation.about([0.7, 0.0]), held=OnPatches(("wing",)))
WANTED = job(["flap"], motion=MOTION, angle=10.0, fixed=("wing",))


def flat():
    """The airfoil as a plane mesh."""
    points, quads = section(**SMALL)
    lines = np.sort(quads[:, [[0, 1], [1, 2], [2, 3], [3, 0]]].reshape(-1, 2), axis=1)
    lines, count = np.unique(lines, axis=0, return_counts=True)
    lines = lines[count == 1]
    x, y = points[lines].mean(axis=1).T
    near = np.hypot(x - 0.5, y) < 1.0
    parts = {"wing": near & (x < 0.7), "flap": near & (x >= 0.7), "far": ~near}
    patches = tuple(Patch(name, (Cells("line", lines[own]),)) for name, own in parts.items())
    return Mesh(np.column_stack([points, np.zeros(len(points))]), (Cells("quad", quads),), patches)


def thick(span, constraint="empty"):
    """The same one cell thick along z, between two sides."""
    mesh = flat()
    n = len(mesh.points)
    quads = mesh.cells[0].nodes
    patches = [
        Patch(p.name, (Cells("quad", np.hstack([p.faces[0].nodes, n + p.faces[0].nodes[:, ::-1]])),))
        for p in mesh.patches
    ]
    patches += [Patch(f"side{i}", (Cells("quad", i * n + quads),), constraint=constraint) for i in range(2)]
    points = np.vstack([mesh.points, mesh.points + np.array([0.0, 0.0, span])])
    solid = Mesh(points, (Cells("hexahedron", np.hstack([quads, n + quads])),), tuple(patches))
    return (
        bound(solid, "side0", "side1", shift=(0.0, 0.0, span), constraint="empty") if constraint == "empty" else solid
    )


def sliding(span):
    """The same between two planes of symmetry."""
    return thick(span, "symmetry")


def turned(mesh, wanted=WANTED, angle=10.0):
    return deflect(Plan.of(mesh, [wanted]), (angle,))


def figures(result):
    sites = result.plan.boxes[0].sites
    return sites.tolerance, sites.spacing, len(sites.distinct), len(sites.fixed), *map(len, sites.zero)


@pytest.mark.parametrize("kind", [thick, sliding])
def test_the_thickness_changes_nothing(kind):
    found = [turned(kind(span)) for span in THICKNESSES]
    for other in found[1:]:
        assert figures(other) == figures(found[0])
        assert np.abs(other.points[:, :2] - found[0].points[:, :2]).max() < 1e-12
        assert np.array_equal(other.points[:, 2], other.plan.mesh.points[:, 2])
    assert all(check.passed for result in found for check in checks_of(result))


def test_both_kinds_and_the_plane_mesh_agree():
    one, other, plane = (turned(mesh) for mesh in (thick(0.1), sliding(0.1), flat()))
    assert np.array_equal(one.points, other.points)
    assert figures(plane) == figures(one)
    assert np.abs(plane.points - one.points[: len(plane.points)]).max() < 1e-12


def test_a_plane_across_another_axis_is_as_good():
    turns = [thick(span) for span in (0.01, 100.0)]
    swapped = [replace(m, points=m.points[:, [1, 2, 0]], periodic=()) for m in turns]
    axis = replace(MOTION.base.axis, point=np.array([0.0, 0.0, 0.7]), direction=np.eye(3)[1])
    motion = replace(MOTION, base=Rotation(axis))
    wanted = replace(WANTED, surfaces=(replace(WANTED.surfaces[0], motion=motion),))
    found = []
    for mesh in swapped:
        both = replace(mesh, patches=tuple(replace(p, constraint="") for p in mesh.patches))
        shift = both.points[both.patch("side1").nodes[0]] - both.points[both.patch("side0").nodes[0]]
        found.append(turned(bound(both, "side0", "side1", shift=shift, constraint="empty"), wanted))
    assert figures(found[0]) == figures(found[1])
    assert np.abs(found[0].points - found[1].points)[:, [0, 2]].max() < 1e-12
    assert np.abs(found[0].points[:, [2, 0]] - turned(turns[0]).points[:, :2]).max() < 1e-3, "ties are broken otherwise"


@pytest.mark.parametrize("kind", [thick, sliding])
def test_a_mesh_in_pieces_gives_the_same_bits(kind, monkeypatch):
    limited(monkeypatch, points=90, cells=70, in_memory=0)
    mesh = kind(100.0)
    part = submesh(replace(in_pieces(mesh), periodic=mesh.periodic), [WANTED], ((10.0,),), HERE)
    whole, own = turned(mesh), turned(part)
    assert own.points.tobytes() == whole.points[part.whole.nodes].tobytes()
    assert figures(own) == figures(whole)
    assert len(own.plan.boxes[0].inside) == len(whole.plan.boxes[0].inside)


def test_the_opening_angle_of_a_wedge_changes_nothing():
    _, wanted = made("wedge")
    found = []
    for degrees in (5.0, 1.0, 20.0):
        mesh = bound(wedge(degrees), "front", "back", about_x(degrees), constraint="wedge")
        result = turned(mesh, wanted)
        found.append((result, np.column_stack([result.points[:, 0], np.hypot(*result.points[:, 1:].T)])))
    for other, places in found[1:]:
        assert figures(other) == pytest.approx(figures(found[0][0]), rel=1e-9)
        assert np.abs(places - found[0][1]).max() < 1e-12


def test_a_repair_keeps_both_sides_alike():
    for span in THICKNESSES:
        result = turned(thick(span), replace(WANTED, repair=replace(WANTED.repair, mode="always")), 60.0)
        front, back = result.plan.mesh.periodic[0].nodes.T
        assert np.abs(result.points[front] - result.points[back])[:, :2].max() < 1e-12
        assert result.repairs


def test_a_plan_knows_the_plane(tmp_path):
    for name in ("empty", "wedge"):
        mesh, wanted = made(name)
        result = turned(mesh, wanted)
        MeshMotion.of_one_amount(result, ()).save(tmp_path / "p.npz")
        again = MeshMotion.load(tmp_path / "p.npz")
        assert again.on(mesh.points).at(result.amounts).tobytes() == result.points.tobytes()
        with pytest.raises(InputError, match=r"near a place of the plan|measured on another mesh"):
            again.on(mesh.points + 1e-7)


def test_sides_that_are_fixed_or_oblique_make_no_plane_mesh():
    mesh = thick(0.1)
    assert ThinMesh.of(mesh)
    assert not ThinMesh.of(mesh, ["side0"])
    more = replace(mesh, points=np.vstack([mesh.points, [[9.0, 0.05, 9.0]]]))
    assert not ThinMesh.of(more), "a node on neither side"
    turn = about_x(30.0)
    pair = replace(mesh.periodic[0], shift=turn @ mesh.periodic[0].shift)
    assert not ThinMesh.of(replace(mesh, points=mesh.points @ turn.T, periodic=(pair,)))
    with pytest.raises(InputError, match="nodes shared by the moving surface and side0"):
        Plan.of(mesh, [replace(WANTED, fixed=("wing", "side0"))])


def test_the_plane_is_known_from_its_numbers():
    mesh, _ = made("wedge")
    for one in (MidPlane(1, 0.05), MidPlane.of(mesh.points, mesh.periodic[0])):
        again = pickle.loads(pickle.dumps(MidPlane.from_numbers(one.numbers)))
        assert np.array_equal(again.places(mesh.points), one.places(mesh.points))
    with pytest.raises(ValueError, match="not in list"):
        MidPlane.from_numbers(np.array([3.0, 0.0]))


def one_patch(mesh, names, name="sides"):
    """The mesh with some patches as one."""
    blocks = [block for one in names for block in mesh.patch(one).faces]
    faces = (Cells(blocks[0].shape, np.vstack([block.nodes for block in blocks])),)
    return replace(mesh, patches=(*(p for p in mesh.patches if p.name not in names), Patch(name, faces)))


def test_a_patch_whose_parts_are_planes_slides_on_each():
    for mesh in (thick(0.1, "symmetry"), block_with_body(8)):
        names = [name for name in mesh.names if name in ("side0", "side1", "y-", "y+")]
        patches = tuple(replace(patch, constraint="") for patch in mesh.patches)
        apart = replace(mesh, patches=patches)
        hinge = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        wanted = WANTED if "flap" in mesh.names else job(["body"], hinge, fixed=("x-", "x+", "z-", "z+"))
        slides = [job(["flap"], slide=dict.fromkeys(sides, "plane")).slides for sides in (names, ["sides"])]
        one = turned(apart, replace(wanted, slides=slides[0]))
        other = turned(one_patch(apart, names), replace(wanted, slides=slides[1]))
        assert np.array_equal(one.points, other.points)
        checks = {check.name for check in checks_of(other)}
        assert {"on_sides#1", "on_sides#2"} <= checks or "plane_sides#1_sides#2" in checks
    box = one_patch(block_with_body(8), ["x-", "y-"])
    with pytest.raises(InputError, match="the patch is no plane"):
        turned(box, job(["body"], hinge, slide={"sides": "plane"}))
