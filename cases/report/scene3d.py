"""Colours of patches, qualities and displacements, and faces as arrays."""

from collections.abc import Iterable
from zlib import crc32

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize, to_rgb

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.hexahedron import EDGES
from sdm_deflect.deform.mesh.cells import Cells, Faces

Colour = tuple[int, int, int]
Direction = tuple[float, float, float]
QUALITY_MAP = "cividis"
QUALITY_RANGE = Normalize(0.4, 1.0)
"""Cells of a quality below 0.4 get the darkest colour."""

COMPONENTS = {
    "fuselage": "#bbbbbb",
    "canopy": "#332288",
    "inlet": "#999933",
    "pedestal": "#dddddd",
    "strake": "#44aa99",
    "wing": "#88ccee",
    "aileron": "#cc6677",
    "tail": "#ddcc77",
    "ventral": "#117733",
    "fin": "#aa4499",
    "rudder": "#882255",
    "chimera": "#cc00cc",
}
"""After Paul Tol's muted scheme."""

OTHERS = ("#bbbbbb", "#88ccee", "#44aa99", "#dddddd", "#ddcc77", "#999933", "#6699cc", "#b8b8d8")
"""For patches that are no component of our aircraft: taken in turn by the letters of the name."""
MOVING = COMPONENTS["aileron"]
"""For such patches that move."""

DARK: Colour = (90, 90, 90)
GREY: Colour = (190, 190, 190)
MAGENTA: Colour = (204, 0, 204)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)


def component(patch: str) -> str:
    """Return the component that a patch belongs to; left and right are alike."""
    stem = patch.removesuffix("_left").removesuffix("_right")
    return "fuselage" if stem.startswith("fuselage") else stem


def patch_colour(patch: str, moving: bool = False) -> Colour:
    """Return the colour of a patch's component."""
    name = component(patch)
    colour = COMPONENTS.get(name) or (MOVING if moving else OTHERS[crc32(name.encode()) % len(OTHERS)])
    r, g, b = (round(255 * share) for share in to_rgb(colour))
    return r, g, b


def hexadecimal(colour: Colour) -> str:
    """Return a colour as a web page wants it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def components_of(patches: Iterable[str]) -> list[str]:
    """Return the components among patches that have a colour, in the order of `COMPONENTS`."""
    present = {component(patch) for patch in patches}
    return [name for name in COMPONENTS if name in present]


def quality_rgb(quality: FloatArray) -> IntArray:
    """Return the colours (F, 3) of qualities (F,)."""
    return np.asarray(np.rint(255.0 * mpl.colormaps[QUALITY_MAP](QUALITY_RANGE(quality))[:, :3]), dtype=np.intp)


CHANGE_MAP = "RdBu"
CHANGE_RANGE = Normalize(-0.2, 0.2)
"""From cells that lose quality, red, to those that gain it."""


MOVED_MAP = "YlOrRd"
"""From nodes that stay to those that move farthest."""


BOX_EDGES = np.array(EDGES)


def by_size(faces: Iterable[Faces]) -> list[IntArray]:
    """Return faces as arrays (F, k), one for each number k of corners."""
    found: dict[int, list[IntArray]] = {}
    for block in faces:
        if isinstance(block, Cells):
            found.setdefault(block.nodes.shape[1], []).append(block.nodes)
            continue
        sizes = np.diff(block.offsets)
        for k in np.unique(sizes):
            rows = block.offsets[:-1][sizes == k, None] + np.arange(k)
            found.setdefault(int(k), []).append(block.nodes[rows])
    return [np.concatenate(found[k]) for k in sorted(found)]


def triangles_of(faces: Iterable[Faces]) -> IntArray:
    """Return faces cut into triangles (T, 3) of the same normals, all from a face's first corner; flat for lines."""
    parts = [np.empty((0, 3), dtype=np.intp)]
    for cells in by_size(faces):
        if cells.shape[1] == 2:
            parts.append(cells[:, [0, 1, 1]])
        parts += [cells[:, [0, i, i + 1]] for i in range(1, cells.shape[1] - 1)]
    return np.concatenate(parts)
