"""The paper's numbers, read from `paper.toml` beside this file: nothing in here is ours."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from tomllib import loads
from typing import Literal

from cattrs import structure

# Uni-variate adaptations for one direction, and the multi-variate one for all three.
COLUMNS = ("x", "y", "z", "xyz")


@dataclass(frozen=True, slots=True)
class Setting:
    """What an adaptation was asked to do.

    Attributes
    ----------
    columns : directions that share their centres: "x", "y", "z" (SQUV) or "xyz" (MV).
    angle : deflection, degrees.
    initial : initial centres on the control surface and on the hexahedron.
    n_add : M_add, the largest number of centres added in an iteration.
    """

    columns: str
    angle: float
    initial: tuple[int, int]
    n_add: int

    def __post_init__(self) -> None:
        if self.columns not in COLUMNS:
            raise ValueError(f"columns = {self.columns!r} is not one of {', '.join(COLUMNS)}")


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a convergence table: a setting, and what came of it.

    Attributes
    ----------
    iterations, centers : t_end and N_c,end.
    seconds : time of the adaptation.
    sites : number of data sites.
    max_error : largest error (m) at any data site; nan where the paper does not say.
    """

    setting: Setting
    iterations: int
    centers: int
    seconds: float
    sites: int
    max_error: float = float("nan")

    @property
    def pairs(self) -> float:
        """Pairs of a centre and a site in all residuals, as if the centres grew evenly from first to last."""
        return self.sites * (self.iterations + 1) * (sum(self.setting.initial) + self.centers) / 2


@dataclass(frozen=True, slots=True)
class Table:
    """A convergence table of the paper and the settings that all its rows share."""

    title: str
    case: str
    tolerance: float
    rows: tuple[Row, ...]
    max_centers: int = 10_000


@dataclass(frozen=True, slots=True)
class Size:
    """Mesh and data sites of one case; `zero_sites` are those on the hexahedron for x, y and z."""

    case: str
    points: int
    cells: int
    surface: int
    zero_sites: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of nodes of a surface, and how far it goes; None where the paper does not say.

    Attributes
    ----------
    stay, follow : data sites of the blending at the connection to the wing, and at the trailing edge.
    gaps, edges : largest displacement in z over the width of the gap, and over the edge of a typical cell there.
    tail, panel : nodes of the tail and of the panel beside it.
    """

    case: str
    angle: float
    stay: int | None = None
    follow: int | None = None
    gaps: float | None = None
    edges: float | None = None
    tail: int | None = None
    panel: int | None = None


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Timings of section 5, in seconds, of the interpolant for f_x.

    Attributes
    ----------
    setting, tolerance, max_centers : how that interpolant was found.
    inside : mesh points inside the hexahedron.
    filter_seconds, inside_seconds, whole_seconds : to find those, to evaluate there, and on all mesh points.
    """

    case: str
    setting: Setting
    tolerance: float
    max_centers: int
    centers: int
    inside: int
    filter_seconds: float
    inside_seconds: float
    whole_seconds: float


@dataclass(frozen=True, slots=True)
class QualityStatement:
    """What the paper reads off a histogram for cells below a mean ratio.

    `finding` is "as before" (no deterioration visible there), "none" (the deformed mesh has no such cells), or "none
    deformed" (nor has any deformed cell).
    """

    figure: int
    case: str
    angle: float
    below: float
    finding: Literal["as before", "none", "none deformed"]


@dataclass(frozen=True, slots=True)
class Paper:
    """All numbers of section 5."""

    machine: str
    tables: dict[str, Table]
    sizes: tuple[Size, ...]
    counts: tuple[Counts, ...]
    evaluations: tuple[Evaluation, ...]
    quality: tuple[QualityStatement, ...]

    def size(self, case: str) -> Size:
        """Return the sizes of a case; KeyError if the paper does not have it."""
        return {one.case: one for one in self.sizes}[case]


@cache
def paper() -> Paper:
    """Read the data file of the package; sites are the sum of those on the surface and on the hexahedron."""
    data = loads(files(__package__).joinpath("paper.toml").read_text(encoding="utf-8"))
    tables = {name: data[name] for name in sorted(data) if name.startswith("table")}
    sites = {
        one["case"]: {d: one["surface"] + one["zero_sites"]["xyz".index(d[0])] for d in COLUMNS}
        for one in data["sizes"]
    }
    for table in tables.values():
        own = sites[table["case"]]
        table["rows"] = [{**row, "setting": row, "sites": own[row["columns"]]} for row in table["rows"]]
    return structure({**data, "machine": data["machine"]["text"], "tables": tables}, Paper)
