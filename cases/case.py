"""A case: one frozen value that says everything about a run."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sdm_deflect.deform.rbf.selection import GreedyOptions, Rule, Separated, Worst
from sdm_deflect.deform.volume.hexahedron import Hexahedron
from sdm_deflect.geometry.confinement import BlockParameters
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.quantity import check_quantities, quantity
from sdm_deflect.meshing.generate.parameters import SCALES, MeshParameters

Domain = Literal["aircraft", "block"]
"""What is meshed: the flow around the aircraft, or a Chimera block around the (one) aileron."""

RuleName = Literal["separated", "worst"]
RULES: dict[RuleName, Rule] = {"separated": Separated(), "worst": Worst()}
Strategy = Literal["squv", "mv"]
LARGEST_ANGLE = 60.0
STRATEGIES: tuple[Strategy, ...] = ("squv", "mv")


@dataclass(frozen=True, slots=True)
class Deflection:
    """One control surface of a case: it turns by `factor` times the angle of the case."""

    surface: str
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Confinement:
    """The hexahedron of section 3, measured from the control surface, and its data sites."""

    aft: float = quantity(0.050, "m", 0.005, 1.0, "from the trailing edge to the rear face")
    outboard: float = quantity(0.045, "m", 0.005, 1.0, "from the tip to the outer face")
    up: float = quantity(0.055, "m", 0.005, 1.0, "above the hinge line (rudder: to starboard)")
    down: float = quantity(0.055, "m", 0.005, 1.0, "below the hinge line (rudder: to port)")
    spacing: float = quantity(0.0, "m", 0.0, 1.0, "between sites on the faces; 0: from the local edge length")
    corners: tuple[tuple[float, float, float], ...] = ()
    """Eight corners of the hexahedron (m) instead of the margins; corner i has the binary code zyx."""
    slide: bool = True
    """Whether nodes slide in the plane of a Chimera face inside the hexahedron; False pins them."""
    spacing_edges: float = quantity(1.75, "edges", 0.25, 10.0, "spacing over the median edge of the moving surface")

    def __post_init__(self) -> None:
        check_quantities(self, "confinement")
        if self.corners:
            try:
                Hexahedron(np.array(self.corners, dtype=np.float64))
            except ValueError as error:
                raise ValueError(f"confinement.corners: {error}") from None


@dataclass(frozen=True, slots=True)
class Blending:
    """How the surface mesh follows (appendix A)."""

    epsilon: float = quantity(1e4, "1/m", 1.0, 1e8, "shape parameter of the multiquadric")
    strip: float = quantity(0.020, "m", 0.001, 0.5, "width of the spanwise blended strip beside a closed rib")
    root: float = quantity(0.030, "m", 0.001, 0.5, "depth of the extended root region of a tail")

    def __post_init__(self) -> None:
        check_quantities(self, "blending")


@dataclass(frozen=True, slots=True)
class AdaptationSettings:
    """Choice of centres (section 4) for every control surface of the case."""

    initial_surface: int = quantity(10, "centres", 4, 100_000, "initial centres on the control surface")
    initial_hexahedron: int = quantity(10, "centres", 1, 100_000, "initial centres on the hexahedron")
    n_add: int = quantity(10, "centres", 1, 100_000, "largest number of centres added per iteration")
    tolerance: float = quantity(8e-5, "m", 1e-12, 1.0, "Tol_add and Tol_stop")
    max_centers: int = quantity(10_000, "centres", 8, 1_000_000, "limit on the number of centres")
    rule: RuleName = "separated"
    """"separated" adds large blocks of sites that are no neighbours; "worst" is the paper's rule."""

    def __post_init__(self) -> None:
        check_quantities(self, "adaptation")
        if self.rule not in RULES:
            raise ValueError(f"adaptation.rule = {self.rule!r} is not one of {', '.join(RULES)}")
        if self.max_centers < self.initial_surface + self.initial_hexahedron:
            raise ValueError(
                f"adaptation.max_centers = {self.max_centers} is fewer than the "
                f"{self.initial_surface + self.initial_hexahedron} initial centres"
            )

    @property
    def options(self) -> GreedyOptions:
        """The options of the greedy algorithm."""
        return GreedyOptions(
            n_add=self.n_add, tol_add=self.tolerance, tol_stop=self.tolerance, max_centers=self.max_centers
        )


@dataclass(frozen=True, slots=True)
class Limits:
    """What a validation demands."""

    quality_min: float = quantity(0.25, "-", 0.0, 1.0, "smallest mean ratio of the deflected mesh")
    surface_to_cad: float = quantity(1e-8, "m", 0.0, 1.0, "distance of moved nodes from the deflected CAD")
    planarity: float = quantity(1e-9, "m", 0.0, 1.0, "distance of a planar face's nodes from their plane")

    def __post_init__(self) -> None:
        check_quantities(self, "limits")


@dataclass(frozen=True, slots=True)
class Case:
    """Geometry, mesh, deflection, confinement, adaptation and limits of one run.

    `angle` is in degrees, positive for trailing edge down (rudder: to port). `background` holds the sizes of the
    mesh around a Chimera block, whose own are `mesh`.
    """

    name: str
    title: str
    deflections: tuple[Deflection, ...]
    domain: Domain = "aircraft"
    angle: float = quantity(-12.0, "deg", -LARGEST_ANGLE, LARGEST_ANGLE, "deflection, positive is trailing edge down")
    scale: str = "small"
    strategy: Strategy = "squv"
    fighter: Fighter = field(default_factory=Fighter)
    block: BlockParameters = field(default_factory=BlockParameters)
    mesh: MeshParameters = field(default_factory=lambda: SCALES["small"])
    background: MeshParameters = field(default_factory=lambda: SCALES["small"])
    confinement: Confinement = field(default_factory=Confinement)
    blending: Blending = field(default_factory=Blending)
    adaptation: AdaptationSettings = field(default_factory=AdaptationSettings)
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        check_quantities(self, "case")
        if self.scale not in SCALES:
            raise ValueError(f"scale = {self.scale!r} is not one of {', '.join(SCALES)}")
        if self.strategy not in STRATEGIES:
            raise ValueError(f"strategy = {self.strategy!r} is not one of {', '.join(STRATEGIES)}")
        for one in self.deflections:
            if abs(one.factor * self.angle) > LARGEST_ANGLE:
                raise ValueError(
                    f"case.angle = {self.angle:g} deg turns the {one.surface} by {one.factor * self.angle:g} deg; "
                    f"at most {LARGEST_ANGLE:g} deg are possible"
                )
