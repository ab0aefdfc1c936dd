"""A job: one frozen value that says what is to move in a mesh, and how."""

from dataclasses import dataclass, field

from sdm_deflect.cases.case import STRATEGIES, AdaptationSettings, Strategy
from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.box import Automatic, BoxRule
from sdm_deflect.cases.own.motion import Moving
from sdm_deflect.cases.own.walls import SHAPES

LARGEST_TOLERANCE = 1.0  # of AdaptationSettings


@dataclass(frozen=True, slots=True)
class Sliding:
    """A patch whose nodes stay on its shape.

    Attributes
    ----------
    patch : name or wildcard.
    shape : a key of `walls.SHAPES`.
    """

    patch: str
    shape: str

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(f"--slide {self.patch}:{self.shape}: the shape must be {' or '.join(SHAPES)}")


@dataclass(frozen=True, slots=True)
class Fitting:
    """How the displacement is interpolated.

    Attributes
    ----------
    strategy : ``"squv"``, centres for each direction, or ``"mv"``, common ones (section 4).
    tolerance : largest error at a data site in the mesh's unit; 0: `TOLERANCE_EDGES` of the surface's median edge.
    spacing_edges : distance of the sites on the box, in median edges of the surface.
    max_centers : limit for each direction; the rest of the error is spread near the surface.
    max_steps : largest number of steps in which an angle is taken when cells invert.
    """

    strategy: Strategy = "squv"
    tolerance: float = 0.0
    spacing_edges: float = 1.75
    max_centers: int = 5000
    max_steps: int = 8

    def __post_init__(self) -> None:
        if self.strategy not in STRATEGIES:
            raise InputError(f"strategy = {self.strategy!r} must be {' or '.join(STRATEGIES)}")
        for name, low in (("tolerance", 0.0), ("spacing_edges", 0.1), ("max_centers", 100), ("max_steps", 1)):
            if not getattr(self, name) >= low:
                raise InputError(f"{name} = {getattr(self, name)} must be at least {low:g}")

    def settings(self, tolerance: float) -> AdaptationSettings:
        """Return the settings of the adaptation for a tolerance in the mesh's unit."""
        return AdaptationSettings(
            initial_surface=30, initial_hexahedron=30, tolerance=min(tolerance, LARGEST_TOLERANCE),
            max_centers=self.max_centers,
        )  # fmt: skip


TOLERANCE_EDGES = 0.01


@dataclass(frozen=True, slots=True)
class Job:
    """What moves, what stays, what slides, and in which box.

    Attributes
    ----------
    surfaces : the moving surfaces; the first one's amount is the job's angle, the others keep their ratio to it.
    fixed : patches that do not move; wildcards allowed.
    slides : patches that stay on a plane or a cylinder.
    box : rule for the confining hexahedron.
    zones : zones that deform beside those with a moving surface; ``("*",)`` for all.
    fitting : numbers of the interpolation.
    allow_inverted : whether a mesh that has inverted cells is taken.
    """

    surfaces: tuple[Moving, ...]
    fixed: tuple[str, ...] = ()
    slides: tuple[Sliding, ...] = ()
    box: BoxRule = field(default_factory=Automatic)
    zones: tuple[str, ...] = ()
    fitting: Fitting = field(default_factory=Fitting)
    allow_inverted: bool = False

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise InputError("no surface to move: name one with --surface")

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.surfaces[0].amount

    def amounts(self, angle: float) -> tuple[float, ...]:
        """Return the amount of each surface when the first one's is `angle`."""
        return tuple(self.ratio(moving) * angle for moving in self.surfaces)

    def ratio(self, moving: Moving) -> float:
        """Return a surface's amount as a multiple of the first one's; 1 where that is zero."""
        return moving.amount / self.angle if self.angle else 1.0
