"""A deflected mesh as a case for a flow solver, which starts as it is: what users ask for, and how it is written."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.flow.openfoam import RESERVED, write_case
from sdm_deflect.cases.flow.setup import FreeStream, Hinge, Kind, Setup, kinds_of
from sdm_deflect.cases.flow.su2 import check_name, configuration
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError, shortened
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.parts import MARK
from sdm_deflect.deform.mesh.unchanged import check_unchanged
from sdm_deflect.deform.volume.plan import Planned
from sdm_deflect.meshing.formats.format import fitting_names
from sdm_deflect.meshing.formats.openfoam_write import UNFIT
from sdm_deflect.meshing.formats.registry import FORMATS, format_of
from sdm_deflect.meshing.formats.shapes import refuse_plane
from sdm_deflect.meshing.formats.su2 import UNFIT as UNFIT_MARKER
from sdm_deflect.meshing.formats.su2_read import PARALLEL

SOLVERS = ("openfoam", "su2")
"""Solvers for which cases are written, by the names of their meshes' formats."""
WORDS: dict[Kind, str] = {"wall": "walls", "far": "far_field", "symmetry": "symmetry"}
"""What the kinds of patches are called in figures."""
OPTION = "--to-solver"
LARGEST = 1e300


@dataclass(frozen=True, slots=True)
class FlowCase:
    """A case that is asked for beside a deflection.

    Attributes
    ----------
    solver : a name in `SOLVERS`.
    stream : the free stream.
    far : names and wildcards of patches that are the far field, beside those that are found.
    iterations : steps of the solver.
    """

    solver: str
    stream: FreeStream = field(default_factory=FreeStream)
    far: tuple[str, ...] = ()
    iterations: int = Setup().iterations

    @classmethod
    def of(cls, solver: Any, mach: Any = None, alpha: Any = None, far: Any = ()) -> "FlowCase | None":
        """Return the case that is asked for, None if no solver is named.

        Raises InputError for an unknown solver, a value out of its range, and values without a solver.
        """
        given = {"mach": mach, "alpha": alpha, "far_field": None if isinstance(far, tuple) and not far else far}
        if solver is None:
            if useless := [name for name, value in given.items() if value is not None]:
                raise InputError(f"{useless[0]} has no use without a solver: give {OPTION} {' or '.join(SOLVERS)}")
            return None
        if solver not in SOLVERS:
            raise InputError(f"{OPTION} {shortened(solver)}: must be {' or '.join(SOLVERS)}")
        numbers = {name: _number(name, given[name]) for name in ("mach", "alpha") if given[name] is not None}
        return cls(solver, FreeStream(**numbers), _names(far))

    def check_files(self, source: Path, out: Path) -> None:
        """Refuse an `out` in another format than the solver's, and a source that is a case already: InputError."""
        if format_of(out).name != self.solver:
            what = "a file .su2" if self.solver == "su2" else "a folder, without a suffix"
            raise InputError(f"{out}: {OPTION} {self.solver} writes {what}; name one, or leave out --out")
        if self.solver == "openfoam" and format_of(source).folder:
            raise InputError(f"{source}: is an OpenFOAM case already, whose settings stay; leave out {OPTION}")
        if self.solver == "su2":
            check_name(out)

    def setup(self, plan: Planned) -> Setup:
        """Return the flow to compute: each moving surface with a hinge is a monitor of its moment about it.

        Raises InputError if the mesh has no far field or no wall, or zones that are meshes of their own.
        """
        if self.solver == "openfoam":
            refuse_plane(plan.mesh, "OpenFOAM")
        if len(plan.mesh.zones) > 1:
            names = ", ".join(zone.name for zone in plan.mesh.zones)
            raise InputError(f"{plan.mesh.name}: {OPTION} takes a mesh of one zone, and this one has several: {names}")
        monitored = [(surface.patches, moving.motion.axis) for moving, surface in plan.moving]
        called = fitting_names([patches[0] for patches, _ in monitored], UNFIT, RESERVED)
        hinges = (
            Hinge.through(called[patches[0]], patches, np.array([axis.point, axis.point + axis.direction]))
            for patches, axis in monitored
            if axis is not None
        )
        kinds = kinds_of(plan.mesh, self.far, plan.patches)
        return Setup(self.stream, tuple(hinges), iterations=self.iterations, far=self.far, kinds=kinds)

    def figures(self, plan: Planned) -> dict[str, Any]:
        """Return what each patch is, and what is monitored, as JSON has it."""
        setup = self.setup(plan)
        kinds = setup.kinds_on(plan.mesh).items()
        patches = {what: [name for name, own in kinds if own == kind] for kind, what in WORDS.items()}
        hinges = [asdict(hinge) for hinge in setup.hinges]
        return {
            "solver": self.solver,
            "mach": self.stream.mach,
            "alpha": self.stream.alpha,
            **patches,
            "hinges": hinges,
        }

    def text(self, plan: Planned) -> str:
        """Return the same as a sentence."""
        own = self.figures(plan)
        flow = f"case for {self.solver}, Mach {own['mach']:g}, alpha {own['alpha']:g} deg"
        parts = [f"{what.replace('_', ' ')}: {', '.join(own[what]) or 'none'}" for what in WORDS.values()]
        monitors = ", ".join(hinge["name"] for hinge in own["hinges"]) or "none"
        return "; ".join([flow, *parts, f"hinge moment of: {monitors}"])

    def write(
        self, plan: Planned, points: FloatArray, out: Path, progress: Progress = silent
    ) -> tuple[tuple[Path, ...], tuple[str, ...]]:
        """Write the case with the mesh at `points` (N, 3); return what was written, and what it cannot hold.

        Raises InputError as `setup` does, MeshFileError as the solver's format does.
        """
        return write_flow(self.solver, plan.mesh.with_points(points), self.setup(plan), out, progress, _is_copy(plan))


def write_flow(
    solver: str, mesh: Mesh, setup: Setup, out: Path, progress: Progress = silent, copied: bool = False
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write a flow as a case for a solver; return what was written, and what it cannot hold.

    A mesh of SU2 is a copy of the file that it was read from, with other coordinates, if it is to be `copied`. Raises
    InputError if there is no far field or no wall, MeshFileError as the solver's format does.
    """
    if solver == "openfoam":
        return (out,), write_case(mesh, out, setup, progress)
    names = fitting_names(mesh.names, UNFIT_MARKER, (PARALLEL,))
    kinds = {names[name]: kind for name, kind in setup.kinds_on(mesh).items()}
    text = configuration(kinds, out, replace(setup, hinges=tuple(hinge.renamed(names) for hinge in setup.hinges)))
    lost: tuple[str, ...] = ()
    if copied:
        FORMATS["su2"].rewrite(Path(mesh.source), mesh.points, out, progress)
        check_unchanged(mesh.files)
    else:
        lost = FORMATS["su2"].write(mesh, out, progress)
    config = configuration_of(out)
    config.write_text(text, encoding="utf-8")
    return (out, config), lost


def configuration_of(mesh: Path) -> Path:
    """Return the configuration that stands beside a mesh of SU2."""
    return mesh.with_suffix(".cfg")


def _is_copy(plan: Planned) -> bool:
    """Whether the mesh is a file of SU2 that has all its patches, as it has not where parts of them became patches."""
    mesh = plan.mesh
    parted = bool(plan.job.selections) or any(MARK in name for name in mesh.names)
    return bool(mesh.source) and format_of(mesh.source).name == "su2" and not parted


def _names(far: Any) -> tuple[str, ...]:
    """Return the names of patches in a text with commas, or several of them; InputError for anything else."""
    names = [far] if isinstance(far, str) else far
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise InputError(f"far_field = {shortened(far)} must be a name of a patch, or several")
    return tuple(part.strip() for name in names for part in name.split(","))


def _number(name: str, value: Any) -> float:
    """Return a finite number; InputError, which names it, for anything else."""
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
        return float(value)
    raise InputError(f"{name} = {shortened(value)} must be a number")
