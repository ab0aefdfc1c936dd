"""Options of the fit, as values that load nothing: settings are read before any code is compiled."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.schema import ONLY_SET, Doc, Option, Range, Spelling, check_settings

Strategy = Literal["squv", "mv"]
RuleName = Literal["separated", "worst"]
KernelName = Literal["tps", "mq", "wendland", "cubic"]
Polynomial = Literal["linear", "constant", "none"]
Processor = Literal["cpu", "gpu"]
# Largest order of the kernels that each polynomial supports.
ORDERS: dict[Polynomial, int] = {"linear": 2, "constant": 1, "none": 0}


class Needs(NamedTuple):
    """What a kernel requires for a unique solution.

    Attributes
    ----------
    name : name of the kernel, in words.
    order : order of conditional positive definiteness: 2 requires the linear polynomial, 1 the constant, 0 none.
    radius : whether the kernel has a radius.
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


def steps_of(value: object) -> object:
    """Return the largest number of steps, given as a number or as text; ``auto`` means the default."""
    if not isinstance(value, str):
        return value
    if value != "auto" and not (value.isascii() and value.isdigit()):
        raise InputError(f"{shortened(value)} must be auto or a whole number from 1")
    return Fitting().max_steps if value == "auto" else int(value)


@dataclass(frozen=True, slots=True)
class Fitting:
    """Options of the fit: choice of centres (section 4), sites on the box, steps."""

    # fmt: off
    strategy: Annotated[Strategy, Doc("Accuracy", "squv: centres for each direction; mv: common centres.")] = "squv"
    tolerance: Annotated[float, Range(0.0), Doc(
        "Accuracy",
        "Largest error at a data site, a length; 0: 1 % of the surface's median edge.")] = 0.0
    initial_surface: Annotated[int, Range(4), ONLY_SET, Doc(
        "Accuracy", "Centres at the start on the moving surface.")] = 30
    initial_hexahedron: Annotated[int, Range(1), ONLY_SET, Doc(
        "Accuracy", "Centres at the start on the box and on patches that stay.")] = 30
    n_add: Annotated[int, Range(1), ONLY_SET, Doc(
        "Accuracy", "Centres added in a round (`rule` worst), or the least size of a block (separated).")] = 10
    max_centers: Annotated[int, Range(8), ONLY_SET, Doc(
        "Accuracy", "Largest number of centres in each direction.")] = 5000
    rule: Annotated[RuleName, ONLY_SET, Doc(
        "Accuracy", "separated: add blocks of sites that are no neighbours; worst: the paper's rule.")] = "separated"
    spacing: Annotated[float, Range(0.0), ONLY_SET, Doc(
        "Accuracy", "Distance of the sites on the box, a length; 0: from `spacing_edges`.")] = 0.0
    spacing_edges: Annotated[float, Range(0.1), ONLY_SET, Doc(
        "Accuracy", "Distance of the sites on the box in median edges of the surface.")] = 1.75
    max_steps: Annotated[int, Range(1), Option("--steps", "auto|N"), Spelling(read=steps_of), Doc(
        "Accuracy", "Largest number of steps for an angle, if cells invert.")] = 8
    kernel: Annotated[KernelName, ONLY_SET, Doc(
        "Accuracy", "tps: thin plate spline; mq: multiquadric; wendland: Wendland's C2 function; cubic.")] = "tps"
    kernel_radius: Annotated[float, Range(0.0), ONLY_SET, Doc(
        "Accuracy", "Radius of mq or wendland, a length; 0: the surface's median edge, or the box's diagonal.")] = 0.0
    polynomial: Annotated[Polynomial, ONLY_SET, Doc(
        "Accuracy", "Polynomial beside the kernel: tps and cubic need linear, mq at least constant.")] = "linear"
    processor: Annotated[Processor, ONLY_SET, Doc(
        "Accuracy", "gpu: sum on a CUDA card, whose last digits differ; pays above some 1e6 nodes.")] = "cpu"
    # fmt: on

    def __post_init__(self) -> None:
        check_settings(self)
        if self.max_centers < self.initial_surface + self.initial_hexahedron:
            raise InputError(
                f"max_centers = {self.max_centers} is fewer than the "
                f"{self.initial_surface + self.initial_hexahedron} initial centres"
            )
        self._check_kernel()

    def _check_kernel(self) -> None:
        """Raise InputError if the kernel lacks what it requires, or is given a radius that it does not have."""
        needs = KERNELS[self.kernel]
        if self.kernel_radius and not needs.radius:
            others = " or ".join(name for name, kernel in KERNELS.items() if kernel.radius)
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
