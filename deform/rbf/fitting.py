"""Numbers of the interpolation, as a value that loads nothing: settings are read before any code is compiled."""

from dataclasses import dataclass
from math import inf
from typing import Literal, NamedTuple

from sdm_deflect.deform.base.errors import InputError

Strategy = Literal["squv", "mv"]
STRATEGIES: tuple[Strategy, ...] = ("squv", "mv")
RuleName = Literal["separated", "worst"]
RULES: tuple[RuleName, ...] = ("separated", "worst")
KernelName = Literal["tps", "mq", "wendland", "cubic"]
Polynomial = Literal["linear", "constant", "none"]


class Needs(NamedTuple):
    """What a kernel needs for a solution that is unique.

    Attributes
    ----------
    name : of the kernel, in words.
    order : of its conditional positive definiteness: 2 needs the linear polynomial, 1 the constant, 0 none.
    radius : whether it has one.
    """

    name: str
    order: int
    radius: bool


KERNELS: dict[KernelName, Needs] = {
    "tps": Needs("thin plate spline", 2, False),
    "mq": Needs("multiquadric", 1, True),
    "wendland": Needs("Wendland C2 function", 0, True),
    "cubic": Needs("cubic", 2, False),
}
ORDERS: dict[Polynomial, int] = {"linear": 2, "constant": 1, "none": 0}
"""Largest order of kernels that each polynomial serves."""
RepairMode = Literal["auto", "off", "always"]
REPAIR_MODES: tuple[RepairMode, ...] = ("auto", "off", "always")
LARGEST_ANGLE = 90.0
"""Degrees: beyond, a surface has passed its parent."""
LEAST: dict[str, float] = dict.fromkeys(("tolerance", "spacing", "kernel_radius"), 0.0)
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
    kernel : ``"tps"``, the thin plate spline; ``"mq"``, the multiquadric; ``"wendland"``, Wendland's C2 function with
        compact support; ``"cubic"``.
    kernel_radius : a length: of a multiquadric where it turns from a parabola into a cone, of Wendland's function
        where it ends; 0: chosen by the box.
    polynomial : added to the kernels: ``"linear"``, ``"constant"`` or ``"none"``; at least what the kernel needs.
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
    kernel: KernelName = "tps"
    kernel_radius: float = 0.0
    polynomial: Polynomial = "linear"

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
        self._check_kernel()

    def _check_kernel(self) -> None:
        """Raise InputError if the kernel lacks what it needs, or is given what it has no use for."""
        for name, known in (("kernel", KERNELS), ("polynomial", ORDERS)):
            if getattr(self, name) not in known:
                raise InputError(f"{name} = {getattr(self, name)!r} must be one of {', '.join(known)}")
        needs = KERNELS[self.kernel]
        if self.kernel_radius and not needs.radius:
            others = " or ".join(name for name, one in KERNELS.items() if one.radius)
            raise InputError(
                f"kernel_radius = {self.kernel_radius:g}: the {needs.name} has none; leave it out, or set "
                f"kernel = {others}"
            )
        if ORDERS[self.polynomial] < needs.order:
            enough = " or ".join(name for name, order in ORDERS.items() if order >= needs.order)
            raise InputError(
                f"polynomial = {self.polynomial}: the {needs.name} is conditionally positive definite of order "
                f"{needs.order} and needs polynomial = {enough}"
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
