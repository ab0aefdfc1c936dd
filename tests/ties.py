"""Meshes that differ by rounding, and what a deflection chose on them."""

import numpy as np

from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.meshing.mesh.mesh import Mesh

# Each moves every coordinate by one unit in the last place, up or down at random.
SEEDS = (0, 1, 2)


def rounded_otherwise(mesh: Mesh, seed: int) -> Mesh:
    """Return the mesh with each coordinate moved by one unit in the last place; zeros, and planes of one, stay."""
    points, random = mesh.points, np.random.default_rng(seed)
    moved = np.where(random.random(points.shape) < 0.5, np.nextafter(points, np.inf), np.nextafter(points, -np.inf))
    stays = points == 0.0
    if mesh.plane:
        stays[:, mesh.across] = True
    return mesh.with_points(np.where(stays, points, moved))


def chosen(deflection: Deflection) -> list[tuple[list[int], list[int]]]:
    """Return the rows of the centres of each fit in their order, and the number of centres after each block."""
    steps = [step for box in deflection.boxes for step in box.steps]
    fits = [fit for step in steps for fit in step.fits.adaptations]
    return [(fit.chosen.tolist(), [row.n_centers for row in fit.history]) for fit in fits]
