"""The classical test of mesh motion, a block in a square: ``python -m benchmarks.block``.

A block of 5 by 1 cells in a square of 25 by 25 turns by 60 degrees and moves by (-0.2, -0.3), far into a corner (de
Boer, van der Schoot and Bijl, Computers and Structures 85, 2007). Cells are judged as the literature on it does:
f_ss is the square root of size times skew (Knupp 2003), beside the scaled Jacobian. It prints a table.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sdm_deflect import Mesh, Patch, Result, deflect
from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.mesh.cells import Cells

# Number of cells along a side, and the cells that the block takes.
COUNT, LENGTH, ROW = 25, range(10, 15), 12
SIDES = ("left", "right", "lower", "upper")
# Degrees, and shift of the block.
TURN, SHIFT = 60.0, np.array([-0.2, -0.3, 0.0])
# Published: least and mean f_ss, least and mean scaled Jacobian, of FvanSteen/Mesh-Deformation-RBF-Interpolation, whose
# nodes slide along the sides in 20 steps.
PUBLISHED = ("RBF-SliDe, 20 steps, sides slide", 0.150, 0.655, 0.308, 0.827)
HEAD = (
    "| how | f_ss, least | mean | scaled Jacobian, least | mean | inverted |",
    "| --- | ---: | ---: | ---: | ---: | ---: |",
)


def square() -> Mesh:
    """Return the mesh: 620 quadrilaterals, patches of the four sides and ``block``."""
    j, i = np.divmod(np.arange((COUNT + 1) ** 2), COUNT + 1)
    points = np.column_stack([i, j, np.zeros(len(i))]) / COUNT
    hole, ends = {(a, ROW) for a in LENGTH}, np.arange(COUNT)
    cells = [(a, b) for b in range(COUNT) for a in range(COUNT) if (a, b) not in hole]
    quads = [[_node(a, b), _node(a + 1, b), _node(a + 1, b + 1), _node(a, b + 1)] for a, b in cells]
    lines = [np.column_stack([_node(a, ends), _node(a, ends + 1)]) for a in (0, COUNT)]
    lines += [np.column_stack([_node(ends, b), _node(ends + 1, b)]) for b in (0, COUNT)]
    around = [[_node(a, b), _node(a + 1, b)] for b in (ROW, ROW + 1) for a in LENGTH]
    around += [[_node(a, ROW), _node(a, ROW + 1)] for a in (LENGTH[0], LENGTH[-1] + 1)]
    named = zip((*SIDES, "block"), (*lines, np.array(around)), strict=True)
    patches = tuple(Patch(name, (Cells("line", nodes),)) for name, nodes in named)
    return Mesh(points, (Cells("quad", np.array(quads)),), patches, name="square")


def turned(points: FloatArray, degrees: float) -> FloatArray:
    """Return points (N, 3) turned about the z-axis."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(points @ turn.T)


def deflected(slides: Sequence[str], tilt: float = 0.0, **settings: Any) -> Result:
    """Move the block while some sides slide and the others stay; before, the square is turned by `tilt` degrees."""
    mesh = square()
    start, centre = mesh.points[mesh.on("block")], np.array([0.5, 0.5, 0.0])
    move = centre + turned(start - centre, TURN) + SHIFT - start
    table = turned(start, tilt), turned(move, tilt)
    fixed, slide = [name for name in SIDES if name not in slides], [f"{name}:plane" for name in slides]
    there = replace(mesh, points=turned(mesh.points, tilt))
    return deflect(there, "block", None, 1.0, table=table, slide=slide, fixed=fixed, **settings)


class Scores(NamedTuple):
    """Least and mean f_ss, least and mean scaled Jacobian, and number of cells that are inside out."""

    least: float
    mean: float
    least_jacobian: float
    mean_jacobian: float
    inverted: int


def scores(points: FloatArray) -> Scores:
    """Judge the cells of the square with its nodes at points (N, 3)."""
    mesh = square()
    (cells,) = mesh.cells
    assert isinstance(cells, Cells)
    (before, _), (areas, lengths) = (_corners(places, cells.nodes) for places in (mesh.points, points))
    inverted, size = (areas <= 0.0).any(axis=0), areas.sum(axis=0) / before.sum(axis=0)
    with np.errstate(divide="ignore"):  # a corner may have no area
        skew = 4.0 / (lengths / areas).sum(axis=0)
    quality = np.where(inverted, 0.0, np.sqrt(np.clip(np.minimum(size, 1.0 / size), 0.0, 1.0)) * skew)
    jacobian = (areas / lengths).min(axis=0)
    least, mean, least_jacobian, mean_jacobian = (
        float(value) for one in (quality, jacobian) for value in (one.min(), one.mean())
    )
    return Scores(least, mean, least_jacobian, mean_jacobian, int(inverted.sum()))


def _corners(points: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return twice the areas (4, C) of the triangles at corners, and the products (4, C) of two edges' lengths."""
    areas, lengths = [], []
    for k in range(4):
        a, b = (points[cells[:, (k + j) % 4], :2] - points[cells[:, k], :2] for j in (1, 3))
        areas.append(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        lengths.append(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    return np.array(areas), np.array(lengths)


def _node(a: Any, b: Any) -> Any:
    """Return the node at column a and row b of the square, or those at several."""
    return b * (COUNT + 1) + a


def rows() -> Iterator[str]:
    """Yield the rows of the table."""
    for slides, how in ((SIDES, "all sides slide"), (("left", "lower", "upper"), "three sides slide"), ((), "fixed")):
        for repair in ("off", "auto"):
            *figures, inverted = scores(deflected(slides, repair=repair).points)
            name = f"{how}{', repaired' if repair == 'auto' else ''}"
            yield f"| {name} | {' | '.join(f'{figure:.3f}' for figure in figures)} | {inverted} |"
    name, *published = PUBLISHED
    yield f"| {name} | {' | '.join(f'{figure:.3f}' for figure in published)} | |"


if __name__ == "__main__":
    print("\n".join([*HEAD, *rows()]))
