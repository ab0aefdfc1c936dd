"""A mesh of second order is deflected by the linear mesh of its nodes."""

import high_order
import meshio
import numpy as np
import pytest

import sdm_deflect

TURN = 5.0


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    path = tmp_path_factory.mktemp("curved") / "curved.msh"
    high_order.curved(path, fineness=0.5)
    return path


def volumes(points, tets):
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    return np.linalg.det(edges) / 6.0


def of_shape(mesh, shape):
    return np.vstack([block.data for block in mesh.cells if block.type == shape])


def test_linear_cells_have_all_nodes_and_fill_the_curved_ones(before):
    mesh = meshio.read(before)
    whole, parts = of_shape(mesh, "tetra10"), of_shape(high_order.linear(mesh), "tetra")
    assert len(parts) == 8 * len(whole)
    np.testing.assert_array_equal(np.unique(parts), np.arange(len(mesh.points)))
    straight = mesh.points.copy()
    for middle, ends in zip(range(4, 10), [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)], strict=True):
        straight[whole[:, middle]] = mesh.points[whole[:, ends]].mean(axis=1)
    assert volumes(straight, parts).min() > 0.0
    np.testing.assert_allclose(volumes(straight, parts).sum(), volumes(mesh.points, whole[:, :4]).sum(), rtol=1e-12)


def test_every_node_of_a_curved_wall_turns_rigidly(before):
    """Turned as a whole: nodes within edges, too, are where a rotation written out brings them."""
    mesh = meshio.read(before)
    axis = [[0.25, 0.0, 0.0], [0.25, 2.0, 0.0]]
    plan = sdm_deflect.plan(
        high_order.linear(mesh), ["wing", "flap"], axis, range=(0, TURN), slide="symmetry:plane", repair="off"
    )
    order = np.random.default_rng(1).permutation(len(mesh.points))
    moved = np.empty_like(mesh.points)
    moved[order] = plan.on(mesh.points[order]).at(TURN)
    rows = np.union1d(high_order.on_patch(mesh, "wing"), high_order.on_patch(mesh, "flap"))
    assert len(np.setdiff1d(rows, of_shape(mesh, "triangle6")[:, :3])) > len(rows) // 2  # most are within edges
    arm, angle = mesh.points[rows] - axis[0], np.radians(TURN)
    turned = np.column_stack([
        np.cos(angle) * arm[:, 0] + np.sin(angle) * arm[:, 2], arm[:, 1],
        np.cos(angle) * arm[:, 2] - np.sin(angle) * arm[:, 0],
    ])  # fmt: skip
    np.testing.assert_allclose(moved[rows], turned + axis[0], rtol=0.0, atol=1e-14)
    assert all(check.passed for check in plan.check(TURN))


@pytest.mark.nightly
def test_the_example_leaves_no_curved_cell_folded(tmp_path, capsys):
    high_order.main(tmp_path)
    said = capsys.readouterr().out
    assert "failed: none" in said
    least = [high_order.least_jacobian(tmp_path / name) for name in ("curved.msh", "curved-deflected.msh")]
    assert least[1] > 0.5 * least[0] > 0.0  # another version of the mesher has another worst cell
    with pytest.raises(sdm_deflect.InputError, match="not linear or not known"):
        sdm_deflect.read(tmp_path / "curved.msh")
