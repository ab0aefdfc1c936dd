"""Colours of the studies' pictures: those of the pages, and greys that tell the components apart."""

from matplotlib.colors import to_rgb

from sdm_deflect.cases.report import colours

Colour = tuple[int, int, int]
Direction = tuple[float, float, float]
# What turns is blue as everywhere; what stays has greys.
COMPONENTS = {
    "fuselage": colours.STAYS,
    "canopy": "#7b858f",
    "inlet": "#9aa3ad",
    "pedestal": "#e3e6ea",
    "strake": "#aab3bd",
    "wing": "#dde1e6",
    "aileron": colours.MOVES,
    "tail": colours.MOVES,
    "ventral": "#8a949e",
    "fin": "#b9c1c9",
    "rudder": colours.MOVES,
    "chimera": colours.BOX,
}


def rgb_of(colour: str) -> Colour:
    """Return a colour as three numbers, 0 to 255."""
    r, g, b = (round(255 * share) for share in to_rgb(colour))
    return r, g, b


BLUE, ORANGE, NAVY, BOX = (rgb_of(name) for name in (colours.MOVES, colours.WORSE, colours.NAVY, colours.BOX))
GREY: Colour = rgb_of(colours.STAYS)


def component(patch: str) -> str:
    """Return the component that a patch belongs to; left and right are alike."""
    stem = patch.removesuffix("_left").removesuffix("_right")
    return "fuselage" if stem.startswith("fuselage") else stem


def patch_colour(patch: str, moving: bool = False) -> Colour:
    """Return the colour of a patch's component; of others whether they move."""
    return rgb_of(COMPONENTS.get(component(patch)) or (colours.MOVES if moving else colours.STAYS))
