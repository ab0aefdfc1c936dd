"""A control surface and a motion that the package does not know: the tip of the fin bends to one side.

It needs a mesh with named patches, a motion of the patches' nodes, and a hexahedron that holds no other patch.

    python docs/examples/own_surface.py runs/aileron/undeflected.vtu
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray
from sdm_deflect.deform.box.automatic import Given
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.surface.motions import Functions, Moving, Powers, Smooth
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio, signed_volumes

# Heights (m) above which the fin bends, and of its tip.
BEND, TOP = 0.125, 0.2133
REGION = box(np.array([0.70, -0.06, BEND]), np.array([1.00, 0.06, 0.27]))


@dataclass(frozen=True, slots=True)
class Bend:
    """A parabola to starboard; the amount is how far (m) the tip goes."""

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        return "m"

    @property
    def axis(self) -> Axis | None:
        """No hinge: the box is given."""
        return None

    def law(self, surface: Surface) -> "BendLaw":
        """Return the motion of the nodes of a surface."""
        return BendLaw(surface.points)


@dataclass(frozen=True, slots=True, eq=False)
class BendLaw(Smooth):
    """The motion of points (K, 3)."""

    points: FloatArray

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,): none is blended."""
        return np.ones(len(self.points), dtype=bool)

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3)."""
        share = np.maximum(self.points[:, 2] - BEND, 0.0) / (TOP - BEND)
        return amount * np.outer(share**2, [0.0, 1.0, 0.0])

    @property
    def functions(self) -> Functions:
        """The amount itself: the displacement is proportional to it."""
        return Powers(1)


def deflected(mesh: Mesh, tip: float = 0.010) -> Mesh:
    """Return the mesh with the fin bent by `tip` metres; nodes outside the region keep their bits."""
    job = Job(surfaces=(Moving(("fin", "rudder"), Bend(), tip),), fixed=("*",), box=Given(REGION))
    return mesh.with_points(deflect(Plan.of(mesh, [job])).points)


def main(file: Path) -> Mesh:
    """Bend the fin of a mesh in a .vtu file, and judge the result."""
    mesh = read_vtu(file)
    after = deflected(mesh)
    moved = np.linalg.norm(after.points - mesh.points, axis=1)
    inverted = np.count_nonzero(signed_volumes(after.points, tets_of(after)) <= 0.0)
    worst = mean_ratio(after.points, tets_of(after)).min()
    print(f"{np.count_nonzero(moved)} of {len(moved)} nodes moved, by at most {1e3 * moved.max():.1f} mm")
    print(f"{inverted} cells inverted, smallest mean ratio {worst:.3f}")
    return after


if __name__ == "__main__":
    main(Path(sys.argv[1]))
