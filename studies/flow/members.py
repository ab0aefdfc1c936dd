"""The meshes of the study, each a case of OpenFOAM: undeflected, deflected, repaired, and new."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress
from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.pipeline import cached_mesh, mesh_of_case
from sdm_deflect.cases.aircraft.reference import surface_turns
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.options import RepairMode
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.parameters import LARGEST_TURN
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio
from studies.flow.case import setup_of
from studies.flow.openfoam import write_case
from studies.flow.setup import FreeStream, Setup

# Iterations of first order, which let the waves of the start leave, at the beginning of the undeflected flow.
SETTLING = 800
UNDEFLECTED, DEFLECTED, REPAIRED, FRESH = "undeflected", "deflected", "repaired", "fresh"
# A new mesh of the undeflected CAD, which is then deflected as a run does it.
FRESH_DEFLECTED = "fresh-deflected"
# Seeds from one new mesh to the next: more than attempts at one mesh take.
SEEDS = 100
MOST = {"fresh": 20, "iterations": 100_000}


@dataclass(frozen=True, slots=True)
class FlowStudy:
    """What is studied.

    Attributes
    ----------
    case : the aircraft, its mesh and what turns; its domain is the whole aircraft.
    angles : degrees; at the first one there are `fresh` new meshes, at each other one there is one. If `fresh` is
        more than one, there are so many undeflected ones, too: an increment is the difference of two meshes. These are
        deflected to the first angle as well.
    stream : the free stream.
    iterations : of each member; the undeflected one begins with `settling` of first order.
    assignments : what was changed in the case, as texts.
    """

    case: Case
    angles: tuple[float, ...]
    stream: FreeStream
    fresh: int = 3
    iterations: int = 3000
    settling: int = SETTLING
    assignments: tuple[str, ...] = ()

    @property
    def surface(self) -> str:
        """The control surface whose hinge moment counts."""
        return self.case.deflections[0].surface

    def at(self, angle: float) -> Case:
        """Return the case at another angle."""
        return replace(self.case, angle=angle)

    def setup(self, first: bool) -> Setup:
        """Return the flow to compute, on the `first` mesh or on one that starts from its flow."""
        return replace(
            setup_of(self.case.fighter, self.stream, self.iterations), settling=self.settling if first else 0
        )


def study_of(
    case: Case,
    angles: Sequence[float] = (),
    stream: FreeStream | None = None,
    fresh: int = 3,
    iterations: int = 3000,
    assignments: Sequence[str] = (),
) -> FlowStudy:
    """Return a study of a case, at its own angle if no `angles` are given.

    A case in a Chimera block is studied with the gap in the mesh of the whole aircraft. Raises InputError for an
    unknown case, for one with several surfaces, and for numbers out of range.
    """
    for what, value in (("fresh", fresh), ("iterations", iterations)):
        if not 1 <= value <= MOST[what]:
            raise InputError(f"{what} = {value} must be between 1 and {MOST[what]}")
    if len(case.deflections) > 1:
        raise InputError(f"case {case.name}: turns {len(case.deflections)} surfaces; this study is of one")
    if case.domain == "block":
        case = replace(case, domain="aircraft", mesh=case.background)
    wanted = tuple(angles) or (case.angle,)
    if 0.0 in wanted:
        raise InputError("angles: 0 is the undeflected mesh, which is computed anyway; leave it out")
    for angle in wanted:
        if not abs(angle) <= LARGEST_TURN:
            raise InputError(f"angles: {angle:g} deg is outside -{LARGEST_TURN:g} ... {LARGEST_TURN:g} deg")
    settling = min(SETTLING, iterations // 3)
    return FlowStudy(case, wanted, stream or FreeStream(), fresh, iterations, settling, tuple(sorted(assignments)))


@dataclass(frozen=True, slots=True)
class Member:
    """One mesh: its kind, its angle (degrees, 0 undeflected), its number among the new ones, from 1."""

    kind: str
    angle: float = 0.0
    number: int = 0

    @property
    def name(self) -> str:
        """Name of its folder, such as ``-12-fresh-2`` or ``undeflected-fresh-1``."""
        if self.kind == UNDEFLECTED:
            return self.kind
        number = [str(self.number)] if self.number else []
        return "-".join([f"{self.angle:+g}" if self.angle else UNDEFLECTED, self.kind, *number])


def fresh_members(study: FlowStudy) -> Iterator[Member]:
    """Yield the members whose meshes are new."""
    several = (0.0, study.angles[0]) if study.fresh > 1 else ()
    for angle in dict.fromkeys((*several, *study.angles)):
        for number in range(1, (study.fresh if angle in several else 1) + 1):
            yield Member(FRESH, angle, number)


def moved_meshes(study: FlowStudy, mesh: Mesh, progress: Progress) -> Iterator[tuple[Member, Mesh]]:
    """Yield the meshes that are deflected: without repair, and with it where that gives another mesh.

    One with inverted cells is left out: no flow can be computed on it.
    """
    for k, angle in enumerate(study.angles):
        progress(f"{angle:+g} deg", k / len(study.angles))
        plain: FloatArray | None = None
        modes: tuple[tuple[str, RepairMode], ...] = ((DEFLECTED, "off"), (REPAIRED, study.case.repair))
        for kind, mode in modes:
            case = replace(study.at(angle), repair=mode)
            try:
                points = moved_points(case, mesh)
            except InputError:
                if kind == REPAIRED:
                    raise
                continue
            moved = mesh.with_points(points)
            if mean_ratio(points, tets_of(mesh)).min() <= 0.0 or (plain is not None and np.array_equal(points, plain)):
                continue
            plain = points
            yield Member(kind, angle), moved


def fresh_deflected_meshes(
    study: FlowStudy, fresh: Iterable[tuple[Member, Mesh]], progress: Progress
) -> Iterator[tuple[Member, Mesh]]:
    """Yield those of the `fresh` meshes that are undeflected, deflected to the study's first angle."""
    case = study.at(study.angles[0])
    undeflected = [(member, mesh) for member, mesh in fresh if not member.angle]
    for k, (member, mesh) in enumerate(undeflected):
        progress(f"{member.name} to {case.angle:+g} deg", k / len(undeflected))
        points = moved_points(case, mesh)
        if mean_ratio(points, tets_of(mesh)).min() > 0.0:
            yield Member(FRESH_DEFLECTED, case.angle, member.number), mesh.with_points(points)


def moved_points(case: Case, flow: Mesh) -> FloatArray:
    """Return the points (N, 3) of a case's mesh, deflected; InputError as a run has it."""
    plan = plan_of(case, flow)
    return deflect(plan).points


def fresh_mesh(study: FlowStudy, member: Member, watch: Stopwatch) -> Mesh:
    """Return a new mesh around the CAD at the member's angle, blended as the mesh is or turned rigidly."""
    from sdm_deflect.geometry.aircraft import build  # the CAD kernel
    from sdm_deflect.meshing.generate.generation import Generated, generate

    case = study.at(member.angle)
    sizes = replace(case.mesh, seed=case.mesh.seed + SEEDS * member.number)
    turns = cad_turns(case) if member.angle else {}
    parts: dict[str, object] = {
        "fighter": case.fighter, "mesh": sizes, "domain": case.domain,
        "turns": {name: [turn.angle, turn.mode, turn.strip] for name, turn in turns.items()},
    }  # fmt: skip
    parts |= {"notch": case.notch} if case.notch else {}

    def made() -> Generated:
        with watch.stage("fresh mesh") as progress:
            done = generate(build(case.fighter, turns, notch=case.notch), sizes, progress=progress)
            progress(f"{member.name}: {len(tets_of(done.mesh))} cells", 1.0)
        return done

    return cached_mesh(parts, made, watch, True)[0]


def cad_turns(case: Case) -> dict[str, CadTurn]:
    """Return how the CAD of a case turns: as the mesh does.

    Without a gap a hinged surface is blended, with a strip beside the rib; behind a gap it is turned rigidly, as tails
    always are.
    """
    gap = case.fighter.aileron.gap > 0.0
    turns = surface_turns(case).items()
    return {name: CadTurn(turn.angle) if gap and name != "rudder" else turn for name, turn in turns}


def undeflected_mesh(study: FlowStudy, watch: Stopwatch) -> Mesh:
    """Return the mesh that is deflected, from the cache if it is there."""
    return mesh_of_case(study.case, watch)[0]


def write_member(study: FlowStudy, member: Member, mesh: Mesh, folder: Path) -> Path:
    """Write the case of a member, if it is not there; return its folder."""
    case = folder / member.name
    if not case.is_dir():
        write_case(replace(mesh, name=member.name), case, study.setup(member.kind == UNDEFLECTED))
    return case
