"""Options of a job, as values that load nothing: settings are read before any code is compiled."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from sdm_deflect.base.schema import INLINE, ONLY_SET, Doc, Option, Range, Spelling, check_settings

from .rbf.fitting import Fitting

RepairMode = Literal["auto", "off", "always"]
# Degrees: beyond, a surface turns past its parent.
LARGEST_ANGLE = 90.0
# Relative difference of a cell's quality that turning it may cause.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Repair:
    """When cells are repaired that a deflection has spoiled, and how good they must become."""

    # fmt: off
    mode: Annotated[RepairMode, Spelling("repair"), Doc(
        "Repair", "auto: repair if cells are inverted, or the worst cell of a type keeps less than `repair_share` of "
        "its quality; always: if it lost any; off: never.")] = "auto"
    share: Annotated[float, Range(0.0, 1.0, above=True), Spelling("repair_share"), ONLY_SET, Doc(
        "Repair", "Share of the worst cell's quality below which auto repairs.")] = 0.9
    min_quality: Annotated[float, Range(0.0, 1.0), Doc(
        "Repair", "Share of its quality that the worst cell of each type must keep; 0: no such check.")] = 0.1
    # fmt: on

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def wanted(self) -> float:
        """Share of the least quality before, below which cells are repaired; less than 1 by rounding."""
        return min(1.0 if self.mode == "always" else self.share, 1.0 - ROUNDING)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOptions:
    """Options that a job and a user's settings share."""

    # fmt: off
    fixed: Annotated[tuple[str, ...], Option(metavar="NAME"), Doc(
        "What stays", "Patches that stay; wildcards such as 'wing*'.")] = ()
    zones: Annotated[tuple[str, ...], Option("--zone", "NAME"), Doc(
        "Box", "Further zones of the file that deform; '*' for all.")] = ()
    near_wall: Annotated[bool, ONLY_SET, Doc(
        "Box", "Whether the mesh near walls follows them, so that prism layers keep their heights.",
        "Nodes of fixed patches in the box are then data sites. Without it, as in the paper, no other patch may reach "
        "into the box.")] = True
    allow_inverted: Annotated[bool, Doc("Repair", "Take a mesh that already has inverted cells.")] = False
    force: Annotated[bool, Doc("What moves", "Take a hinge farther from its surface than the surface is wide.")] = False
    # fmt: on
    fitting: Annotated[Fitting, INLINE] = field(default_factory=Fitting)
    repair: Annotated[Repair, INLINE] = field(default_factory=Repair)
