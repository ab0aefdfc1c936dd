"""The paper's method, step by step, on the left tail of `sdm example --fighter`, and its cells after each step.

The steps are those of `deform/confined.py` alone: `sdm deflect` also follows walls and repairs.
"""

import lzma
import tomllib
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Self

import numpy as np

import sdm_deflect
from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.confined import initial_centers
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.greedy import Adaptation, adapt
from sdm_deflect.deform.rbf.interpolant import Interpolant, fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Rule, Worst
from sdm_deflect.deform.volume.plan import BoxPlan
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_and_inverted

SURFACE, ANGLE = "tail_left", 20.0
# Plane of the section: y in metres, in the middle of the tail.
SECTION = -0.13
# Centres at the start: on the tail, and on the box.
START = (4, 4)
# A cell counts as worse if its mean ratio falls by more.
WORSE = 0.1


class Judged(NamedTuple):
    """Cells after a step: how many are inside out, the least mean ratio, and how many lost more than `WORSE`."""

    inverted: int
    least: float
    worse: int


@dataclass(frozen=True, eq=False)
class Tail:
    """The left tail at an angle in its box.

    Attributes
    ----------
    mesh : the undeflected mesh, of tetrahedra.
    plan : the plan of its box.
    displacement : (N, 3) what `sdm deflect` does with all nodes.
    angle : degrees, trailing edge down.
    """

    mesh: Mesh
    plan: BoxPlan
    displacement: FloatArray = field(repr=False)
    angle: float = ANGLE

    @classmethod
    def at(cls, angle: float = ANGLE) -> Self:
        """Turn the tail by an angle (degrees), with the settings of `fighter.toml`."""
        mesh, given = fighter()
        own = next(surface for surface in given["surface"] if surface["patches"] == SURFACE)
        kept = {name: own[name] for name in ("motion", "on", "box", "range")}
        result = sdm_deflect.deflect(mesh, SURFACE, own["hinge"], angle, fixed=given["fixed"], repair="off", **kept)
        return cls(mesh, result.deflection.boxes[0].plan, result.displacement, angle)

    @cached_property
    def tets(self) -> IntArray:
        """Nodes (M, 4) of all tetrahedra."""
        (block,) = self.mesh.cells
        return block.nodes  # type: ignore[union-attr]

    @cached_property
    def sites(self) -> DataSites:
        """Data sites: nodes of the tail, nodes that stay, and last the zero sites on the box."""
        sites = self.plan.sites
        moving, fixed = sites.moving[sites.distinct], sites.fixed[sites.sampled]
        zero = np.concatenate([part.points for part in sites.zero])
        points = np.concatenate([self.mesh.points[moving], self.mesh.points[fixed], zero])
        values = np.zeros_like(points)
        values[: len(moving)] = self.displacement[moving]
        return DataSites(points, values)

    @property
    def on_tail(self) -> int:
        """Number of sites that move."""
        return len(self.plan.sites.distinct)

    @property
    def in_mesh(self) -> int:
        """Number of sites that are nodes; the others are on the box."""
        return self.on_tail + len(self.plan.sites.sampled)

    @cached_property
    def free(self) -> IntArray:
        """Nodes in the box that the interpolant moves."""
        return np.setdiff1d(self.plan.region.inside, self.plan.sites.known)

    @cached_property
    def cells(self) -> IntArray:
        """Rows (K,) of the cells that may change."""
        may = np.zeros(len(self.mesh.points), dtype=np.bool_)
        may[self.plan.region.inside] = may[self.plan.sites.moving] = True
        return np.flatnonzero(may[self.tets].any(axis=1))

    def with_all(self) -> Interpolant:
        """Return the interpolant with every site as a centre."""
        return fit(ThinPlateSpline(), self.sites.points, self.sites.values)

    def without_box(self) -> Interpolant:
        """Return the interpolant without the sites on the box."""
        return fit(ThinPlateSpline(), self.sites.points[: self.in_mesh], self.sites.values[: self.in_mesh])

    def greedy(self, count: int) -> Adaptation:
        """Add the site with the largest error, one after another, up to `count` centres."""
        options = GreedyOptions(n_add=1, tol_add=1e-12, tol_stop=1e-12, max_centers=count)
        return self.adapted(self.sites, START, options, Worst())

    def adapted(self, sites: DataSites, start: tuple[int, int], options: GreedyOptions, rule: Rule) -> Adaptation:
        """Choose centres among sites, from `start` centres on the tail and elsewhere."""
        return adapt(sites, ThinPlateSpline(), initial_centers(sites, self.on_tail, start), options, rule=rule)

    def error(self, found: Interpolant) -> FloatArray:
        """Return the distances (S,) of an interpolant from the displacements at the sites."""
        return np.asarray(np.linalg.norm(found(self.sites.points) - self.sites.values, axis=1))

    def moved(self, found: Interpolant) -> FloatArray:
        """Return the points (N, 3) with the tail moved, and the free nodes moved by an interpolant."""
        points, moving = self.mesh.points.copy(), self.plan.sites.moving
        points[moving] += self.displacement[moving]
        points[self.free] += found(points[self.free])
        return points

    def quality(self, points: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean ratios (K,) of rows of cells, and which are inside out."""
        return quality_and_inverted(points, Cells("tetra", self.tets[rows]))

    def judged(self, points: FloatArray, rows: IntArray | None = None) -> Judged:
        """Judge rows of cells with the nodes at points (N, 3); None: those that may change."""
        rows = self.cells if rows is None else rows
        before, _ = self.quality(self.mesh.points, rows)
        now, inverted = self.quality(points, rows)
        least = float(np.where(inverted, 0.0, now).min())
        return Judged(int(inverted.sum()), least, int((before - now > WORSE).sum()))


@cache
def fighter() -> tuple[Mesh, dict[str, Any]]:
    """Return the fighter's mesh, and its settings; both are read once, and must not be changed."""
    folder = files("sdm_deflect.cases")
    settings = tomllib.loads(folder.joinpath("fighter.toml").read_text(encoding="utf-8"))
    with TemporaryDirectory() as scratch:
        path = Path(scratch, "fighter.su2")
        path.write_bytes(lzma.decompress(folder.joinpath("fighter.su2.xz").read_bytes()))
        return FORMATS["su2"].read(path), settings


class Section(NamedTuple):
    """Cells cut by the plane y = `SECTION`: their rows (K,), and the polygons (3 or 4, 2) of x and z of each."""

    rows: IntArray
    polygons: list[FloatArray]


def cut(tail: Tail, points: FloatArray, rows: IntArray) -> Section:
    """Cut rows of cells where the undeflected mesh crosses the plane; corners move with the nodes at points (N, 3)."""
    height = tail.mesh.points[:, 1] - SECTION
    above = height[tail.tets[rows]] >= 0.0
    across = rows[above.any(axis=1) & ~above.all(axis=1)]
    polygons = []
    for nodes in tail.tets[across]:
        up, down = nodes[height[nodes] >= 0.0], nodes[height[nodes] < 0.0]
        pairs = [(a, b) for a in up for b in down]
        if len(pairs) == 4:  # around the quadrilateral
            pairs = [pairs[0], pairs[1], pairs[3], pairs[2]]
        polygons.append(np.array([between(points, height, *pair) for pair in pairs]))
    return Section(across, polygons)


def outline(tail: Tail, points: FloatArray) -> list[FloatArray]:
    """Return the segments (2, 2) in which the plane cuts the tail's skin, moved with the nodes at points (N, 3)."""
    return skin(tail.mesh, SURFACE, SECTION, points)


def skin(mesh: Mesh, patch: str, y: float, points: FloatArray) -> list[FloatArray]:
    """Return the segments (2, 2) of x and z in which a plane of constant y cuts a patch.

    The undeflected mesh is cut; the segments move with its nodes at points (N, 3).
    """
    height = mesh.points[:, 1] - y
    segments = []
    for face in mesh.patch(patch).faces[0].nodes:
        pairs = [(face[i], face[(i + 1) % 3]) for i in range(3)]
        ends = [between(points, height, a, b) for a, b in pairs if (height[a] >= 0.0) != (height[b] >= 0.0)]
        if len(ends) == 2:
            segments.append(np.array(ends))
    return segments


def between(points: FloatArray, height: FloatArray, a: int, b: int) -> FloatArray:
    """Return x and z of the point of an edge that is in the plane of the undeflected mesh."""
    share = height[a] / (height[a] - height[b])
    return np.asarray((points[a] + share * (points[b] - points[a]))[[0, 2]])
