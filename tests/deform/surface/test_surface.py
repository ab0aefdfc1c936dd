"""Surfaces by their patches, and the node sets that are found on them."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface.surface import Listed, OnPatches, Surface, TrailingEdge
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

AXIS = Axis.through(np.array([0.7, 0.0, 0.0]), np.array([0.7, 1.0, 0.0]))


@pytest.fixture(scope="module")
def flap(hybrid_wing, flap_names):
    return Surface.of(hybrid_wing.mesh, flap_names)


def test_a_surface_has_every_node_of_its_patches_once(flap, hybrid_wing, flap_names):
    parts = [hybrid_wing.mesh.patch(name).nodes for name in flap_names]
    assert np.array_equal(flap.nodes, np.unique(np.concatenate(parts)))
    assert len(flap.nodes) < sum(map(len, parts))
    assert np.array_equal(flap.points, hybrid_wing.mesh.points[flap.nodes])
    assert set(flap.neighbours) == {"wing_upper", "wing_lower", "wing_base"}


def test_a_surface_needs_nodes(block):
    empty = Mesh(block.points, (), (*block.patches, Patch("none", ())), name="block")
    with pytest.raises(InputError, match="block: none has no nodes"):
        Surface.of(empty, ("none",))
    with pytest.raises(InputError, match=r"'boddy' is no patch; did you mean body\?"):
        Surface.of(block, ("boddy",))


def test_nodes_on_patches_are_shared_ones(flap, hybrid_wing):
    mesh = hybrid_wing.mesh
    upper = OnPatches(("wing_upper",)).of(flap, AXIS)
    assert np.array_equal(flap.nodes[upper], np.intersect1d(flap.nodes, mesh.on("wing_upper")))
    every = OnPatches().of(flap, AXIS)
    assert np.array_equal(every, OnPatches(("wing_upper", "wing_lower", "wing_base")).of(flap, AXIS))
    assert not every.all()


@pytest.mark.parametrize("wildcard", ["*", "*_upper", "???*"])
def test_a_wildcard_does_not_stand_for_the_own_patches_of_the_surface(wildcard, flap):
    """Else `*` would hold the whole surface, and nothing were left to move."""
    own = [name for name in flap.mesh.names if name not in flap.patches]
    plain = OnPatches(tuple(name for name in own if wildcard != "*_upper" or name.endswith("_upper")))
    assert np.array_equal(OnPatches((wildcard,)).of(flap, AXIS), plain.of(flap, AXIS))
    assert not OnPatches((wildcard,)).of(flap, AXIS).all()


def test_an_own_patch_that_is_named_in_full_is_meant(flap, hybrid_wing):
    base = OnPatches(("flap_base",)).of(flap, AXIS)
    assert np.array_equal(flap.nodes[base], hybrid_wing.mesh.on("flap_base"))
    both = OnPatches(("flap_base", "*_upper")).of(flap, AXIS)
    assert np.array_equal(both, base | OnPatches(("wing_upper",)).of(flap, AXIS))


def test_a_node_set_of_unknown_patches_names_them(flap):
    with pytest.raises(InputError, match=r"a node set 'wing_uper' is no patch; did you mean .*wing_upper"):
        OnPatches(("wing_uper",)).of(flap, AXIS)


def test_the_trailing_edge_is_found_where_faces_meet_sharply_far_from_the_hinge(flap):
    edge = TrailingEdge().of(flap, AXIS)
    assert edge.sum() >= 4
    np.testing.assert_allclose(flap.points[edge, 0], 1.0, atol=1e-9)
    assert not TrailingEdge(170.0).of(flap, AXIS).any()


def test_node_sets_from_lists_and_files(flap, tmp_path):
    some = flap.nodes[::5]
    (tmp_path / "nodes.txt").write_text("\n".join(str(node) for node in some))
    for chosen in (Listed(some), Listed.read(tmp_path / "nodes.txt")):
        assert np.array_equal(flap.nodes[chosen.of(flap, AXIS)], some)
    with pytest.raises(InputError, match="no list of node indices"):
        Listed.read(tmp_path / "nothing.txt")
