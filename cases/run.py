"""What a run produced."""

from dataclasses import dataclass, field

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.deflect import Deflected
from sdm_deflect.cases.validation import Check
from sdm_deflect.deform.quality import Quality
from sdm_deflect.meshing.mesh import TetMesh


@dataclass(frozen=True, slots=True)
class MeshOrigin:
    """How the undeflected mesh came to be: kept with it in the cache.

    Attributes
    ----------
    boundary_to_cad_max : largest distance (m) of a boundary node from the CAD.
    attempts, seconds : meshes tried until one passed verification, and the time they took.
    """

    boundary_to_cad_max: float
    attempts: int
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A finished case.

    Attributes
    ----------
    mesh, deflected : the mesh before and after; same cells, same order.
    origin : how the undeflected mesh came to be.
    deflections : one entry per control surface.
    whole_mesh_seconds : time to evaluate the first interpolant at every mesh node, for comparison.
    checks : the validation.
    seconds : per stage.
    background : the mesh around a Chimera block; None without a block.
    pinned : quality inside the hexahedron with a pinned instead of a sliding Chimera face, for comparison.
    """

    case: Case
    mesh: TetMesh
    origin: MeshOrigin
    deflected: TetMesh
    deflections: tuple[Deflected, ...]
    whole_mesh_seconds: float
    checks: tuple[Check, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    background: TetMesh | None = None
    pinned: Quality | None = None

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return all(check.passed for check in self.checks)
