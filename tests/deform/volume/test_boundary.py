"""Which nodes move, stay and slide, and what a node that is several of these does."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.surface.surface import OnPatches, Surface
from sdm_deflect.deform.volume.boundary import PrescribedMotion
from sdm_deflect.deform.volume.job import Job
from tests.deform.jobs import FLAP, WING, blended, job, turn

HINGE = Rotation.about([0.7, 0.0, 0.0], [0.7, 1.0, 0.0])


def test_two_surfaces_turn_by_their_own_angles(hybrid_wing):
    mesh = hybrid_wing.mesh
    one, two = Moving(("flap_upper",), HINGE, 10.0), Moving(("flap_base",), HINGE, -5.0)
    apart = PrescribedMotion.of(mesh, Job((one, two), force=True))
    with pytest.raises(InputError, match=r"\d+ nodes of flap_base also belong to another moving surface"):
        apart.displacement((10.0, -5.0))
    same = PrescribedMotion.of(mesh, Job((one, Moving(("flap_base",), HINGE, 10.0)), force=True))
    every = Surface.of(mesh, ("flap_upper", "flap_base"))
    np.testing.assert_allclose(same.displacement((4.0, 4.0)), HINGE.law(every).displacement(4.0), atol=1e-16)


def test_nodes_shared_by_two_moving_patches_move_once(hybrid_wing):
    w = hybrid_wing
    both = np.intersect1d(w.mesh.on("flap_upper"), w.mesh.on("flap_base"))
    result = turn(w.mesh, WING, w.hinge, slide={"symmetry": "plane"})
    expected = Rotation.about(*w.hinge).axis.rotated(w.mesh.points[both], 10.0)
    assert len(both)
    np.testing.assert_allclose(result.points[both], expected, atol=1e-14)


def test_a_rigid_surface_cannot_share_moving_nodes_with_a_fixed_one(hybrid_wing):
    w = hybrid_wing
    with pytest.raises(InputError, match=r"\d+ nodes shared by the moving surface and wing_\w+, which is fixed"):
        turn(w.mesh, FLAP, w.hinge, fixed=("wing_*",), slide={"symmetry": "plane"})


def test_a_patch_has_one_part(block):
    for given, parts in (
        ({"fixed": ("body",)}, "body cannot be moving and fixed"),
        ({"slide": {"body": "plane"}}, "body cannot be moving and sliding"),
        ({"fixed": ("x-",), "slide": {"x-": "plane"}}, "x- cannot be fixed and sliding"),
    ):
        with pytest.raises(InputError, match=f"mesh: patch {parts} at once"):
            PrescribedMotion.of(block, job(("body",), **given))
    twice = Job((Moving(("body",), HINGE, 1.0), Moving(("bod*",), HINGE, 1.0)))
    with pytest.raises(InputError, match="mesh: patch body belongs to two moving surfaces"):
        PrescribedMotion.of(block, twice)


def test_a_wildcard_in_fixed_leaves_out_what_has_another_part(block):
    assert PrescribedMotion.of(block, job(("body",), fixed=("*",))).fixed == ("x-", "x+", "y-", "y+", "z-", "z+")
    some = PrescribedMotion.of(block, job(("body",), fixed=("*",), slide={"x-": "plane"}))
    assert some.fixed == ("x+", "y-", "y+", "z-", "z+")
    assert some.declared_patches == ("body", "x+", "y-", "y+", "z-", "z+", "x-")


@pytest.mark.parametrize("given", [{"fixed": ("boddy",)}, {"slide": {"boddy": "plane"}}])
def test_an_unknown_patch_with_the_nearest_names(block, given):
    with pytest.raises(InputError, match=r"'boddy' is no patch; did you mean body\?"):
        PrescribedMotion.of(block, job(("body",), **given))


def test_an_unknown_surface_like_none(block):
    with pytest.raises(InputError, match="the patches are body, x-, x"):
        PrescribedMotion.of(block, job(("flaperon",)))


def test_nodes_shared_with_fixed_and_sliding_patches_stay_and_slide_to_the_bit(inboard_wing):
    w = inboard_wing
    boundary = PrescribedMotion.of(w.mesh, job(FLAP, w.hinge, **blended(w)))
    move = boundary.displacement((10.0,))
    shared = np.isin(boundary.nodes, w.mesh.on("wing_upper", "wing_lower", "wing_base"))
    assert shared.any()
    assert np.array_equal(boundary.shared_with_fixed, shared)
    assert np.array_equal(move[shared], np.zeros((int(shared.sum()), 3)))
    on_plane = np.isin(boundary.nodes, w.mesh.on("symmetry"))
    assert np.array_equal(move[on_plane, 1], np.zeros(int(on_plane.sum())))
    assert np.abs(move[on_plane]).max() > 0.04


def test_a_displacement_that_is_at_hand_is_not_computed_again_and_cannot_be_written_into(inboard_wing):
    w = inboard_wing
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    boundary = PrescribedMotion.of(w.mesh, job(FLAP, w.hinge, **blended(w, motion=motion)))
    first = boundary.displacement((10.0,))
    known = boundary.knowing([(10.0,)])
    assert np.array_equal(known.displacement((10.0,)), first)
    assert known.displacement((10.0,)) is known.displacement((10.0,))
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1.0
