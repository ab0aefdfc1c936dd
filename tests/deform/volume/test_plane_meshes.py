"""Two dimensions: the engine on triangles and quads."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect import deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import Multiquadric, ThinPlateSpline
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from sdm_deflect.deform.volume.job import Job, Sliding
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.edges import polygons_of, rim, sharp_edges
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.repair.freedom import FreeNodes
from sdm_deflect.meshing.repair.repair import repair_cells
from tests.deform.plates import plate

BOX = [[-0.9, -0.9], [0.9, 0.9]]


@pytest.mark.parametrize("kernel", [ThinPlateSpline(), Multiquadric(1e3)])
@pytest.mark.parametrize("z", [0.0, 3.0])
def test_affine_fields_are_met_with_the_polynomial_of_the_plane(kernel, z):
    """1, x and y: no coefficient for z, which no point tells."""
    rng = np.random.default_rng(4)
    places, others = (np.column_stack([rng.uniform(-1.0, 1.0, (40, 2)), np.full(40, z)]) for _ in range(2))
    slopes, constant = rng.normal(size=(2, 2)), rng.normal(size=2)
    found = fit(kernel, places, places[:, :2] @ slopes + constant)
    assert np.abs(found(others) - (others[:, :2] @ slopes + constant)).max() < 1e-12
    assert np.abs(found.alpha[1:3] - slopes).max() < 1e-11
    assert np.abs(found.beta).max() < 1e-10
    assert not found.alpha[3].any()


@pytest.mark.parametrize("shape", ["quad", "triangle"])
@pytest.mark.parametrize("z", [0.0, -7.5])
@pytest.mark.parametrize("strategy", ["squv", "mv"])
def test_a_hole_turns_about_a_point(shape, z, strategy):
    mesh = plate(shape=shape, z=z)
    result = deflect(mesh, "hole", hinge=[0.1, 0.0], angle=12, box=BOX, strategy=strategy)
    assert result.passed
    nodes = mesh.patch("hole").nodes
    arm = mesh.points[nodes, :2] - [0.1, 0.0]
    c, s = np.cos(np.radians(12.0)), np.sin(np.radians(12.0))
    turned = arm @ np.array([[c, s], [-s, c]]) + [0.1, 0.0]
    assert np.abs(result.points[nodes, :2] - turned).max() < 1e-15, "counter-clockwise"
    assert (result.points[:, 2] == z).all()
    outside = np.abs(mesh.points[:, :2]).max(axis=1) > 0.9
    assert result.points[outside].tobytes() == mesh.points[outside].tobytes()


def test_the_derivative_is_that_of_differences():
    mesh = plate(shape="triangle")
    options = {"hinge": [0.0, 0.0], "box": BOX, "tolerance": 1e-7, "repair": "off"}
    exact = deflect(mesh, "hole", angle=5.0, **options).sensitivity
    step = 1e-3
    ends = [deflect(mesh, "hole", angle=5.0 + sign * step, **options).points for sign in (1.0, -1.0)]
    assert np.abs(exact - (ends[0] - ends[1]) / (2.0 * step)).max() < 1e-6
    assert not exact[:, 2].any()


def test_boxes_of_four_corners_and_what_does_not_fit():
    mesh = plate()
    slanted = [[-0.8, -0.7], [0.8, -0.9], [0.9, 0.8], [-0.7, 0.9]]
    result = deflect(mesh, "hole", hinge=[0.0, 0.0], angle=5, box=slanted)
    again = deflect(mesh, "hole", hinge=[0.0, 0.0], angle=5, box=slanted[::-1])
    assert result.passed
    assert again.passed
    assert np.abs(result.points - again.points).max() < 1e-3
    for box, message in (
        (slanted[:3], "must be four points of two numbers, or two"),
        ([slanted[0], slanted[2], slanted[1], slanted[3]], "the box: "),
        ([[-1.0, -1.0, 5.0], [1.0, 1.0, 6.0]], "moving nodes of hole leave the box"),
    ):
        with pytest.raises(InputError, match=message):
            deflect(mesh, "hole", hinge=[0.0, 0.0], angle=5, box=box)


@pytest.mark.parametrize(
    ("hinge", "message"),
    [
        ([[0, 0, 0], [0, 1, 0]], "would leave the plane of the mesh by .*give the hinge as one point, such as 0.7,0"),
        ([[0, 0], [0, 1]], "must be two points of three numbers, or one of two"),
        ([0, 0, 0], "hinge"),
        ([[0, 0], [0, 0], [0, 0]], "must be two points, or one of two numbers in a plane mesh"),
    ],
)
def test_hinges_that_do_not_suit(hinge, message):
    with pytest.raises(InputError, match=message):
        deflect(plate(), "hole", hinge=hinge, angle=5, box=BOX)


def test_lines_around_slide_on_lines_circles_and_any_curve():
    mesh = plate()
    job = Job(
        (Moving(("hole",), Rotation.about([0.0, 0.0]), 8.0),), slides=(Sliding("bottom", "plane"),), fixed=("rest",)
    )
    for shape in ("plane", "surface"):
        plan = Plan.of(mesh, [replace(job, slides=(Sliding("bottom", shape),))])
        one = carried_out(plan, (8.0,))
        assert all(check.passed for check in checks_of(one))
        nodes = np.setdiff1d(mesh.patch("bottom").nodes, mesh.patch("rest").nodes)
        assert np.abs(one.points[nodes, 1] + 1.0).max() <= (0.0 if shape == "plane" else 1e-14)
        assert np.abs(one.points[nodes, 0] - mesh.points[nodes, 0]).max() > 1e-4, "they did slide"


def ring_mesh(count=48):
    """Quads between two circles."""
    angle = 2.0 * np.pi * np.arange(count) / count
    radii = np.linspace(0.3, 1.0, 9)
    points = np.array([(r * np.cos(a), r * np.sin(a), 0.0) for r in radii for a in angle])
    j, i = (axis.ravel() for axis in np.meshgrid(np.arange(8), np.arange(count), indexing="ij"))
    n = (i + 1) % count
    quads = np.column_stack([j * count + i, (j + 1) * count + i, (j + 1) * count + n, j * count + n])
    inner = np.column_stack([np.arange(count), np.roll(np.arange(count), -1)])
    outer = inner[:, ::-1] + 8 * count
    patches = (Patch("inner", (Cells("line", inner),)), Patch("outer", (Cells("line", outer),)))
    return Mesh(points, (Cells("quad", quads),), patches, name="ring")


def test_nodes_slide_on_a_circle():
    mesh = ring_mesh()
    box = [[-2.0, -2.0], [2.0, 2.0]]
    result = deflect(mesh, "inner", hinge=[0.05, 0.0], angle=10, slide="outer:cylinder", box=box)
    assert result.passed
    nodes = mesh.patch("outer").nodes
    assert np.abs(np.hypot(*result.points[nodes, :2].T) - 1.0).max() < 1e-14
    assert np.abs(result.points[nodes] - mesh.points[nodes]).max() > 0.01


@pytest.mark.parametrize("shape", ["quad", "triangle"])
@pytest.mark.parametrize("seed", range(5))
def test_shuffled_nodes_find_back(shape, seed):
    mesh, rng = plate(12, shape), np.random.default_rng(seed)
    inner = np.setdiff1d(np.arange(len(mesh.points)), mesh.on(*mesh.names))
    some = rng.permutation(inner)[: int(0.3 * len(inner))]
    points = mesh.points.copy()
    points[some] = points[rng.permutation(some)]
    affected = AffectedCells.of(mesh, np.arange(len(points)))
    assert affected.newly_inverted(points).sum() > 40
    found = repair_cells(points, affected, FreeNodes(inner, ()), 0.9)
    assert not len(found.inverted)
    assert not found.left
    assert (found.points[:, 2] == 0.0).all()
    assert found.points[mesh.on(*mesh.names)].tobytes() == mesh.points[mesh.on(*mesh.names)].tobytes()


@pytest.mark.parametrize("backward", [False, True])
def test_a_large_angle_is_repaired(backward):
    mesh = plate(40, "triangle")
    if backward:
        mesh = Mesh(mesh.points, (Cells("triangle", mesh.cells[0].nodes[:, ::-1]),), mesh.patches, name="left-handed")
    options = {"hinge": [0.1, 0.0], "angle": 60, "box": [[-0.55, -0.55], [0.55, 0.55]], "max_steps": 1}
    raw = deflect(mesh, "hole", **options, repair="off")
    assert raw.quality[0].inverted > 10
    mended = deflect(mesh, "hole", **options, min_quality=0.25)
    assert mended.passed
    assert mended.quality[0].inverted == 0
    assert mended.quality[0].min > 0.2
    assert (mended.points[:, 2] == 0.0).all()


def test_a_mesh_is_plane_or_solid():
    points = np.eye(4)[:, :3]
    with pytest.raises(InputError, match="all points must have one z, but they lie between 0 and 1"):
        Mesh(points, (Cells("triangle", np.array([[0, 1, 2]])),), ())
    both = (Cells("tetra", np.array([[0, 1, 2, 3]])), Cells("triangle", np.array([[0, 1, 2]])))
    with pytest.raises(InputError, match="triangles and quads, or volume cells, not both"):
        Mesh(np.zeros((4, 3)), both, ())


def test_corners_and_ends_of_lines():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0.1, 0], [2, 2, 0]], dtype=float)
    lines = polygons_of((Cells("line", np.array([[0, 1], [2, 1], [2, 3]])),))
    assert sharp_edges(points, lines, 40.0).tolist() == [[2, 2]], "one line may run the other way"
    assert rim(lines).tolist() == [[0, 0], [3, 3]]


def test_one_layer_of_cells_between_two_planes():
    """What solvers without plane meshes take: edges along the span are as long as the box, or longer."""
    flat = ring_mesh()
    flat = flat.with_points(3.0 * flat.points)
    count, up = len(flat.points), np.array([0.0, 0.0, 1.0])
    quads = flat.cells[0].nodes
    sides = {patch.name: patch.faces[0].nodes for patch in flat.patches}
    patches = [Patch(name, (Cells("quad", np.hstack([n, n[:, ::-1] + count])),)) for name, n in sides.items()]
    patches += [Patch("back", (Cells("quad", quads[:, ::-1]),)), Patch("front", (Cells("quad", quads + count),))]
    cells = (Cells("hexahedron", np.hstack([quads, quads + count])),)
    mesh = Mesh(np.vstack([flat.points, flat.points + up]), cells, tuple(patches), name="layer")
    slide = {"front": "plane", "back": "plane"}
    result = deflect(mesh, "inner", hinge=[[0, 0, 0], [0, 0, 1]], angle=10, slide=slide, fixed="outer", margin=0.85)
    assert result.passed
    assert result.plan.boxes[0].sites.zero
    assert result.plan.boxes[0].sites.spacing < 0.5
    below, above = result.points[:count], result.points[count:]
    assert np.abs(above - below - up).max() < 0.05 * np.abs(result.displacement).max()
