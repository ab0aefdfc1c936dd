"""What one control surface of a case is to do on a given mesh."""

from dataclasses import dataclass

from sdm_deflect.cases.case import Case, Deflection
from sdm_deflect.cases.confine import Region, confine
from sdm_deflect.cases.motion import SurfaceMotion
from sdm_deflect.cases.motions import mover
from sdm_deflect.meshing.mesh import TetMesh


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A control surface, its angle in degrees, its confinement and the prescribed motion of the whole angle."""

    surface: str
    angle: float
    region: Region
    motion: SurfaceMotion


def turn_of(case: Case, mesh: TetMesh, deflection: Deflection) -> Turn:
    """Prescribe the surface motion and confine it."""
    angle = deflection.factor * case.angle
    motion = mover(case, mesh, deflection.surface)(angle)
    return Turn(deflection.surface, angle, confine(case, mesh, motion), motion)
