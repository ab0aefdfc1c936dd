"""The results of a case's run, and its metrics.json."""

from dataclasses import dataclass, field

from sdm_deflect.cases.report.folder import metrics_of
from sdm_deflect.cases.run.metrics import Json, amounts, by_shape, deflection_figures
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.cases.settings.conversion import to_toml
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import Quality, mean_ratio, summarise

from .case import Case
from .guide_meshes import guide_text

# Names of the shown figures of the whole mesh's quality.
SHOWN = ("min", "p01", "mean", "below_0_2", "below_0_4")


@dataclass(frozen=True, slots=True)
class MeshOrigin:
    """Origin of the undeflected mesh; the cache keeps it with the mesh.

    Attributes
    ----------
    boundary_to_cad_max : largest distance (m) of a boundary node from the CAD.
    attempts, seconds : meshes tried until one passed verification, and the time they took.
    unseeded : reason why another run gives another mesh; "" if it gives the same.
    """

    boundary_to_cad_max: float
    attempts: int
    seconds: float
    unseeded: str


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A finished case.

    Attributes
    ----------
    mesh, deflected : the mesh before and after; same cells, same order.
    origin : origin of the undeflected mesh.
    deflection : of every control surface.
    whole_mesh_seconds : time to evaluate the first interpolant at every mesh node, for comparison.
    checks : the validation.
    watch : the time taken, by stage.
    background : the mesh around a Chimera block; None without a block.
    pinned : quality inside the hexahedron with a pinned instead of a sliding Chimera face, for comparison.
    """

    case: Case
    mesh: Mesh
    origin: MeshOrigin
    deflected: Mesh
    deflection: Deflection
    whole_mesh_seconds: float
    checks: tuple[Check, ...]
    watch: Stopwatch = field(default_factory=lambda: Stopwatch(), repr=False)
    background: Mesh | None = None
    pinned: Quality | None = None

    @property
    def guide(self) -> str:
        """Whether the undeflected mesh is the one of the guide; else why not."""
        return guide_text(self.case, self.mesh, self.origin.unseeded)

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return all(check.passed for check in self.checks)


def case_toml(case: Case, plan: Plan) -> str:
    """Return case.toml, which repeats a case; comments say where the hinges are."""
    return "".join(f"# {name}: {text} m\n" for name, text in amounts(plan, plan.pose)) + to_toml(case)


def metrics(run: Run) -> Json:
    """Return the content of metrics.json of a case (SI units, degrees)."""
    case, first = run.case, run.deflection.boxes[0]
    before, after = (summarise(mean_ratio(mesh.points, tets_of(mesh))) for mesh in (run.mesh, run.deflected))
    quality = [{name: getattr(state, name) for name in SHOWN} for state in (before, after)]
    surfaces = {d.plan.surface: {"angle_deg": d.angle, **deflection_figures(d)} for d in run.deflection.parts}
    surface = surfaces[first.plan.surface]
    if run.pinned:
        surface["quality_inside"]["after_pinned"] = by_shape([run.pinned])
    figures = metrics_of(run.deflection, run.checks, None, run.watch.seconds)
    return {
        "case": case.name,
        "scale": case.scale,
        **figures,
        "angle_deg": case.angle,
        "strategy": case.strategy,
        "mesh": {
            **figures["mesh"],
            "quality_min": before.min,
            "boundary_to_cad_max": run.origin.boundary_to_cad_max,
            "seconds": run.origin.seconds,
            "guide": run.guide,
        },
        **{name: value for name, value in surface.items() if name != "angle_deg"},
        "evaluation": {**figures["evaluation"], **_evaluation(run)},
        "quality": {"before": quality[0], "after": quality[1], "inverted": after.inverted},
        "deflections": surfaces,
        "total_seconds": run.watch.total,
    }


def _evaluation(run: Run) -> Json:
    seconds = sum(step.evaluation_seconds for d in run.deflection.boxes for step in d.steps)
    pairs = sum(
        len(step.start.free) * len(fit.chosen) * len(fit.components)
        for d in run.deflection.boxes
        for step in d.steps
        for fit in step.fits.adaptations
    )
    return {"whole_mesh_seconds": run.whole_mesh_seconds, "pairs_per_second": pairs / seconds if seconds else 0.0}
