"""A wing of infinite span in a C-grid of hexahedra, whose flap is a part of it: a structured viscous mesh."""

import numpy as np

from benchmarks.measure import FloatArray
from sdm_deflect.base.arrays import BoolArray, IntArray
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.wing import boundary_faces

# Half the nose's radius: where the parabolas z = `FOCUS` + w**2 of a plane w have their focus.
FOCUS = 0.0079
# Chords to the far field; cells along each side of the airfoil, along the wake, and outwards.
FAR, AROUND, WAKE, LAYERS = 10.0, 60, 24, 48


def c_grid(hinge: float, flap: tuple[float, float], first_height: float, span: FloatArray) -> Mesh:
    """Return a NACA 0012 of chord 1 between stations y of `span`, its flap behind x = hinge between two of them.

    In the plane w the airfoil and its wake are nearly a straight line, so that columns over it become a smooth grid
    that is nearly orthogonal. Patches are ``wing``, ``flap``, ``symmetry`` (the first station), ``end`` and
    ``far_field``.
    """
    wall = _wall()
    up = np.stack([stretched(LAYERS, first_height / (2.0 * abs(p)), FAR**0.5) for p in wall], axis=1)
    flat = FOCUS + (wall + 1j * up) ** 2
    flat.imag[0, : WAKE + 1] = flat.imag[0, -WAKE - 1 :] = 0.0
    x, y, z = (np.empty((len(span), *flat.shape)) for _ in range(3))
    x[:], y[:], z[:] = flat.real, span[:, None, None], flat.imag
    grid = np.arange(flat.size).reshape(flat.shape)
    grid[0, : WAKE + 1] = grid[0, ::-1][: WAKE + 1]  # the wake's two sides are one
    used, nodes = np.unique(
        _hexahedra(grid[None] + flat.size * np.arange(len(span))[:, None, None]), return_inverse=True
    )
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)[used]
    cells = Cells("hexahedron", nodes.reshape(-1, 8))
    on_wall = np.isin(used % flat.size, grid[0, WAKE:-WAKE])
    return Mesh(points, (cells,), _patches(points, cells, on_wall, hinge, flap))


def stretched(count: int, first: float, length: float) -> FloatArray:
    """Return points (count + 1,) from 0 to a length whose steps grow by a factor, the first step given."""
    low, high = 1.0 + 1e-12, 3.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        short = first * (middle**count - 1.0) / (middle - 1.0) < length
        low, high = (middle, high) if short else (low, middle)
    return np.asarray(length * (low ** np.arange(count + 1) - 1.0) / (low**count - 1.0))


def _wall() -> FloatArray:
    """Return the points in the plane w of lower wake, airfoil from its lower side to its upper one, and upper wake."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, AROUND + 1)))
    z = 0.6 * np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1036]) @ np.stack([np.sqrt(x), x, x**2, x**3, x**4])
    upper = np.sqrt(x + 1j * z - FOCUS)
    upper[0], upper[-1] = 1j * FOCUS**0.5, (1.0 - FOCUS) ** 0.5
    wake = np.sqrt(1.0 + stretched(WAKE, 1.0 - x[-2], FAR)[1:] - FOCUS)
    half = np.concatenate([upper, wake])
    return np.concatenate([-np.conj(half[:0:-1]), half])


def _hexahedra(grid: IntArray) -> IntArray:
    """Return the cells (M, 8) of a structured block (span, outwards, along)."""
    low, high = slice(None, -1), slice(1, None)
    corners = (low, low), (high, low), (high, high), (low, high)
    return np.stack([grid[k, j, i].ravel() for k in (low, high) for j, i in corners], axis=1)


def _patches(
    points: FloatArray, cells: Cells, on_wall: BoolArray, hinge: float, flap: tuple[float, float]
) -> tuple[Patch, ...]:
    faces = boundary_faces((cells,))["quad"]
    x, y, _ = points[faces].mean(axis=1).T
    aside = np.ptp(points[faces][:, :, 1], axis=1) < 1e-12
    wall = on_wall[faces].all(axis=1) & ~aside
    moves = wall & (x > hinge) & (flap[0] < y) & (y < flap[1])
    first = aside & (y < 0.5 * (points[:, 1].min() + points[:, 1].max()))
    masks = {
        "flap": moves,
        "wing": wall & ~moves,
        "symmetry": first,
        "end": aside & ~first,
        "far_field": ~aside & ~wall,
    }
    return tuple(Patch(name, (Cells("quad", faces[mask]),)) for name, mask in masks.items())
