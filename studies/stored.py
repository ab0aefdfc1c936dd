"""Everything that the page of the paper was measured to say, kept beside it: the page can be written again from it.

The rows of the paper's tables are in `tables/<name>.csv`, all else in `tables/page.json`.
"""

import csv
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from cattrs import structure

from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.meshing.mesh import touching
from studies.measure import ALL, Ground, Measured, Result
from studies.paper import Evaluation, QualityStatement, Row, Setting, Size
from studies.trends import Finding
from studies.trials import Trial

VISIBLE = 3e-4
"""A histogram is as before if at most this share of all cells is new below the limit: a hundredth of the height of its
highest bars, which hold some 3 % of the cells each. Less is not visible."""
FILE, REASONS = "page.json", "reasons.json"
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Counted:
    """Cells below the mean ratio that the paper names: of all, and of those that touch the hexahedron.

    `before` and `after` count the first, `near_before` and `near_after` the second; `least` are the smallest mean
    ratios of the second, before and after.
    """

    statement: QualityStatement
    strategy: str
    cells: int
    before: int
    after: int
    near: int
    near_before: int
    near_after: int
    least: tuple[float, float]

    @classmethod
    def of(cls, theirs: QualityStatement, run: Run, before: FloatArray, after: FloatArray) -> "Counted":
        """Count in the mean ratios (M,) before and after."""
        near = touching(run.mesh, run.deflection.boxes[0].plan.region.inside)
        old, new, near_old, near_new = (
            int(np.sum(one < theirs.below)) for one in (before, after, before[near], after[near])
        )
        least = (float(before[near].min()), float(after[near].min()))
        strategy = run.case.adaptation.strategy
        return cls(theirs, strategy, len(before), old, new, int(near.sum()), near_old, near_new, least)

    def finding(self) -> Finding:
        """Judge the paper's statement."""
        none = self.statement.finding == "none"
        below = self.statement.below
        return Finding(
            self.after == 0 if none else self.after - self.before <= VISIBLE * self.cells,
            f"{self.before} of {self.cells} cells below {below:g} before, {self.after} after; of the {self.near} cells "
            f"that touch the hexahedron, {self.near_before} before, {self.near_after} after, the smallest "
            f"{self.least[0]:.3f} before, {self.least[1]:.3f} after",
        )


@dataclass(frozen=True, slots=True)
class Seen:
    """A check of a run, for what the paper judges by eye in a figure."""

    figure: int
    angle: float
    name: str
    value: float
    unit: str
    judgement: str
    limit: float
    passed: bool
    where: str


@dataclass(frozen=True, slots=True)
class Spoiled:
    """Cells of the deflected tail below the paper's limit, and where they are.

    Attributes
    ----------
    count, finer : with the paper's tolerance, and with an eighth of it.
    on_panel : those with a node on the fuselage panel.
    behind : those whose middle lies behind the trailing edge of the root.
    distance, length : largest distance (m) of a middle from the root line; of the panel's border from that edge.
    """

    count: int
    finer: int
    on_panel: int
    behind: int
    distance: float
    length: float


@dataclass(frozen=True, slots=True)
class Calls:
    """Seconds of the processor to evaluate an interpolant inside the hexahedron and on the whole mesh, on one thread.

    `serial` is the number of pairs of a point and a centre below which one thread does it in any case.
    """

    points: tuple[int, int]
    centers: int
    seconds: tuple[float, float]
    serial: int


@dataclass(frozen=True, slots=True)
class Reasons:
    """What was measured to say why the paper and we differ."""

    scale: str
    trials: tuple[Trial, ...]
    spoiled: Spoiled
    calls: Calls


@dataclass(frozen=True, slots=True)
class Stored:
    """The results of the page; a section that could not be made has its reason in `missing`."""

    scale: str
    threads: int
    sizes: dict[str, Size] = field(default_factory=dict)
    counted: list[Counted] = field(default_factory=list)
    seen: list[Seen] = field(default_factory=list)
    evaluations: list[Evaluation] = field(default_factory=list)
    pictures: dict[str, str] = field(default_factory=dict)
    grounds: dict[str, Ground] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """All that is known when the page is written; `reasons` are None where they were not measured."""

    stored: Stored
    results: dict[str, Result]
    reasons: Reasons | None


def write_json(value: object, path: Path) -> None:
    """Write a dataclass."""
    path.write_text(json.dumps(asdict(value), indent=1) + "\n", encoding="utf-8")  # type: ignore[call-overload]


def read_json(kind: type[T], path: Path) -> T:
    """Read a dataclass; InputError if it cannot be."""
    try:
        return structure(json.loads(path.read_text(encoding="utf-8")), kind)
    except (OSError, ValueError, TypeError, KeyError, ExceptionGroup) as error:
        raise InputError(f"{path}: cannot be read as stored results ({type(error).__name__}); measure again") from error


def read_rows(path: Path) -> tuple[Measured, ...]:
    """Read what was measured from the .csv of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        return tuple(_measured(row) for row in csv.DictReader(file) if row["source"] != "paper")


def read_result(stored: Stored, name: str, folder: Path) -> Result:
    """Read a table."""
    return Result(name, stored.grounds[name], read_rows(folder / f"{name}.csv"))


def _measured(row: dict[str, str]) -> Measured:
    initial = (int(row["initial_surface"]), int(row["initial_hexahedron"]))
    setting = Setting(row["columns"], float(row["angle_deg"]), initial, int(row["n_add"]))
    figures = (int(row["iterations"]), int(row["centers"]), float(row["seconds"]), float(row["max_error"]))
    loop = {loop.name: loop for loop in ALL}[row["source"]]
    converged, repetitions = row["converged"] == "True", int(row["repetitions"])
    return Measured(Row(setting, *figures), loop, int(row["sites"]), converged, repetitions)
