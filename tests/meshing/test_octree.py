import numpy as np

from sdm_deflect.meshing.octree import CLEARANCE, COARSENESS, background, leaves, seeds
from sdm_deflect.meshing.quality import signed_volumes
from sdm_deflect.meshing.sizing import size_field

LOW, HIGH = np.array([-1.0, -1.0, -1.0]), np.array([3.0, 1.0, 1.0])
FIELD = size_field(np.zeros((1, 3)), np.array([0.1]), 0.4, 1.0)


def test_leaves_tile_the_box_and_are_not_to_be_split() -> None:
    corners, edges = leaves(LOW, HIGH, lambda centres, edge: edge > FIELD(centres))
    assert np.isclose((edges**3).sum(), 16.0)
    assert (edges <= FIELD(corners + 0.5 * edges[:, None])).all()
    assert edges.min() < 0.13
    assert edges.max() > 0.4


def test_the_background_covers_the_box_and_carries_the_field() -> None:
    points, tets, lengths = background(FIELD, LOW, HIGH)
    volumes = signed_volumes(points, tets)
    assert (volumes > 0.0).all()
    assert np.isclose(volumes.sum(), 16.0, rtol=0.02)
    assert np.array_equal(lengths, FIELD(points))
    longest = np.linalg.norm(points[tets[:, 0]] - points[tets[:, 1]], axis=1)
    assert (longest < 4.0 * COARSENESS * lengths[tets[:, 0]]).all()


def test_seeds_are_spaced_like_the_field_and_keep_their_distance() -> None:
    surface = 0.05 * np.random.default_rng(0).standard_normal((100, 3))
    cloud = seeds(FIELD, LOW, HIGH, surface)
    again = seeds(FIELD, LOW, HIGH, surface)
    assert np.array_equal(cloud, again)
    away = np.linalg.norm(cloud[:, None] - surface, axis=2).min(axis=1)
    assert (away > CLEARANCE * FIELD(cloud) - 1e-12).all()
    assert ((cloud > LOW) & (cloud < HIGH)).all()
    apart = np.linalg.norm(cloud[:, None] - cloud, axis=2) + np.diag(np.full(len(cloud), np.inf))
    ratio = apart.min(axis=1) / FIELD(cloud)
    assert ratio.min() > 0.3
    assert ratio.max() < 2.5
