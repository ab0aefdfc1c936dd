"""`sdm deflect --history` carried out: a surface that moves in time, as an OpenFOAM case with face sweeps."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.cases.run.deflect_file import Judged, Outcome, figures, judged, planned
from sdm_deflect.cases.run.mesh_files import Targets, write_mesh
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.cases.run.output import OutputError, output_files
from sdm_deflect.cases.run.progress import Stopwatch, Told
from sdm_deflect.cases.run.read_back import DIFFERS, check_points, check_written
from sdm_deflect.cases.settings.job_settings import MOST_ANGLES, settings_of
from sdm_deflect.cases.settings.keywords import Options
from sdm_deflect.deform.base.errors import InputError, shortened
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.reading import damaged
from sdm_deflect.deform.checks import MIN_QUALITY, Check
from sdm_deflect.deform.mesh.mesh import bounded
from sdm_deflect.deform.mesh.swept import CONSERVED
from sdm_deflect.deform.mesh.unchanged import check_unchanged, held
from sdm_deflect.deform.volume.deflection import sweep
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Planned
from sdm_deflect.meshing.files.staged import permitted_as
from sdm_deflect.meshing.formats import openfoam_history as foam
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import case_folder
from sdm_deflect.meshing.formats.openfoam_decomposed import move_points
from sdm_deflect.meshing.formats.openfoam_files import MESH
from sdm_deflect.meshing.formats.openfoam_write import write_files
from sdm_deflect.meshing.formats.registry import ending, files_of, format_of

MOST_TIMES = 10_000
LONGEST = 100 * MOST_TIMES
"""Bytes of a history's file."""
SHORTEST, LATEST, APART = 1e-30, 1e30, 1e-12
"""Least step, s, latest time, s, and least step as a share of the latest time."""
RULE = "a .csv with a line of titles, then a time and an angle on each line, such as 0.05,-2.5"


@dataclass(frozen=True, slots=True)
class History:
    """How far the first surface is deflected at each of several times.

    Attributes
    ----------
    times : (T,) rising, s.
    angles : (T,) degrees, or shares of a table.

    Raises InputError for less than two times or more than `MOST_TIMES`, times that do not rise, or more than
    `MOST_ANGLES` different angles.
    """

    times: tuple[float, ...]
    angles: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("times", "angles"):
            values = bounded(getattr(self, name), f"history: {name}")
            if values.ndim != 1 or not 2 <= len(values) <= MOST_TIMES:
                raise InputError(f"history: {name} {values.shape} must be 2 to {MOST_TIMES} numbers")
            object.__setattr__(self, name, tuple((values + 0.0).tolist()))
        if len(self.times) != len(self.angles):
            raise InputError(f"history: {len(self.times)} times and {len(self.angles)} angles; each time needs one")
        steps, latest = np.diff(self.times), max(map(abs, self.times))
        if (steps <= 0.0).any():
            i = int(np.argmax(steps <= 0.0))
            raise InputError(f"history: times must rise, but {self.times[i + 1]:.17g} follows {self.times[i]:.17g}")
        if steps.min() < max(SHORTEST, APART * latest) or latest > LATEST:
            raise InputError(
                f"history: a step of {steps.min():g} s at times up to {latest:g} s: steps must be at least "
                f"{APART:g} of the latest time and {SHORTEST:g} s, times at most {LATEST:g} s"
            )
        if len(self.distinct) > MOST_ANGLES:
            raise InputError(
                f"history: {len(self.distinct)} different angles, at most {MOST_ANGLES} are possible; round them, so "
                "that those of a period come again"
            )

    @classmethod
    def read(cls, path: str | PathLike[str]) -> "History":
        """Read a .csv of time, angle with a line of titles; InputError if the file is none."""
        path = _path(path, "history")
        with damaged(path, f"history ({RULE})"):
            if path.stat().st_size > LONGEST:
                raise InputError(f"holds {path.stat().st_size} bytes; a history has at most {MOST_TIMES} times")
            with path.open(encoding="utf-8") as text:
                if _has_numbers(text.readline()):
                    raise InputError("its first line must be the titles time,angle")
                rows = np.loadtxt(text, delimiter=",", ndmin=2)
            if rows.shape[1] != 2:
                raise ValueError(f"rows of {rows.shape[1]} numbers instead of time, angle")
            return cls(tuple(rows[:, 0]), tuple(rows[:, 1]))

    @property
    def distinct(self) -> tuple[float, ...]:
        """Every angle once, in the order of the times."""
        return tuple(dict.fromkeys(self.angles))

    @property
    def largest(self) -> float:
        """The angle farthest from zero."""
        return max(self.angles, key=abs)


@dataclass(frozen=True, slots=True, eq=False)
class InTime:
    """What was done for a history.

    Attributes
    ----------
    outcome : every different angle with its checks, and the case that was written.
    history : the times and angles.
    names : folder of each time in the case.
    balances : how well the face sweeps add up, from each time to the next.
    """

    outcome: Outcome
    history: History = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    balances: tuple[foam.Balance, ...] = field(repr=False)

    @property
    def passed(self) -> bool:
        """True if every check of every angle holds, and the face sweeps add up."""
        return self.outcome.passed

    def figures(self, watch: Stopwatch) -> Json:
        """Return all figures as JSON has them."""
        own = {"times": self.history.times, "angles": self.history.angles, "folders": self.names}
        return {**figures(self.outcome, watch), "history": {**own, "face_sweeps": list(map(asdict, self.balances))}}


def deflect_history(
    mesh: str | PathLike[str],
    surfaces: str | Sequence[Any],
    hinge: ArrayLike | None,
    history: History | str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    progress: Progress = silent,
    **options: Unpack[Options],
) -> InTime:
    """Deflect a mesh file to the angle of each time, and write an OpenFOAM case with points and face sweeps.

    Parameters
    ----------
    mesh : The path of a mesh file, or of an OpenFOAM case, of which the new case is a copy.
    surfaces, hinge : As for `deflect`.
    history : Times and angles, or a .csv file with them.
    out : The new folder; ``MESH-history`` beside the mesh if None.
    progress, **options : As for `deflect`.

    Returns
    -------
    The checks of each angle and of the face sweeps. A check that fails is no error; `passed` tells.

    Raises
    ------
    InputError : as `deflect` and its result's `save`; or if the history cannot be used.
    """
    given = history if isinstance(history, History) else History.read(history)
    settings = settings_of(surfaces, hinge, given.largest, options)
    try:
        wanted = target_of(_path(mesh, "mesh"), None if out is None else _path(out, "out"), given)
        wanted.check()
        return deflect_in_time(wanted, settings.jobs(), given, Stopwatch(Told(progress)), settings.min_quality)
    except (MeshFileError, OutputError) as error:
        raise InputError(str(error)) from None


def target_of(source: Path, out: Path | None, history: History) -> Targets:
    """Return the new case of a history; InputError if `out` is the name of a file.

    Raises MeshFileError for a case to which no history can be added.
    """
    of_case = format_of(source).folder
    if of_case:
        foam.check_source(source)
    if out is not None and not format_of(out).folder:
        raise InputError(f"{out}: a history becomes an OpenFOAM case; name a folder in out")
    place = case_folder(source) if of_case else source.with_name(source.name.removesuffix(ending(source)))
    named = place if place.name not in ("", "..") else place.resolve()
    return Targets.of(source, out or named.with_name(f"{named.name}-history".replace(".", "-")), (history.largest,))


def deflect_in_time(
    wanted: Targets, jobs: Sequence[Job], history: History, watch: Stopwatch, min_quality: float = MIN_QUALITY
) -> InTime:
    """Deflect a mesh file to the angle of each time; the case appears at the end, or nothing.

    Every different angle is computed once; points of one angle at a time are in memory, then of two times.
    """
    with held(files_of(wanted.source)):
        return _deflected(wanted, jobs, history, watch, min_quality)


def _deflected(wanted: Targets, jobs: Sequence[Job], history: History, watch: Stopwatch, min_quality: float) -> InTime:
    plan = planned(wanted, jobs, watch, angles=history.distinct)
    times = foam.Times(history.times)
    found: list[Judged] = []
    with permitted_as(wanted.source), output_files(wanted.out.parent) as scratch:
        case = scratch / wanted.out.name
        with watch.stage("write") as progress:
            lost = _write_case(wanted, plan, case, times, progress)
        results = sweep(plan, history.distinct)
        for _ in history.distinct:
            with watch.stage("deflect") as progress:
                _, one = next(results)
                progress(f"{one.angle:+g} {plan.job.surfaces[0].motion.unit}", 1.0)
            with watch.stage("quality"):
                found.append(judged(one, min_quality))
            with watch.stage("write"):
                for name, angle in zip(times.names, history.angles, strict=True):
                    if angle == one.angle:
                        foam.write_points(case, name, one.points)
                        if why := check_points(one.points, foam.read_points(case, name)):
                            raise MeshFileError(DIFFERS.format(wanted.out / name, why))
        with watch.stage("face sweeps") as progress:
            move_points(case / MESH, case / MESH, [foam.read_points(case, times.names[0])])
            balances = foam.write_face_sweeps(case, times, progress)
        first = foam.read_points(case, times.names[0])
        check_written(plan.mesh, first, plan.changed, case, wanted.out)
        check_unchanged(plan.mesh.files)
    outcome = Outcome(plan, tuple(found), (wanted.out,), (), lost, (conservation(balances),), _advice(wanted, times))
    return InTime(outcome, history, times.names, balances)


def conservation(balances: Sequence[foam.Balance]) -> Check:
    """Check that the volumes that the faces of each cell sweep add up to the change of its volume."""
    cells, gap = max(one.cells for one in balances), max(one.gap for one in balances)
    share = max(one.gap_of_volume for one in balances)
    where = f"up to {cells} cells at each of {len(balances)} times; {share:.1e} of the cell's volume alone"
    return Check("face_sweeps", gap, CONSERVED, "", where, over=cells)


def _write_case(wanted: Targets, plan: Planned, case: Path, times: foam.Times, progress: Progress) -> tuple[str, ...]:
    """Write the undeflected mesh: a new case, or a copy of the one that was read."""
    lost = write_mesh(wanted.source, plan.mesh, plan.mesh.points, case, progress)
    if not format_of(wanted.source).folder:
        write_files(case, {"system/controlDict": times.control})
    return lost


def _advice(wanted: Targets, times: foam.Times) -> tuple[str, ...]:
    """Say what a user must change in settings of their own."""
    own = format_of(wanted.source).folder and times.digits > foam.DIGITS
    return (f"times of {times.digits} digits: set timePrecision {times.digits} in its controlDict",) if own else ()


def _path(value: Any, what: str) -> Path:
    if not isinstance(value, str | PathLike) or "\0" in str(value):
        raise InputError(f"{what} = {shortened(value)} is no path of a file or folder")
    return Path(value)


def _has_numbers(line: str) -> bool:
    try:
        return bool([float(word) for word in line.split(",")])
    except ValueError:
        return False
