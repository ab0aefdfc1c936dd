"""Where displacements are known: every node once, zero sites apart from them, and not too many of either."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.around.near_wall import RIGID
from sdm_deflect.deform.box import hexahedron
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.confined import zero_sites
from sdm_deflect.deform.rbf.fitting import Fitting
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.volume import sites as places
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.edges import median_edge
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.jobs import FLAP, WING, blended, box_plan, job, turn
from tests.deform.paired import airfoil

TIGHT = [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]


@pytest.fixture(scope="module")
def plan(inboard_wing):
    w = inboard_wing
    return box_plan(w.mesh, job(FLAP, w.hinge, **blended(w)))


def test_known_nodes_are_moving_fixed_and_sliding_ones_each_once(plan, inboard_wing):
    sites, mesh, inside = plan.sites, inboard_wing.mesh, plan.region.inside
    assert np.array_equal(sites.moving, mesh.on("flap_upper", "flap_lower", "flap_base"))
    wing = mesh.on("wing_upper", "wing_lower", "wing_base", "wing_tip")
    assert np.array_equal(sites.fixed, np.setdiff1d(np.intersect1d(wing, inside), sites.moving))
    others = np.union1d(sites.moving, sites.fixed)
    assert np.array_equal(sites.slid, np.setdiff1d(np.intersect1d(mesh.on("symmetry"), inside), others))
    assert len(np.unique(sites.known)) == len(sites.known)


def test_lengths_follow_from_the_edges_of_the_surface(plan, inboard_wing):
    mesh, sites = inboard_wing.mesh, plan.sites
    assert sites.edge == median_edge(mesh.points, mesh.faces_of(("flap_upper", "flap_lower", "flap_base")))
    assert sites.tolerance == 0.01 * sites.edge
    assert sites.spacing == 1.75 * sites.edge


@pytest.mark.parametrize(("outwards", "height"), [(40, 0.0125), (8, 0.0625)])
def test_nodes_follow_over_one_edge_or_as_far_as_thick_layers_need(outwards, height):
    """The rigid fifth of the reach contains the first layer."""
    mesh, hinge = airfoil(2, 0.2, outwards=outwards), [[0.7, 0.0, 0.0], [0.7, 0.2, 0.0]]
    motion = Blended(Rotation.about(*hinge), held=OnPatches(("wing",)))
    plan = box_plan(mesh, job(("flap",), motion=motion, fixed=("wing",), slide={"side0": "plane", "side1": "plane"}))
    wall = plan.sites.edges[(plan.sites.edges < len(plan.sites.moving) + len(plan.sites.fixed)).all(axis=1)]
    ends = mesh.points[plan.sites.known[wall]]
    edge = min(plan.sites.edge, float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))))
    first = plan.layers.first_height(mesh.points, plan.moved_walls)
    assert plan.reach == pytest.approx(max(edge, first / RIGID))


@pytest.mark.parametrize(("given", "spacing"), [({"spacing": 0.3}, 0.3), ({"spacing_edges": 1.0}, 0.5)])
def test_spacing_may_be_given_in_lengths_or_in_edges(given, spacing, block):
    sites = box_plan(block, job(("body",), box=TIGHT, fitting=Fitting(**given, tolerance=0.02))).sites
    assert sites.spacing == pytest.approx(spacing)
    assert sites.tolerance == 0.02


def test_zero_sites_stand_on_the_box_apart_from_nodes_and_from_each_other(plan, inboard_wing):
    (zero,), spacing = plan.sites.zero, plan.sites.spacing
    hexahedron = plan.region.hexahedron
    assert not zero.values.any()
    assert zero.components == (0, 1, 2)
    assert hexahedron.contains(zero.points, 1e-9).all()
    assert not hexahedron.contains(zero.points, -1e-9).any()
    assert cdist(zero.points, inboard_wing.mesh.points[plan.sites.known]).min() >= 0.5 * spacing
    assert (cdist(zero.points, zero.points) + 9.0 * np.eye(len(zero))).min() > 0.3 * spacing
    assert [plan.sites.zero_sites(c) for c in range(3)] == [len(zero)] * 3


def test_no_zero_site_is_behind_a_plane_that_bounds_the_mesh(plan):
    """The box reaches beyond the symmetry plane y = 0, the mesh does not."""
    assert plan.region.hexahedron.corners[:, 1].min() < -0.01
    (zero,) = plan.sites.zero
    assert zero.points[:, 1].min() >= -1e-9


def test_zero_sites_are_no_more_than_a_solve_takes(monkeypatch, block):
    fine = Fitting(spacing_edges=0.1)
    many = box_plan(block, job(("body",), box=TIGHT, fitting=fine)).sites
    monkeypatch.setattr(hexahedron, "MOST_SITES", 500)
    few = box_plan(block, job(("body",), box=TIGHT, fitting=fine)).sites
    assert many.zero_sites(0) > 2000
    assert 400 < few.zero_sites(0) < 600
    assert few.spacing == pytest.approx(np.sqrt(6.0 * 2.4**2 / 500))


def test_a_box_like_a_needle_has_no_more_sites(block):
    needle = [[-1.2, -1.2, -1e9], [1.2, 1.2, 1.2]]
    points = block.points[block.on("body")]
    alone = Mesh(points, (), (Patch("body", (), np.arange(len(points))),))
    assert box_plan(alone, job(("body",), box=needle)).sites.zero_sites(0) < 100_000


def test_large_fixed_patches_are_thinned_and_verified_as_a_whole(monkeypatch, inboard_wing):
    monkeypatch.setattr(places, "MOST_FIXED", 30)
    w = inboard_wing
    result = turn(w.mesh, FLAP, w.hinge, **blended(w))
    sites, before = result.plan.boxes[0].sites, w.mesh.points
    assert len(sites.fixed) > 60
    assert 15 <= len(sites.sampled) <= 30
    assert 15 <= len(sites.sampled_sliding) <= 30
    assert np.array_equal(result.points[sites.fixed], before[sites.fixed])
    checks = {check.name: check.over for check in checks_of(result)}
    assert checks["fixed_surfaces_moved"] == len(sites.fixed)
    assert checks["on_symmetry"] == len(sites.slid)


def test_coincident_nodes_are_one_site(block):
    body = block.on("body")
    n = len(block.points)
    both = Patch("body", (), np.append(body, n + np.arange(len(body))))
    doubled = Mesh(np.vstack([block.points, block.points[body]]), (), (both,))
    sites = box_plan(doubled, job(("body",), box=TIGHT)).sites
    assert (len(sites.moving), len(sites.distinct), sites.coincident) == (52, 26, 26)
    assert np.isin(sites.moving[sites.distinct], body).all()


def test_a_surface_without_faces_has_the_edges_of_its_nearest_neighbours(block):
    arrays = Mesh(block.points, (), (Patch("body", (), block.on("body")),))
    plan = box_plan(arrays, job(("body",), box=TIGHT))
    assert plan.sites.edge == 0.5
    edges = plan.sites.edges
    lengths = np.linalg.norm(np.diff(arrays.points[plan.sites.known[edges]], axis=1), axis=2)
    assert lengths.min() == 0.5
    assert lengths.max() < 1.1
    one = Mesh(block.points, (), (Patch("body", (), block.on("body")[:1]),))
    with pytest.raises(InputError, match="the moving surface has 1 distinct nodes"):
        box_plan(one, job(("body",), box=TIGHT))


def test_walls_that_touch_are_one_part_with_the_bound_nodes_beside_them(plan, hybrid_wing):
    """A blended flap is joined with its wing; nothing stays but what is joined with neither."""
    moving, rest = plan.parts
    assert np.array_equal(moving, np.arange(len(plan.sites.known)))
    assert not len(rest)
    w = hybrid_wing
    alone = box_plan(w.mesh, job(WING, w.hinge, slide={"symmetry": "plane"}))
    assert [len(part) for part in alone.parts] == [len(alone.sites.known), 0]


def test_a_held_symmetry_plane_joins_no_walls(hybrid_wing):
    w = hybrid_wing
    fixed = ("wing_*", "symmetry")
    box = [[0.4, -0.1, -0.4], [1.4, 0.95, 0.4]]
    plan = box_plan(w.mesh, job(FLAP, w.hinge, **{**blended(w), "fixed": fixed, "slide": {}, "box": box}))
    moving, rest = (plan.sites.known[part] for part in plan.parts)
    wall = w.mesh.on(*w.mesh.expand([*WING], "patches"))
    assert np.isin(moving, wall).all()
    assert len(rest) > 20
    assert not np.isin(rest, wall).any()


def test_nodes_of_a_side_on_one_line_are_on_the_plane_of_the_whole_side(block):
    """Three nodes on a line lie in many planes; those of a wall that is no plane are on none."""
    names = tuple(name for name in block.names if name != "body")
    boundary = box_plan(block, job(("body",), box=[[-2.5, -2.5, -2.5], [2.5, 2.5, 2.5]], fixed=names)).boundary
    side, body = block.on("z-"), block.on("body")
    row = side[(block.points[side, 1] == 0.0)]
    assert len(row) > 2
    nodes = np.concatenate([row, body])
    on_side = places._on_sides(boundary, nodes, block.points[nodes])
    assert np.array_equal(on_side, np.isin(nodes, row))
    edge = Mesh(block.points, block.cells, (*block.patches, Patch("edge", (), row)), name="edge")
    alone = box_plan(edge, job(("body",), box=[[-2.5, -2.5, -2.5], [2.5, 2.5, 2.5]], fixed=(*names, "edge"))).boundary
    only = replace(alone, fixed=("edge",))
    assert not places._on_sides(only, nodes, block.points[nodes]).any()


def test_walls_that_do_not_touch_are_parts_of_their_own(block):
    """The outer faces of the block are held beside the body."""
    names = [name for name in block.names if name != "body"]
    plan = box_plan(block, job(("body",), box=[[-2.5, -2.5, -2.5], [2.5, 2.5, 2.5]], fixed=tuple(names)))
    moving, rest = (plan.sites.known[part] for part in plan.parts)
    assert np.array_equal(moving, block.on("body"))
    assert np.array_equal(np.sort(rest), block.on(*names))
    assert np.array_equal(np.flatnonzero(plan.moved_walls), block.on("body"))


def test_a_blended_flap_shears_in_its_strips_and_a_rigid_surface_nowhere(inboard_wing, hybrid_wing):
    one = box_plan(inboard_wing.mesh, job(FLAP, inboard_wing.hinge, **blended(inboard_wing)))
    (law,), (surface,) = one.boundary.laws, one.boundary.surfaces
    sheared = np.flatnonzero(one.sites.sheared)
    assert np.isin(surface.nodes[law.strip], one.sites.moving[sheared]).mean() > 0.8
    rigid = box_plan(hybrid_wing.mesh, job(WING, hybrid_wing.hinge, slide={"symmetry": "plane"}))
    assert not rigid.sites.sheared.any()
    assert not len(rigid.start(hybrid_wing.mesh.points).modifiers[0].layers.rows)


def test_sites_that_keep_their_distance_are_kept():
    line = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    assert zero_sites(line, np.array([[2.2, 0.0, 0.0]]), 1.5)[:, 0].tolist() == [0.0, 1.0, 3.0, 4.0]
    assert zero_sites(line, np.array([[2.2, 0.0, 0.0]]), 1.8)[:, 0].tolist() == [0.0, 1.0, 4.0]
