"""Target sizes, tolerances and acceptance limits of a mesh."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import takewhile
from types import MappingProxyType
from typing import Self

from sdm_deflect.geometry.quantity import Checked, quantity

# Patch of the outer boundary of the flow.
FAR_FIELD = "far_field"

# The far field is as good as free (its cells are few), so its size follows from its distance.
FAR_EDGE = 0.4


def _edge(default: float, where: str) -> float:
    length: float = quantity(default, "m", 1e-4, 1.0, f"target edge length on the {where}")
    return length


@dataclass(frozen=True, slots=True)
class MeshParameters(Checked):
    """Target sizes, tolerances and quality limits of a mesh; the defaults are those of the small scale.

    ValueError for a value outside its range.
    """

    fuselage: float = _edge(0.024, "fuselage")
    fuselage_panel: float = _edge(0.01, "fuselage panels beside the tails")
    fuselage_rear: float = _edge(0.015, "rear of the fuselage")
    canopy: float = _edge(0.012, "canopy")
    inlet: float = _edge(0.016, "inlet")
    pedestal: float = _edge(0.012, "pedestal")
    strake: float = _edge(0.011, "strakes")
    wing: float = _edge(0.017, "wings")
    aileron: float = _edge(0.006, "ailerons")
    tail: float = _edge(0.009, "tails")
    ventral: float = _edge(0.014, "ventral fins")
    fin: float = _edge(0.017, "fin")
    rudder: float = _edge(0.009, "rudder")
    chimera: float = _edge(0.012, "outer faces of a Chimera block")
    corner: float = quantity(0.004, "m", 1e-4, 1.0, "target edge length at sharp corners of faces")
    turn: float = quantity(30.0, "deg", 2.0, 90.0, "largest angle by which a curved face turns along an edge")
    edge_cells: float = quantity(1.0, "", 0.2, 20.0, "cells along a short CAD edge")
    gap_cells: float = quantity(2.0, "", 0.5, 20.0, "cells across a gap between two faces")
    growth: float = quantity(0.35, "", 0.05, 1.0, "growth of the edge length per metre away from the surface")
    far_field: float = quantity(10.0, "body lengths", 0.5, 100.0, "distance of the far field from the body")
    envelope: float = quantity(1.2e-4, "m", 1e-6, 1e-2, "how far the mesher may stray from its surface input")
    aim: float = quantity(0.32, "", 0.05, 0.6, "mean ratio at which the mesher leaves a cell alone")
    refinements: int = quantity(0, "", 0, 3, "uniform refinements, each of which halves all edges")
    seed: int = quantity(1, "", 0, 2**31, "number from which the volume mesher starts; each further attempt adds 1")
    max_attempts: int = quantity(4, "", 1, 20, "meshes tried before giving up")
    max_seconds: float = quantity(3600.0, "s", 1.0, 1e6, "time after which an attempt ends the run")
    accept_min: float = quantity(0.3, "", 0.0, 1.0, "smallest mean ratio of an acceptable mesh")
    accept_mean: float = quantity(0.87, "", 0.0, 1.0, "smallest average mean ratio of an acceptable mesh")
    accept_below: float = quantity(2e-4, "", 0.0, 1.0, "largest acceptable share of cells below 0.4")

    def edge_length(self, patch: str) -> float:
        """Return the target edge length in metres on a patch, left or right; ValueError if there is none."""
        component = patch.removesuffix("_left").removesuffix("_right")
        if component not in COMPONENTS:
            raise ValueError(f"no target edge length for patch {patch!r}; there are {', '.join(COMPONENTS)}")
        return float(getattr(self, component))

    def scaled(self, factor: float) -> Self:
        """Return the parameters with all edge lengths and the envelope multiplied by a factor."""
        lengths = {name: factor * getattr(self, name) for name in (*COMPONENTS, "corner", "envelope")}
        return replace(self, **lengths)


# The parts of an aircraft that have an edge length of their own: the fields before `corner`.
COMPONENTS = tuple(takewhile(lambda name: name != "corner", (field.name for field in fields(MeshParameters))))


def _for_refined(base: MeshParameters) -> MeshParameters:
    """Return lower quality limits for a refined mesh, because its new nodes are moved onto curved faces."""
    return replace(base, refinements=1, accept_min=0.25, accept_mean=0.86, accept_below=5e-4)


_SMALL = MeshParameters()
_MEDIUM = _for_refined(_SMALL)
# Edge lengths before refinement. The paper's full model has a coarse aileron and fine tails; growth decides how many
# points their hexahedra hold, and the rest of the aircraft is as fine as its total asks.
_PAPER = replace(
    _MEDIUM,
    fuselage=0.0047,
    fuselage_panel=0.0037,
    fuselage_rear=0.0048,
    canopy=0.0038,
    inlet=0.0042,
    pedestal=0.0042,
    strake=0.0034,
    wing=0.0105,
    aileron=0.015,
    tail=0.0023,
    ventral=0.004,
    fin=0.004,
    rudder=0.004,
    corner=0.006,
    edge_cells=0.6,
    growth=0.4,
    envelope=6e-5,
)
_BLOCK = replace(
    _SMALL,
    aileron=0.55 * _SMALL.aileron,
    wing=0.55 * _SMALL.wing,
    chimera=0.8 * _SMALL.chimera,
    gap_cells=1.5 * _SMALL.gap_cells,
)
_PAPER_BLOCK = replace(
    _MEDIUM, aileron=0.00115, wing=0.0018, chimera=0.0034, corner=0.003, gap_cells=4.0, growth=0.17, envelope=6e-5
)

# Sizes of the aircraft's mesh.
SCALES: Mapping[str, MeshParameters] = MappingProxyType({"small": _SMALL, "medium": _MEDIUM, "paper": _PAPER})

# Sizes of a Chimera block's mesh.
BLOCK_SCALES: Mapping[str, MeshParameters] = MappingProxyType(
    {"small": _BLOCK, "medium": _for_refined(_BLOCK), "paper": _PAPER_BLOCK}
)

# Sizes of the mesh around a Chimera block: it only has to give donors, and the paper does not count it.
BACKGROUND_SCALES: Mapping[str, MeshParameters] = MappingProxyType(
    {"small": _SMALL, "medium": _MEDIUM, "paper": _MEDIUM}
)
