"""Wings with layers, turned so far that cells would invert: all are mended, and the repair moves no inner layer."""

import numpy as np
import pytest

from sdm_deflect.cases.api import deflect

# Largest relative change of the first layer's height.
HEIGHT = 0.01


def shares(result):
    """Least quality of each type as a share of that before."""
    pairs = zip(result.deflection.plan.before, result.deflection.quality, strict=True)
    return {new.shape: new.min / old.min for old, new in pairs}


def flap(w, angle, **more):
    options = {"motion": "blended", "fixed": "wing_*", "slide": "symmetry:plane", "min_quality": 0.0, **more}
    return deflect(w.mesh, "flap_*", w.hinge, angle, **options)


# Below the least qualities that a repair reaches while inner layers stay: .71, .35, .46 and .12 of those before.
@pytest.mark.parametrize(("angle", "least"), [(20.0, 0.6), (30.0, 0.3), (-30.0, 0.4), (40.0, 0.1)])
def test_a_flap_without_a_gap(hybrid_wing, angle, least):
    bare = flap(hybrid_wing, angle, repair="off", max_steps=1)
    assert bare.deflection.inverted > 5
    result = flap(hybrid_wing, angle, repair="auto", max_steps=1, min_quality=least)
    assert result.passed
    before, after = (next(c.value for c in one.checks if c.name == "layer_height") for one in (bare, result))
    assert 0.1 < after == pytest.approx(before, rel=1e-9), "the repair has left the measured layers alone"
    assert result.deflection.inverted == 0
    assert min(shares(result).values()) > least
    assert len(result.deflection.boxes[0].repaired.moved) > 0


def test_the_repair_moves_outer_layers_within_bounds_and_inner_ones_beside_spoiled_cells_alone(hybrid_wing):
    w = hybrid_wing
    bare, result = (flap(w, 30.0, repair=mode, max_steps=1) for mode in ("off", "auto"))
    heights = [np.linalg.norm(np.diff(one.points[w.columns], axis=1), axis=2) for one in (bare, result)]
    before = np.linalg.norm(np.diff(w.mesh.points[w.columns], axis=1), axis=2)
    plan = result.deflection.plan.boxes[0]
    rigid = np.isin(w.columns[:, 1:], plan.freedom(bare.points).columns.kept)
    assert rigid[:, 0].mean() > 0.5
    np.testing.assert_allclose(heights[1][rigid], heights[0][rigid], rtol=1e-9)
    low, high = np.minimum(0.5 * before, heights[0]), np.maximum(2.0 * before, heights[0])
    assert (heights[1] > low - 1e-12).all()
    assert (heights[1] < high + 1e-12).all()
    on = w.mesh.on(*w.mesh.names)
    walls = np.setdiff1d(on, w.mesh.on("symmetry", "far_field"))
    assert np.array_equal(bare.points[walls], result.points[walls])


@pytest.mark.parametrize("x", [0.25, 0.7])
def test_a_whole_wing_turns_by_sixty_degrees(hybrid_wing, x):
    hinge, options = [[x, 0, 0], [x, 1, 0]], {"slide": "symmetry:plane", "max_steps": 1}
    bare = deflect(hybrid_wing.mesh, ["wing_*", "flap_*"], hinge, 60.0, repair="off", **options)
    assert not bare.passed or min(shares(bare).values()) < 0.2
    result = deflect(hybrid_wing.mesh, ["wing_*", "flap_*"], hinge, 60.0, repair="auto", **options)
    assert result.passed, result.checks
    assert result.deflection.inverted == 0
    assert min(shares(result).values()) > 0.5
    heights = next(check for check in result.checks if check.name == "layer_height")
    assert heights.value < HEIGHT
    symmetry = hybrid_wing.mesh.on("symmetry")
    assert np.array_equal(result.points[symmetry, 1], hybrid_wing.mesh.points[symmetry, 1])
