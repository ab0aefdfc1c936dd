"""Numbers of the interpolation, as a value that loads nothing: settings are read before any code is compiled."""

from dataclasses import dataclass
from math import inf
from typing import Literal

from sdm_deflect.deform.errors import InputError

Strategy = Literal["squv", "mv"]
STRATEGIES: tuple[Strategy, ...] = ("squv", "mv")
RuleName = Literal["separated", "worst"]
RULES: tuple[RuleName, ...] = ("separated", "worst")
RepairMode = Literal["auto", "off", "always"]
REPAIR_MODES: tuple[RepairMode, ...] = ("auto", "off", "always")
LARGEST_ANGLE = 90.0
"""Degrees: beyond, a surface has passed its parent."""
LEAST: dict[str, float] = dict.fromkeys(("tolerance", "spacing"), 0.0)
LEAST |= {"initial_surface": 4, "initial_hexahedron": 1, "n_add": 1, "max_centers": 8}
LEAST |= {"spacing_edges": 0.1, "max_steps": 1}
"""Smallest value of each number of `Fitting`."""
ROUNDING = 1e-9
"""A cell that was turned is as good as it was to this share of its quality."""


@dataclass(frozen=True, slots=True)
class Fitting:
    """How the displacement is interpolated: choice of centres (section 4), sites on the box, steps.

    Attributes
    ----------
    strategy : ``"squv"``, centres for each direction, or ``"mv"``, common ones (section 4).
    tolerance : Tol_add and Tol_stop: largest error at a data site, a length; 0: 1 % of the surface's median edge.
    initial_surface, initial_hexahedron : initial centres on the moving surface, and on all else.
    n_add : largest number of centres added per iteration (``"worst"``), or least size of a block.
    max_centers : limit for each direction.
    rule : ``"separated"`` adds large blocks of sites that are no neighbours; ``"worst"`` is the paper's rule.
    spacing : distance of the sites on the box, a length; 0: from `spacing_edges`.
    spacing_edges : the same in median edges of the surface.
    max_steps : largest number of steps in which an angle is taken when cells invert.
    """

    strategy: Strategy = "squv"
    tolerance: float = 0.0
    initial_surface: int = 30
    initial_hexahedron: int = 30
    n_add: int = 10
    max_centers: int = 5000
    rule: RuleName = "separated"
    spacing: float = 0.0
    spacing_edges: float = 1.75
    max_steps: int = 8

    def __post_init__(self) -> None:
        if self.strategy not in STRATEGIES:
            raise InputError(f"strategy = {self.strategy!r} must be {' or '.join(STRATEGIES)}")
        if self.rule not in RULES:
            raise InputError(f"rule = {self.rule!r} must be {' or '.join(RULES)}")
        for name, low in LEAST.items():
            value = getattr(self, name)
            if not low <= value < inf:
                raise InputError(f"{name} = {value} must be a number of at least {low:g}")
        if self.max_centers < self.initial_surface + self.initial_hexahedron:
            raise InputError(
                f"max_centers = {self.max_centers} is fewer than the "
                f"{self.initial_surface + self.initial_hexahedron} initial centres"
            )


@dataclass(frozen=True, slots=True)
class Repair:
    """When cells are mended that a deflection has spoiled.

    Attributes
    ----------
    mode : ``"auto"``: if a cell is inverted, or the least quality of its type fell below `share` of that before;
        ``"always"``: if it fell at all; ``"off"``.
    share : of the undeflected mesh's least quality.
    """

    mode: RepairMode = "auto"
    share: float = 0.9

    def __post_init__(self) -> None:
        if self.mode not in REPAIR_MODES:
            raise InputError(f"repair = {self.mode!r} must be {', '.join(REPAIR_MODES[:-1])} or {REPAIR_MODES[-1]}")
        if not 0.0 < self.share <= 1.0:
            raise InputError(f"repair_share = {self.share} must be a share above 0, at most 1")

    @property
    def wanted(self) -> float:
        """Share of the least quality before, below which cells are mended: less than 1 by rounding."""
        return min(1.0 if self.mode == "always" else self.share, 1.0 - ROUNDING)
