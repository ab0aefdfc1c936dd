"""Surface meshes around each control surface before and after the deflection, drawn off-screen."""

import numpy as np

from sdm_deflect.cases.report.aircraft import walls
from sdm_deflect.cases.report.compose import Picture
from sdm_deflect.cases.report.layers import box, patches
from sdm_deflect.cases.report.scene import View, framed
from sdm_deflect.cases.report.story import Outcome
from sdm_deflect.cases.turn import Turn
from sdm_deflect.cases.zero_sites import BLOCK
from sdm_deflect.meshing.mesh import TetMesh

PIXELS = (900, 640)
TOWARDS = (1.0, -0.6, 0.45)
"""From behind, port and above; mirrored for surfaces to starboard."""


def before_after(outcome: Outcome, turn: Turn) -> Picture:
    """Draw a control surface with its hexahedron, before and after side by side."""
    moved = np.linalg.norm(outcome.deflected.points - outcome.mesh.points, axis=1)[turn.motion.nodes]
    count = len(outcome.mesh.triangles_of(turn.surface))
    return Picture(
        tuple(close(outcome, mesh, turn) for mesh in (outcome.mesh, outcome.deflected)),
        (f"{turn.surface}, undeflected", f"{turn.surface}, {turn.angle:+g} deg"),
        f"Surface mesh of {turn.surface} ({count} triangles) and its surroundings before (left) and after (right) it "
        f"turns by {turn.angle:+g} deg; nodes move by up to {1e3 * moved.max():.1f} mm. The edges of the hexahedron, "
        "outside of which nothing moves, are magenta.",
    )


def close(outcome: Outcome, mesh: TetMesh, turn: Turn) -> View:
    """Look at a control surface; the picture holds it before and after."""
    nodes = mesh.on(turn.surface)
    held = np.vstack([outcome.mesh.points[nodes], outcome.deflected.points[nodes]])
    corners = turn.region.hexahedron.corners
    names = [name for name in walls(mesh) if name != BLOCK]
    side = 1.0 if corners[:, 1].mean() <= 1e-9 else -1.0
    layers = (*patches(mesh, names, edge=(70, 70, 70), width=0.7), box(corners, 2.5))
    return framed(layers, held, (TOWARDS[0], side * TOWARDS[1], TOWARDS[2]), PIXELS)
