"""Colours that colour-blind readers can tell apart."""

from collections.abc import Iterable
from zlib import crc32

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize, to_rgb

from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.report.scene import Colour

QUALITY_MAP = "cividis"
QUALITY_RANGE = Normalize(0.4, 1.0)
"""Mean ratios below 0.4 get the darkest colour."""

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

OTHERS = ("#4477aa", "#ee8866", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbcc33", "#99ddff")
"""For patches that are no component of our aircraft: taken in turn by the letters of the name."""

DARK: Colour = (90, 90, 90)
GREY: Colour = (190, 190, 190)
MAGENTA: Colour = (204, 0, 204)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)


def component(patch: str) -> str:
    """Return the component that a patch belongs to; left and right are alike."""
    stem = patch.removesuffix("_left").removesuffix("_right")
    return "fuselage" if stem.startswith("fuselage") else stem


def patch_colour(patch: str) -> Colour:
    """Return the colour of a patch's component."""
    name = component(patch)
    colour = COMPONENTS.get(name) or OTHERS[crc32(name.encode()) % len(OTHERS)]
    r, g, b = (round(255 * share) for share in to_rgb(colour))
    return r, g, b


def hexadecimal(colour: Colour) -> str:
    """Return a colour as a web page wants it."""
    r, g, b = colour
    return f"#{r:02x}{g:02x}{b:02x}"


def components_of(patches: Iterable[str]) -> list[str]:
    """Return the components among patches that have a colour, in the order of `COMPONENTS`."""
    present = {component(patch) for patch in patches}
    return [name for name in COMPONENTS if name in present]


def quality_rgb(quality: FloatArray) -> IndexArray:
    """Return the colours (F, 3) of mean ratios (F,)."""
    shades = mpl.colormaps[QUALITY_MAP](QUALITY_RANGE(quality))[:, :3]
    return np.asarray(np.rint(255.0 * shades), dtype=np.intp)
