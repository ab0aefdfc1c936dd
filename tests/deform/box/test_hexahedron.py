import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from sdm_deflect.deform.box.face_sites import border_sites, inner_sites, polygon_sites
from sdm_deflect.deform.box.hexahedron import FACES, Hexahedron, box

UNIT = box(np.zeros(3), np.ones(3))
# A frustum: planar faces, none of the side faces parallel to another.
FRUSTUM = UNIT.corners.copy()
FRUSTUM[4:, :2] = 0.3 + 0.5 * FRUSTUM[4:, :2]


def _sheared(seed):
    """The frustum under a random affine map that keeps its orientation."""
    a = np.random.default_rng(seed).normal(size=(3, 3))
    if np.linalg.det(a) < 0.0:
        a[0] *= -1.0
    return Hexahedron(FRUSTUM @ a.T + 5.0)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_contains_equals_the_half_spaces_of_the_convex_hull(seed):
    hexahedron = _sheared(seed)
    low, high = hexahedron.corners.min(axis=0), hexahedron.corners.max(axis=0)
    x = np.random.default_rng(seed + 1).uniform(1.2 * low - 0.2 * high, 1.2 * high - 0.2 * low, (2_000, 3))
    planes = ConvexHull(hexahedron.corners).equations
    height = (x @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    clear = np.abs(height) > 1e-9
    assert np.array_equal(hexahedron.contains(x)[clear], (height <= 0.0)[clear])


def test_the_tolerance_moves_the_faces():
    x = np.array([[1.01, 0.5, 0.5], [0.99, 0.5, 0.5], [0.5, 0.5, 0.5]])
    assert UNIT.contains(x).tolist() == [False, True, True]
    assert UNIT.contains(x, 0.02).tolist() == [True, True, True]
    assert UNIT.contains(x, -0.02).tolist() == [False, False, True]


def test_face_names_say_where_the_face_is():
    for name in FACES:
        axis, side = "xyz".index(name[0]), float(name[1] == "+")
        assert (UNIT.face(name)[:, axis] == side).all()
    with pytest.raises(ValueError, match="no face 'top'"):
        UNIT.face("top")


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.4))
def test_face_sites_are_near_equidistant_on_the_faces_and_distinct(seed, relative):
    hexahedron = _sheared(seed)
    edges = [np.ptp(hexahedron.face(f)[[0, 1]], axis=0) for f in FACES]
    spacing = relative * float(np.mean(np.linalg.norm(edges, axis=1)))
    sites = hexahedron.face_sites(spacing)
    assert hexahedron.contains(sites, 1e-9 * spacing + 1e-12).all()
    assert not hexahedron.contains(sites, -1e-9 * spacing - 1e-12).any()
    gaps = cdist(sites, sites)
    assert gaps.max() > 0.0
    corners = cdist(hexahedron.corners, sites).min(axis=1)
    assert corners.max() < 1e-12
    # No spot of a face is far from all sites.
    weights = np.random.default_rng(seed).dirichlet(np.ones(4), 200)
    spots = np.vstack([weights @ hexahedron.face(f) for f in FACES])
    assert cdist(spots, sites).min(axis=1).max() < 1.3 * spacing


def test_sites_of_a_box_are_a_regular_grid():
    sites = UNIT.face_sites(0.25)
    assert len(sites) == 6 * 9 + 12 * 3 + 8
    gaps = cdist(sites, sites) + 9.0 * np.eye(len(sites))
    np.testing.assert_allclose(gaps.min(axis=1), 0.25)


def test_skipped_faces_have_no_sites_of_their_own():
    sites = UNIT.face_sites(0.25, skip=frozenset({"y-"}))
    assert len(sites) == 5 * 9 + 12 * 3 + 8
    only_edges = sites[sites[:, 1] == 0.0]
    assert ((only_edges[:, [0, 2]] == 0.0) | (only_edges[:, [0, 2]] == 1.0)).any(axis=1).all()
    assert len(UNIT.sites_on("y-", 0.25)) == 25
    assert not len(UNIT.face_sites(0.25, skip=frozenset(FACES)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_inner_sites_keep_half_the_spacing_from_the_edges(seed):
    hexahedron = _sheared(seed)
    for name in FACES:
        polygon = hexahedron.face(name)
        spacing = 0.15 * float(np.linalg.norm(polygon[1] - polygon[0]))
        inner, border = inner_sites(polygon, spacing), border_sites(polygon, 0.1 * spacing)
        assert not len(inner) or cdist(inner, border).min() > 0.49 * spacing


def test_section_of_a_box():
    polygon = UNIT.section(np.array([0.0, 0.3, 0.0]), np.array([0.0, -2.0, 0.0]))
    assert len(polygon) == 4
    np.testing.assert_allclose(polygon[:, 1], 0.3)
    np.testing.assert_allclose(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1), 1.0)
    assert len(UNIT.section(np.full(3, 0.5), np.ones(3))) == 6
    assert len(UNIT.section(np.zeros(3), np.array([1.0, 0, 0]))) == 4  # a face
    for point in (np.full(3, 2.0), np.zeros(3)):
        with pytest.raises(ValueError, match="does not cut"):
            UNIT.section(point, np.ones(3))


def test_sites_of_a_section_lie_in_the_plane_and_inside():
    hexahedron = _sheared(3)
    point, normal = hexahedron.corners.mean(axis=0), np.array([0.3, 1.0, -0.2])
    sites = polygon_sites(hexahedron.section(point, normal), 0.1)
    np.testing.assert_allclose((sites - point) @ normal, 0.0, atol=1e-12)
    assert hexahedron.contains(sites, 1e-12).all()


@pytest.mark.parametrize(
    ("corner", "to", "match"),
    [
        (3, (1.0, 0.0, 0.0), "corners 1 and 3 of the hexahedron coincide"),
        (7, (1.0, 1.0, 1.2), "not planar"),
        (7, (0.2, 0.2, 0.2), r"not planar|not convex"),
        (7, (np.nan, 0.0, 0.0), "finite"),
    ],
)
def test_unusable_corners_are_named(corner, to, match):
    corners = UNIT.corners.copy()
    corners[corner] = to
    with pytest.raises(ValueError, match=match):
        Hexahedron(corners)


def test_wrong_order_and_degenerate_faces():
    with pytest.raises(ValueError, match="not convex, or its corners are not in the order"):
        Hexahedron(UNIT.corners * [-1.0, 1.0, 1.0])
    folded = UNIT.corners.copy()
    folded[[0, 4, 6]] = [[0, 0, 0], [0, 0, 1], [0, 0, 2]]
    with pytest.raises(ValueError, match=r"lie on one line|not planar"):
        Hexahedron(folded)


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_spacing_must_be_a_length(spacing):
    with pytest.raises(ValueError, match="spacing"):
        UNIT.face_sites(spacing)
    with pytest.raises(ValueError, match="polygon"):
        polygon_sites(UNIT.corners[:2], 0.1)
