"""Motions of surfaces: rigid, blended, from a table."""

import numpy as np
import pytest
from sdm_deflect.cases.own import Blended, Listed, OnPatches, Rotation, Table, TrailingEdge, deflect

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.surface.axis import Axis
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.surface import Surface

rng = np.random.default_rng(11)
HINGE = Rotation.about([0.7, 0.0, 0.0], [0.7, 1.0, 0.0])


@pytest.fixture(scope="module")
def flap(hybrid_wing, flap_names):
    return Surface.of(hybrid_wing.mesh, flap_names)


def test_a_positive_angle_is_right_handed_from_the_first_hinge_point_to_the_second():
    axis = Rotation.about([0, 0, 0], [0, 0, 2]).axis
    np.testing.assert_allclose(axis.rotated(np.array([[1.0, 0.0, 5.0]]), 90.0), [[0.0, 1.0, 5.0]], atol=1e-15)


def test_rates_are_derivatives_of_displacements(flap):
    table = Table(rng.random((40, 3)), rng.random((40, 3)))
    for motion in (HINGE, Blended(HINGE), table):
        h = 1e-4
        difference = (motion.displacement(flap, 0.7 + h) - motion.displacement(flap, 0.7 - h)) / (2.0 * h)
        np.testing.assert_allclose(motion.rate(flap, 0.7), difference, atol=1e-8)


def test_a_blended_flap_is_fixed_at_its_borders_and_turns_at_its_trailing_edge(flap):
    move = Blended(HINGE).displacement(flap, 10.0)
    shared = OnPatches().of(flap, HINGE.axis)
    assert np.array_equal(move[shared], np.zeros_like(move[shared]))
    edge = TrailingEdge().of(flap, HINGE.axis) & ~shared
    assert edge.sum() >= 4
    assert flap.points[edge, 0].min() == pytest.approx(1.0)
    np.testing.assert_allclose(move[edge], HINGE.displacement(flap, 10.0)[edge], atol=1e-15)


def test_a_wedge_between_hinge_and_trailing_edge_stays_plane():
    """With hinge and trailing edge as the only data the field is affine (appendix A)."""
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 3, 13), indexing="ij")
    top = np.column_stack([u.ravel(), v.ravel(), 0.1 * (1.0 - u.ravel())])
    points = np.vstack([top, top * [1, 1, -1]])
    nodes = np.arange(len(points))
    ends = {"wedge": nodes, "hinge": nodes[points[:, 0] == 0.0], "edge": nodes[points[:, 0] == 1.0]}
    from sdm_deflect.meshing.adapters import accepted

    surface = Surface.of(accepted((points, ends)).subject, ("wedge",))
    about = Rotation.about([0, 0, 0], [0, 1, 0])
    motion = Blended(about, OnPatches(("hinge",)), OnPatches(("edge",)))
    distinct = np.unique(points, axis=0, return_index=True)[1]
    surface = Surface(("wedge",), np.sort(distinct), surface.subject)
    moved = surface.points + motion.displacement(surface, 20.0)
    upper = moved[surface.points[:, 2] >= 0.0]
    normal = np.linalg.svd(upper - upper.mean(axis=0))[2][2]
    assert np.abs((upper - upper.mean(axis=0)) @ normal).max() < 1e-9


def test_node_sets_from_lists_and_files(flap, tmp_path):
    some = flap.nodes[::5]
    (tmp_path / "nodes.txt").write_text("\n".join(str(node) for node in some))
    for chosen in (Listed(some), Listed.read(tmp_path / "nodes.txt")):
        assert np.array_equal(flap.nodes[chosen.of(flap, HINGE.axis)], some)
    with pytest.raises(InputError, match="no list of node indices"):
        Listed.read(tmp_path / "nothing.txt")


def test_a_blended_motion_says_what_it_did_not_find(flap):
    with pytest.raises(InputError, match="flap_upper, flap_lower, flap_base: found no nodes that follow the motion"):
        Blended(HINGE, driven=Listed(np.array([0]))).displacement(flap, 1.0)


def test_a_table_of_an_affine_field_is_reproduced(hybrid_wing, tmp_path):
    """Bending given at points of another mesh, read from either kind of file."""
    mesh = hybrid_wing.mesh
    places = rng.uniform([0, 0, -0.1], [1, 1, 0.1], (60, 3))

    def field(p):
        return 0.02 * np.column_stack([0.0 * p[:, 0], 0.0 * p[:, 0], p[:, 1] + 0.3 * p[:, 0] * 0.0])

    np.savez(tmp_path / "table.npz", points=places, vectors=field(places))
    np.savetxt(tmp_path / "table.csv", np.hstack([places, field(places)]), delimiter=",", header="x,y,z,dx,dy,dz")
    for name in ("table.npz", "table.csv"):
        result = deflect(mesh, ("wing_*", "flap_*"), None, 1.0, motion=Table.read(tmp_path / name),
                         slide={"symmetry": "plane"})  # fmt: skip
        nodes = mesh.on("wing_upper", "flap_lower")
        np.testing.assert_allclose(result.points[nodes] - mesh.points[nodes], field(mesh.points[nodes]), atol=1e-9)
        assert result.report.passed


@pytest.mark.parametrize(
    ("content", "match"),
    [("x,y\n1,2\n", "no table of points"), ("x,y,z,dx,dy,dz\n0,0,0,1,1,1\n", "it needs at least 4"),
     ("x,y,z,dx,dy,dz\n0,0,zero,1,1,1\n", "no table of points")],
)  # fmt: skip
def test_a_table_that_is_none(content, match, tmp_path):
    (tmp_path / "bad.csv").write_text(content)
    with pytest.raises(InputError, match=match):
        Table.read(tmp_path / "bad.csv")


def test_two_surfaces_turn_by_their_own_angles(hybrid_wing):
    from sdm_deflect.deform.volume.boundary import Boundary
    from sdm_deflect.deform.volume.job import Job

    subject = hybrid_wing.mesh
    one, two = Moving(("flap_upper",), HINGE, 10.0), Moving(("flap_base",), HINGE, -5.0)
    boundary = Boundary.of(subject, Job((one, two)))
    with pytest.raises(InputError, match=r"\d+ nodes of flap_base also belong to another moving surface"):
        boundary.displacement(10.0)
    same = Boundary.of(subject, Job((one, Moving(("flap_base",), HINGE, 10.0))))
    every = Surface.of(subject, ("flap_upper", "flap_base"))
    np.testing.assert_allclose(same.displacement(4.0), HINGE.displacement(every, 4.0), atol=1e-16)


def test_axis_of_a_table_may_be_given():
    axis = Axis.through(np.zeros(3), np.ones(3))
    assert Table(rng.random((5, 3)), rng.random((5, 3)), axis).axis is axis
