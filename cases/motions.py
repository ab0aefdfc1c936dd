"""Which surface motion belongs to which control surface."""

from collections.abc import Callable

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.motion import SurfaceMotion, wedge_motion
from sdm_deflect.cases.tail import tail_motion
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.meshing.mesh import TetMesh

Motion = Callable[[Case, TetMesh, str, float], SurfaceMotion]
Move = Callable[[float], SurfaceMotion]
"""The surface motion at a deflection angle in degrees."""


def mover(case: Case, mesh: TetMesh, surface: str) -> Move:
    """Return the motion of one control surface as a function of its angle in degrees."""
    motion: Motion = wedge_motion if hinged(surface) else tail_motion

    def move(angle: float) -> SurfaceMotion:
        return motion(case, mesh, surface, angle)

    return move
