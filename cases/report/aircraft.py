"""Figure 1: the aircraft's surfaces by component, and the two overlapping Chimera blocks."""

from sdm_deflect.cases.report.colours import COMPONENTS, MAGENTA, components_of
from sdm_deflect.cases.report.compose import Picture
from sdm_deflect.cases.report.layers import box, patches
from sdm_deflect.cases.report.scene import View, framed, plain
from sdm_deflect.cases.run import Run
from sdm_deflect.cases.zero_sites import BLOCK
from sdm_deflect.geometry.confinement import block_corners
from sdm_deflect.meshing.mesh import TetMesh

FAR_FIELD = "far_field"
PIXELS = (900, 620)


def blocks(aircraft: Run, chimera: Run) -> Picture:
    """Draw the aircraft as meshed, and the aileron's block in the aircraft's.

    Raises
    ------
    ValueError
        If the second run has no Chimera block.
    """
    if chimera.background is None:
        raise ValueError(f"case {chimera.case.name} has no Chimera block")
    names = components_of(walls(aircraft.mesh))
    legend = {name: COMPONENTS[name] for name in [*names, BLOCK]}
    return Picture(
        (whole(aircraft.mesh), overlapping(chimera, chimera.background)),
        ("full model, one block", "Chimera block of the aileron in the aircraft's block"),
        "Left: surface mesh of the aircraft, coloured by component. Right: the Chimera block around the left aileron, "
        "transparent with magenta edges, in the surrounding aircraft.",
        legend={("block's outer faces" if name == BLOCK else name): colour for name, colour in legend.items()},
    )


def walls(mesh: TetMesh) -> list[str]:
    """Return the patches of the aircraft itself."""
    return [name for name in mesh.names[1:] if name not in (FAR_FIELD, BLOCK)]


def whole(mesh: TetMesh) -> View:
    """Look at the aircraft from ahead, port and above."""
    layers = patches(mesh, walls(mesh), edge=(70, 70, 70), width=0.6)
    return framed(layers, mesh.points[mesh.on(*walls(mesh))], (-1.0, -1.1, 0.9), PIXELS)


def overlapping(run: Run, background: TetMesh) -> View:
    """Look at the block around the aileron from behind, port and above."""
    corners = block_corners(run.case.fighter, run.case.block, run.deflections[0].turn.surface)
    around = patches(background, walls(background), edge=(120, 120, 120), width=0.4)
    own = patches(run.mesh, walls(run.mesh), edge=(60, 60, 60), width=0.6)
    outside = plain(run.mesh.points, run.mesh.triangles_of(BLOCK), MAGENTA, opacity=0.12)
    return framed((*around, *own, outside, box(corners)), corners, (0.9, -1.0, 0.9), PIXELS)
