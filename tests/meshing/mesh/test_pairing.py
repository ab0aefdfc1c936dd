"""Periodic pairs by geometry: every node has its image under the motion that was found, or the pair is refused."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Periodic
from sdm_deflect.meshing.mesh.images import (
    PeriodicPatches,
    RigidMotion,
    about,
    fit_motion,
    match_nodes,
    pair_patches,
    rotation_between,
    translation_between,
)
from sdm_deflect.meshing.mesh.mesh import Mesh

RNG = np.random.default_rng(24)
AXES = [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((0.3, -2.0, 1.0), (0.2, 1.0, -0.4))]
ROUNDING = 1e-14


def two_sides(motion: RigidMotion, flat: bool = False) -> tuple[FloatArray, tuple[Patch, Patch], IntArray]:
    """Points of which some are images of others in another order; the two patches, and the pairs as they are."""
    here = RNG.uniform(0.5, 2.0, (40, 3)) * [1, 1, not flat]
    order = RNG.permutation(40)
    points = np.concatenate([RNG.uniform(-9, -8, (5, 3)), here, (here @ motion[0].T + motion[1])[order]])
    pairs = np.column_stack([np.arange(5, 45), 45 + np.argsort(order)])
    return points, (Patch("left", (), pairs[:, 0]), Patch("right", (), pairs[:, 1])), pairs


@pytest.mark.parametrize("where", AXES)
def test_rotation_is_found_from_the_axis_alone_and_fitted_to_rounding(where: tuple[FloatArray, FloatArray]) -> None:
    axis = Axis(*map(np.asarray, where))
    points, patches, pairs = two_sides(about(axis, 37.0))
    motion = rotation_between(points[patches[0].nodes], points[patches[1].nodes], axis)
    np.testing.assert_allclose(motion[0], axis.matrix(37.0), atol=ROUNDING)
    assert np.array_equal(match_nodes(points, patches, motion), pairs)
    pair = fit_motion(points, "turn", ("left", "right"), pairs)
    assert np.abs(pair.image(points[pairs[:, 0]]) - points[pairs[:, 1]]).max() < ROUNDING
    np.testing.assert_allclose(pair.rotation, axis.matrix(37.0), atol=ROUNDING)


def test_translation_is_found_and_has_no_rotation_at_all() -> None:
    points, patches, pairs = two_sides((np.eye(3), np.array([0.0, 3.0, 0.0])))
    motion = translation_between(points[patches[0].nodes], points[patches[1].nodes])
    assert np.array_equal(match_nodes(points, patches, motion), pairs)
    assert np.array_equal(fit_motion(points, "shift", ("left", "right"), pairs).rotation, np.eye(3))


def split_grid(motion: RigidMotion) -> tuple[FloatArray, tuple[Patch, Patch], dict[int, int]]:
    """Two sides of quadrilaterals and triangles, each cut along a line: nodes of both halves are at the same places.

    The second side is in another order; each of its faces begins at another corner, and goes around the other way.
    """
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4), indexing="ij"))
    half = np.column_stack([0.7 * u, 1.0 + v, 0.1 * u * v])
    quads = np.array([[4 * i + j, 4 * i + j + 1, 4 * i + j + 5, 4 * i + j + 4] for i in range(4) for j in range(3)])
    side = np.concatenate([half, half * [-1.0, 1.0, 1.0]])  # they share the line u = 0
    faces = [*quads.tolist(), *(quads + 20)[:, ::-1].tolist()]
    faces = [part for face in faces for part in ([face[:3], [face[0], *face[2:]]] if face[0] % 3 else [face])]
    order = RNG.permutation(40)
    points = np.concatenate([side, np.empty_like(side)])
    points[40 + order] = side @ motion[0].T + motion[1]
    others = [np.roll(40 + order[face[::-1]], RNG.integers(4)).tolist() for face in faces]
    sides = []
    for name, own in (("left", faces), ("right", [others[i] for i in RNG.permutation(len(others))])):
        blocks = [
            Cells(shape, np.array([f for f in own if len(f) == n])) for shape, n in (("quad", 4), ("triangle", 3))
        ]
        sides.append(Patch(name, tuple(blocks)))
    return points, (sides[0], sides[1]), {node: 40 + int(order[node]) for node in range(40)}


@pytest.mark.parametrize("degrees", [0.0, 37.0])
def test_nodes_at_one_place_have_images_of_their_own(degrees: float) -> None:
    """A sliding interface, or a baffle, ends on both sides of a pair."""
    motion = (np.eye(3), np.array([0.0, 0.0, 3.0])) if not degrees else about(Axis(np.zeros(3), np.eye(3)[0]), degrees)
    points, patches, expected = split_grid(motion)
    assert len(np.unique(points[:40], axis=0)) == 36
    assert dict(match_nodes(points, patches, motion).tolist()) == expected
    (pair,) = pair_patches(Mesh(points, (), patches), [PeriodicPatches("left", "right")]).periodic
    assert dict(pair.nodes.tolist()) == expected


def test_faces_that_differ_are_matched_by_their_nodes() -> None:
    motion = np.eye(3), np.array([0.0, 0.0, 3.0])
    quad, shift = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]), motion[1]
    points = np.concatenate([quad, quad + shift])
    whole = Patch("left", (Cells("quad", np.array([[0, 1, 2, 3]])),))
    halves = Patch("right", (Cells("triangle", np.array([[4, 5, 6], [4, 6, 7]])),))
    assert np.array_equal(match_nodes(points, (whole, halves), motion), np.arange(8).reshape(2, 4).T)


def test_sides_of_a_plane_mesh_turn_about_z_and_stay_in_their_plane() -> None:
    line = np.linspace([1.0, 0.0, 0.0], [2.0, 0.0, 0.0], 9)
    axis = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    points = np.concatenate([line, axis.rotated(line, 90.0)])
    pair = fit_motion(points, "turn", ("a", "b"), np.arange(18).reshape(2, 9).T)
    assert np.array_equal(pair.image(line)[:, 2], line[:, 2])
    assert np.abs(pair.image(line) - points[9:]).max() < ROUNDING


def test_node_on_the_axis_is_its_own_image() -> None:
    axis = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 1], [0, 1, 1], [0, 0, 1]])
    patches = (Patch("a", (), np.array([0, 1, 3, 5])), Patch("b", (), np.array([0, 2, 4, 5])))
    assert match_nodes(points, patches, about(axis, 90.0)).tolist() == [[0, 0], [1, 2], [3, 4], [5, 5]]


@pytest.mark.parametrize("digits", [6, 9])
def test_few_digits_of_a_file_are_allowed_for(digits: int) -> None:
    points, patches, pairs = two_sides(about(Axis(np.zeros(3), np.array([1.0, 0, 0])), -20.0))
    points = np.array([[float(f"{x:.{digits}g}") for x in row] for row in points])
    motion = rotation_between(
        points[patches[0].nodes], points[patches[1].nodes], Axis(np.zeros(3), np.array([1.0, 0, 0]))
    )
    assert np.array_equal(match_nodes(points, patches, motion), pairs)
    assert np.array_equal(fit_motion(points, "p", ("left", "right"), pairs).nodes, pairs)


def test_what_does_not_match_is_refused_in_a_sentence() -> None:
    still = (np.eye(3), np.array([0.0, 3.0, 0.0]))
    points, patches, pairs = two_sides(still)
    fewer = Patch("few", (), pairs[1:, 1])
    with pytest.raises(InputError, match="have 40 and 39 nodes"):
        match_nodes(points, (patches[0], fewer), still)
    moved = points.copy()
    moved[pairs[7, 1]] += 0.01
    with pytest.raises(InputError, match=r"the node at .* has no image within .*check the rotation or the translation"):
        match_nodes(moved, patches, still)
    with pytest.raises(InputError, match=r"no rigid motion leads to all images, the best one is 0\.0"):
        fit_motion(moved, "p", ("left", "right"), pairs)
    moved[pairs[7, 1]] = 1e200
    with pytest.raises(InputError, match=r"its nodes lie at up to 1e\+200; 1e\+100 is the limit"):
        fit_motion(moved, "p", ("left", "right"), pairs)
    with pytest.raises(InputError, match="a node has two images"):
        fit_motion(points, "p", ("left", "right"), pairs[[0, 0]])
    points[pairs[3, 0]] = points[pairs[4, 0]]
    with pytest.raises(InputError, match="two nodes have the same image"):
        match_nodes(points, patches, still, allowed=9.0)
    with pytest.raises(InputError, match="centre lies on the axis"):
        rotation_between(*[np.array([[1.0, 0, 0], [-1, 0, 0]])] * 2, Axis(np.zeros(3), np.eye(3)[1]))


@pytest.mark.parametrize(
    ("motion", "wanted"),
    [
        ((np.eye(3), np.array([0.0, 3.0, 0.0])), {}),
        (about(Axis(np.zeros(3), np.array([0.0, 1.0, 0.0])), 40.0), {}),
        (about(Axis(np.array([0.0, 5.0, 0.0]), np.array([1.0, 0.0, 1.0])), 40.0), {"axis": True}),
        ((np.eye(3), np.array([4.0, 4.0, 0.0])), {"translation": np.array([4.0, 4.0, 0.0])}),
    ],
)
def test_patches_that_a_user_names_become_a_pair(motion: RigidMotion, wanted: dict[str, object]) -> None:
    points, patches, pairs = two_sides(motion)
    if "axis" in wanted:
        wanted = {"axis": Axis(np.array([0.0, 5.0, 0.0]), np.array([1.0, 0.0, 1.0]))}
    mesh = Mesh(points, (), patches, periodic=(Periodic("old", ("right", "left"), pairs[:3, ::-1], *motion),))
    (pair,) = pair_patches(mesh, [PeriodicPatches("left", "right", **wanted)]).periodic  # type: ignore[arg-type]
    assert np.array_equal(pair.nodes, pairs)
    np.testing.assert_allclose(pair.rotation, motion[0], atol=ROUNDING)
    np.testing.assert_allclose(pair.shift, motion[1], atol=ROUNDING)


def test_patches_that_no_motion_joins_are_refused_with_what_to_give() -> None:
    points, patches, _ = two_sides(about(Axis(np.array([0.0, 5.0, 0.0]), np.array([1.0, 0.0, 1.0])), 40.0))
    mesh = Mesh(points, (), patches)
    with pytest.raises(InputError, match=r"no rotation about x, y or z .* give the axis or the translation"):
        pair_patches(mesh, [PeriodicPatches("left", "right")])
    with pytest.raises(InputError, match="periodic 'rihgt' is no patch; did you mean right"):
        pair_patches(mesh, [PeriodicPatches("left", "rihgt")])
    with pytest.raises(InputError, match="stands for left; name two patches"):
        pair_patches(mesh, [PeriodicPatches("left", "left")])
