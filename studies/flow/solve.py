"""The study carried out: members side by side, each from where it stopped before."""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Event, Lock
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, LostError
from sdm_deflect.base.files import replacing
from sdm_deflect.base.threads import Progress
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.flow.fields import iterations_done, start_from
from studies.flow.members import (
    DEFLECTED,
    REPAIRED,
    UNDEFLECTED,
    FlowStudy,
    Member,
    fresh_deflected_meshes,
    fresh_members,
    fresh_mesh,
    moved_meshes,
    undeflected_mesh,
    write_member,
)
from studies.flow.openfoam import SOLVER, write_settings
from studies.flow.results import judged, values_of
from studies.flow.setup import Setup
from studies.flow.solver import lines, needed

SETTINGS, SECONDS, FOLDER = "study.json", "seconds.json", "members"
TIME, USED = re.compile(r"^Time = (\d+)"), re.compile(r"^ExecutionTime = ([\d.]+) s")
# Iterations between two reports of progress, and between two readings of the forces for it.
TOLD, SEEN = 10, 50


def carried_out(study: FlowStudy, folder: Path, watch: Stopwatch) -> tuple[Member, ...]:
    """Make all members of a study in `folder`, and compute their flows; what is there already is kept.

    Raises InputError if OpenFOAM is not found, or `folder` has a study with other settings; LostError if the solver
    ends with an error, but for a mesh without repair beside a repaired one: it is no member then.
    """
    needed(SOLVER)
    check_settings(study, folder)
    cases = folder / FOLDER
    first = Member(UNDEFLECTED)
    mesh = undeflected_mesh(study, watch)
    write_member(study, first, mesh, cases)
    with watch.stage("flow") as progress, Solvers(study, cases, progress) as solvers:
        base = solvers.begin(first)
        fresh = [(member, fresh_mesh(study, member, watch)) for member in fresh_members(study)]
        moved = [*moved_meshes(study, mesh, progress), *fresh_deflected_meshes(study, fresh, progress)]
        base.result()
        begun = {}
        for member, own in (*moved, *fresh):
            begin(study, member, own, (cases / first.name, mesh), cases)
            begun[solvers.begin(member)] = member
        there = tuple(computed(begun))
    return (first, *(member for member in begun.values() if member in there))


def computed(begun: Mapping[Any, Member]) -> Iterator[Member]:
    """Yield the members whose flow is computed, as they end.

    Without repair a mesh can be so poor that the solver ends on it: it is then left out where a repaired one is there.
    """
    repaired = [member.angle for member in begun.values() if member.kind == REPAIRED]
    for one in as_completed(begun):
        member = begun[one]
        try:
            one.result()
        except LostError:
            if member.kind != DEFLECTED or member.angle not in repaired:
                raise
        else:
            yield member


def begin(study: FlowStudy, member: Member, mesh: Mesh, base: tuple[Path, Mesh], cases: Path) -> None:
    """Write the case of a member whose flow starts from that of the undeflected one."""
    case = write_member(study, member, mesh, cases)
    if not iterations_done(case):
        other, others = base
        start_from(case, centres(mesh), other, centres(others))


def centres(mesh: Mesh) -> FloatArray:
    """Return the centres (M, 3) of the cells."""
    return np.asarray(mesh.points[tets_of(mesh)].mean(axis=1))


def check_settings(study: FlowStudy, folder: Path) -> None:
    """Keep the settings with which the members are made; InputError if those that are there are others."""
    case = study.case
    stream: dict[str, Any] = asdict(study.stream)
    own = {"case": case.name, "scale": case.scale, **stream, "set": list(study.assignments)}
    path = folder / SETTINGS
    if path.is_file():
        there = json.loads(path.read_text(encoding="utf-8"))
        if different := [name for name in own if there.get(name) != own[name]]:
            name = different[0]
            raise InputError(
                f"--out {folder} holds a study with {name} = {there.get(name)}, not {own[name]}; name another folder"
            )
        return
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        beside.write_text(json.dumps(own, indent=2), encoding="utf-8")


@dataclass(slots=True)
class Solvers:
    """Solvers that run side by side, one on each processor; what they have done is told together."""

    study: FlowStudy
    cases: Path
    progress: Progress
    done: dict[str, int] = field(default_factory=dict)
    seen: dict[str, str] = field(default_factory=dict)
    _pool: ThreadPoolExecutor = field(init=False)
    _lock: Lock = field(init=False, default_factory=Lock)
    _end: Event = field(init=False, default_factory=Event)

    def __enter__(self) -> "Solvers":
        """Begin with as many threads as there are processors."""
        self._pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)))
        return self

    def __exit__(self, *_: object) -> None:
        """End all that runs."""
        self._end.set()
        self._pool.shutdown(cancel_futures=True)

    def begin(self, member: Member) -> Any:
        """Begin to solve a member, as soon as a processor is free; return what can be waited for."""
        return self._pool.submit(self._solve, member)

    def _solve(self, member: Member) -> None:
        setup = self.study.setup(member.kind == UNDEFLECTED)
        solve(self.cases / member.name, setup, lambda iteration: self._tell(member, iteration))

    def _tell(self, member: Member, iteration: int) -> None:
        if self._end.is_set():
            raise KeyboardInterrupt
        said = standing(self.study, self.cases / member.name) if iteration % SEEN == 0 else None
        with self._lock:
            self.done[member.name] = iteration
            self.seen[member.name] = said or self.seen.get(member.name, "")
            running = ", ".join(
                f"{name} {count}{self.seen[name]}" for name, count in self.done.items() if count < self._most
            )
            total = sum(self.done.values()) / (self._most * max(len(self.done), 1))
            self.progress(f"{running or 'done'} of {self._most} iterations", total)

    @property
    def _most(self) -> int:
        return self.study.iterations


def standing(study: FlowStudy, case: Path) -> str:
    """Say where the first coefficient that decides stands, and by how much its average still changes."""
    name = judged(study)[0]
    value = dict(values_of(study, case))[name]
    return f" ({name} {value.mean:+.4f}, changing by {value.change:.0e})"


def solve(case: Path, setup: Setup, tell: Callable[[int], None]) -> None:
    """Go on with a case up to `Setup.iterations`; processor seconds are added to those in its ``seconds.json``."""
    done = iterations_done(case)
    if done >= setup.iterations:
        tell(done)
        return
    write_settings(case, setup, fields=False)
    before, kept = seconds_of([case]), False
    for line in lines(SOLVER, case):
        if found := TIME.match(line):
            kept = int(found[1]) % TOLD == 0 or int(found[1]) == setup.iterations
            if kept:
                tell(int(found[1]))
        elif kept and (used := USED.match(line)):  # as it goes, for a study that is killed
            with replacing(case / SECONDS) as beside:
                beside.write_text(json.dumps(before + float(used[1])), encoding="utf-8")


def seconds_of(cases: Iterable[Path]) -> float:
    """Return the processor seconds that the solvers of some cases took together, as far as they are known."""
    paths = [case / SECONDS for case in cases]
    return float(sum(json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()))
