"""A case: one frozen value with all parameters of a run."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.schema import INLINE, check_settings
from sdm_deflect.deform.options import Repair, RepairMode
from sdm_deflect.deform.rbf.fitting import Fitting, Strategy
from sdm_deflect.geometry.confinement import BlockParameters
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.geometry.parameters import LARGEST_TURN, Fighter, check_notch
from sdm_deflect.geometry.quantity import Checked, quantity
from sdm_deflect.meshing.generate.parameters import SCALES, MeshParameters

# What is meshed: the flow around the aircraft, or a Chimera block around the (one) aileron.
Domain = Literal["aircraft", "block"]
# How a surface moves.
# "blended": its trailing edge turns and its hinge edges stay; "rigid": all of it turns; "rooted": a tail turns, and its
# root stays on the fuselage.
Law = Literal["blended", "rigid", "rooted"]


@dataclass(frozen=True, slots=True)
class SurfaceTurn:
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
    ahead: float = quantity(0.0, "m", 0.0, 1.0, "from the hinge line to the front face (hinged surfaces)")
    corners: tuple[tuple[float, float, float], ...] = ()
    """Eight corners of the hexahedron (m) instead of the margins; corner i has the binary code zyx."""
    slide: bool = True
    """Whether nodes slide in the plane of a Chimera face inside the hexahedron; False pins them."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.corners:
            from sdm_deflect.deform.box.hexahedron import Hexahedron  # compiled code: most settings need none

            try:
                Hexahedron(np.array(self.corners, dtype=np.float64))
            except ValueError as error:
                raise InputError(f"confinement.corners: {error}") from None


@dataclass(frozen=True, slots=True)
class Blending(Checked):
    """Parameters of the surface mesh's blending (appendix A)."""

    epsilon: float = quantity(1e4, "1/m", 1.0, 1e8, "shape parameter of the multiquadric")
    strip: float = quantity(0.020, "m", 0.001, 0.5, "width of the spanwise blended strip beside a closed rib")
    root: float = quantity(0.030, "m", 0.001, 0.5, "depth of the extended root region of a tail")


def adaptation(**values: Any) -> Fitting:
    """Return the settings of the interpolation in the paper's cases, with changes."""
    paper = {"tolerance": 8e-5, "initial_surface": 10, "initial_hexahedron": 10, "max_centers": 10_000}
    return Fitting(**{**paper, **values})


@dataclass(frozen=True, slots=True)
class Limits(Checked):
    """Limits of the validation."""

    quality_min: float = quantity(0.25, "", 0.0, 1.0, "smallest mean ratio of the deflected mesh")
    surface_to_cad: float = quantity(1e-8, "m", 0.0, 1.0, "distance of moved nodes from the deflected CAD")
    planarity: float = quantity(1e-9, "m", 0.0, 1.0, "distance of a planar face's nodes from their plane")


@dataclass(frozen=True, slots=True)
class Case:
    """Geometry, mesh, deflection, confinement, adaptation and limits of one run.

    `angle` is in degrees, positive for trailing edge down (rudder: to port). `background` holds the sizes of the
    mesh around a Chimera block, whose own are `mesh`. `repair` and `repair_share` are those of `Repair`.
    """

    name: str
    title: str
    deflections: tuple[SurfaceTurn, ...]
    domain: Domain = "aircraft"
    angle: float = quantity(-12.0, "deg", -LARGEST_TURN, LARGEST_TURN, "deflection, positive is trailing edge down")
    range: tuple[float, float] | None = None
    """Range of angles (deg) of the run's plan; none: from 0 to `angle`."""
    scale: str = "small"
    fighter: Annotated[Fighter, INLINE] = field(default_factory=Fighter)
    notch: float = quantity(0.0, "m", 0.0, 1.0, "chordwise gap ahead of the ailerons, which then turn rigidly; 0: none")
    block: BlockParameters = field(default_factory=BlockParameters)
    mesh: MeshParameters = field(default_factory=lambda: SCALES["small"])
    background: MeshParameters = field(default_factory=lambda: SCALES["small"])
    confinement: Confinement = field(default_factory=Confinement)
    blending: Blending = field(default_factory=Blending)
    adaptation: Fitting = field(default_factory=adaptation)
    repair: RepairMode = "auto"
    repair_share: float = 0.9
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        check_settings(self)
        if not self.deflections:
            raise ValueError("deflections is empty; a case turns at least one control surface")
        if self.scale not in SCALES:
            raise ValueError(f"scale = {self.scale!r} is not one of {', '.join(SCALES)}")
        Repair(self.repair, self.repair_share)
        check_notch(self.fighter, self.notch)
        if self.notch and self.domain == "block":
            raise ValueError(f"notch = {self.notch:g} m in a Chimera block; the whole aircraft alone can have one")
        low, high = self.range or (min(0.0, self.angle), max(0.0, self.angle))
        if not low <= min(0.0, self.angle) <= max(0.0, self.angle) <= high:
            raise ValueError(f"range = {low:g}:{high:g} must hold 0 and {self.angle:g} deg")
        for turn in self.deflections:
            if abs(turn.factor * self.angle) > LARGEST_TURN:
                raise ValueError(
                    f"case.angle = {self.angle:g} deg turns the {turn.surface} by {turn.factor * self.angle:g} deg; "
                    f"at most {LARGEST_TURN:g} deg are possible"
                )

    def law(self, surface: str) -> Law:
        """Return how a control surface moves."""
        if not hinged(surface):
            return "rooted"
        return "rigid" if self.notch and surface != "rudder" else "blended"

    @property
    def ways(self) -> tuple[str, str]:
        """Names of the first surface's senses of rotation by a positive and a negative angle."""
        rudder = self.deflections[0].surface == "rudder"
        return ("to port", "to starboard") if rudder else ("trailing edge down", "trailing edge up")

    @property
    def way(self) -> str:
        """Name of the first surface's sense of rotation by the angle of the case."""
        return self.ways[self.angle < 0.0] if self.angle else "undeflected"

    @property
    def strategy(self) -> Strategy:
        """Choice of centres: for each direction, or common to all."""
        return self.adaptation.strategy


def mesh_parameters(case: Case) -> dict[str, object]:
    """Return everything that the undeflected mesh of a case depends on."""
    parts: dict[str, object] = {"fighter": case.fighter, "mesh": case.mesh, "domain": case.domain}
    if case.domain == "block":
        parts |= {"block": case.block, "surface": case.deflections[0].surface}
    return parts | ({"notch": case.notch} if case.notch else {})
