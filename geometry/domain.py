"""The two overlapping flow domains of the Chimera case (paper, section 5.2)."""

from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.assemble import assemble
from sdm_deflect.geometry.chimera import BlockParameters, block_corners
from sdm_deflect.geometry.deflected import wedge
from sdm_deflect.geometry.fuse import Cell, general_fuse
from sdm_deflect.geometry.hinges import ends
from sdm_deflect.geometry.lifting import wing_polyhedra
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.parts import Part, one_side, solid
from sdm_deflect.geometry.polyhedron import FloatArray, Loops
from sdm_deflect.geometry.preflight import preflight
from sdm_deflect.geometry.walls import partitions, skin, walls

CHIMERA = "chimera"

# The shortest edge that a block may have, by the gap: the wing's wall between the end face and the aileron.
SMALLEST_GAP_EDGE = 0.25


def chimera_block(fighter: Fighter, parameters: BlockParameters, surface: str = "aileron_left") -> CadModel:
    """The flow inside a hexahedral block around an aileron and the part of the wing ahead of it.

    Its outer faces are planar and called "chimera"; those that face a rib of the wing are perpendicular to y and
    stand in the gap. The front cuts through the wing parallel to the hinge line.

    Raises
    ------
    ValueError
        Where there is no such aileron, or no gap.
    CadError
        Where the kernel fails or the block could not be meshed.
    """
    side = surface.removeprefix("aileron")
    corners = block_corners(fighter, parameters, surface)
    parts = [
        *one_side(f"wing{side}", wing_polyhedra(fighter)),
        Part(surface, solid(wedge(*ends(fighter, surface)))),
        Part(CHIMERA, solid(_faces(corners))),
    ]
    found = walls(general_fuse(parts))
    model = assemble(skin(found, _in_flow, _wetted_patch), partitions(found, _in_flow), fluid_inside=True)
    preflight(model, min_edge=SMALLEST_GAP_EDGE * fighter.aileron.gap)
    return model


def background(fighter: Fighter, surface: str = "aileron_left") -> CadModel:
    """The aircraft that the block's outer faces take their flow from: without the aileron.

    In Chimera practice the background covers the aileron's place, blanked; without the aileron in it, every
    outer face of the block, and every place that the aileron leaves when it moves, lies in the background's flow.
    """
    return build(fighter, without={surface})


def _faces(corners: FloatArray) -> Loops:
    quads = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    return tuple(corners[list(quad)] for quad in quads)


def _in_flow(cell: Cell) -> bool:
    return cell.patch == CHIMERA


def _wetted_patch(_flow: Cell, body: Cell | None) -> str:
    return CHIMERA if body is None else body.patch
