"""Which surface motion belongs to which control surface."""

from collections.abc import Callable

from cases.case import Blending, Case, Deflection
from cases.deflect import Move
from cases.motion import SurfaceMotion, wedge_motion
from cases.tail import tail_motion
from geometry.parameters import Fighter
from meshing.mesh import TetMesh

Motion = Callable[[TetMesh, Fighter, str, float, Blending], SurfaceMotion]
MOTIONS: dict[str, Motion] = {"aileron": wedge_motion, "rudder": wedge_motion, "tail": tail_motion}


def mover(case: Case, mesh: TetMesh, deflection: Deflection) -> Move:
    """Return the surface motion of one control surface as a function of its angle in degrees."""
    motion = MOTIONS[deflection.surface.partition("_")[0]]

    def move(angle: float) -> SurfaceMotion:
        return motion(mesh, case.fighter, deflection.surface, angle, case.blending)

    return move
