"""Synthetic data sites and points of the paper's sizes (sections 5.1 to 5.3)."""

from dataclasses import dataclass

import numpy as np

from benchmarks.measure import FloatArray
from sdm_deflect.base.arrays import IndexArray, farthest
from sdm_deflect.deform.box.hexahedron import Hexahedron, box
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join
from sdm_deflect.meshing.mesh.axis import Axis

# Generators of the R sequence in 3, 2 and 1 dimensions.
GOLDEN = (1.2207440846057596, 1.324717957244746, 1.618033988749895)


@dataclass(frozen=True, slots=True)
class Surface:
    """A swept, tapered plate: a control surface."""

    root_chord: float
    tip_chord: float
    span: float
    sweep: float  # m that the tip's leading edge lies aft
    thickness: float

    def nodes(self, count: int) -> FloatArray:
        """Return points (count, 3) spread evenly over upper and lower side."""
        u = _spread(count, 2)
        chord = self.root_chord + (self.tip_chord - self.root_chord) * u[:, 1]
        bevel = np.minimum(1.0, np.minimum(u[:, 0], 1.0 - u[:, 0]) / 0.12)
        side = np.where(np.arange(count) % 2, 0.5, -0.5)
        z = side * self.thickness * chord * bevel
        return np.column_stack([u[:, 0] * chord + self.sweep * u[:, 1], self.span * u[:, 1], z])


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """One of the paper's test cases."""

    name: str
    sites: DataSites
    initial: IndexArray  # rows of the sites
    region: Hexahedron


def aileron() -> Workload:
    """Section 5.1: 240 surface points and 800 on the hexahedron."""
    surface = Surface(0.022, 0.0072, 0.19, 0.0148, 0.2)
    region = box(np.array([0.0, -0.001, -0.04]), np.array([0.06, 0.24, 0.04]))
    return _workload("aileron", surface, region, Axis(np.zeros(3), np.array([0.08, 1.0, 0.0])), -12.0, (240, 800, 5))


def chimera() -> Workload:
    """Section 5.2: 17,952 surface points and 3,672 on the hexahedron."""
    surface = Surface(0.022, 0.0072, 0.19, 0.0148, 0.2)
    region = box(np.array([0.0, -0.005, -0.03]), np.array([0.05, 0.22, 0.03]))
    axis = Axis(np.zeros(3), np.array([0.08, 1.0, 0.0]))
    return _workload("chimera", surface, region, axis, -30.0, (17_952, 3_672, 20))


def tail(sites: int = 25_896) -> Workload:
    """Section 5.3: 16,816 surface points and 9,080 on the hexahedron, or `sites` in the same proportion."""
    surface = Surface(0.1352, 0.0414, 0.1108, 0.0938, 0.05)
    region = box(np.array([-0.02, -0.001, -0.09]), np.array([0.16, 0.16, 0.09]))
    on_surface = round(sites * 16_816 / 25_896)
    axis = Axis(np.array([0.081, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    return _workload("tail", surface, region, axis, 12.0, (on_surface, sites - on_surface, 100))


def points_around(region: Hexahedron, inside: int, outside: int = 0) -> FloatArray:
    """Return points (inside + outside, 3): the first in a box-shaped region, the others around it."""
    low, high = region.corners.min(axis=0), region.corners.max(axis=0)
    near = low + _spread(inside, 3) * (high - low)
    around = 0.5 * (low + high) + (_spread(outside, 3) - 0.5) * 20.0 * (high - low)
    return np.vstack([near, np.where(region.contains(around)[:, None], around + 2.0 * (high - low), around)])


def _workload(
    name: str, surface: Surface, region: Hexahedron, axis: Axis, degrees: float, counts: tuple[int, int, int]
) -> Workload:
    """Rotate the surface and pin the hexahedron's faces but the inward one."""
    on_surface, on_faces, start = counts
    nodes, faces = surface.nodes(on_surface), _face_sites(region, on_faces)
    sites = join([DataSites(nodes, axis.displacement(nodes, degrees)), fixed_sites(faces)], tol=0.0)
    initial = np.append(farthest(nodes, start), on_surface + farthest(faces, start))
    return Workload(name, sites, initial, region)


def _face_sites(region: Hexahedron, count: int) -> FloatArray:
    """Return exactly `count` near-equidistant sites on all faces but the inward one."""
    size = np.ptp(region.corners, axis=0)
    spacing = float(np.sqrt(2.0 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0]) / count))
    sites = region.face_sites(spacing, skip={"y-"})
    while len(sites) < count:
        spacing *= 0.98
        sites = region.face_sites(spacing, skip={"y-"})
    return sites[np.linspace(0, len(sites) - 1, count).round().astype(np.intp)]


def _spread(count: int, dimensions: int) -> FloatArray:
    """Return points (count, dimensions) of the R sequence: even, without a lattice's ties, the same every time."""
    steps = (1.0 / GOLDEN[3 - dimensions]) ** np.arange(1, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
