"""The trends that the paper reads off its tables, as tests that any table, the paper's own too, passes or fails."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal

from studies.paper import Row, Table

HARDLY = 1.25
"""Times that differ by less than this factor differ hardly: in the paper's table 1 it is at most 1.21."""
TWICE = 2.0
SPEED_UP = 6.0
MONOTONIC_TO = 25


@dataclass(frozen=True, slots=True)
class Finding:
    """Whether a trend holds in some rows, and the numbers that say so."""

    holds: bool
    evidence: str

    @property
    def verdict(self) -> str:
        """In words."""
        return "holds" if self.holds else "does not hold"


Rows = Sequence[Row]
Name = Literal["iterations", "centers", "seconds"]
Test = Callable[[Rows, Table], Finding | None]
"""Judges the rows that one loop gave; None if they do not suffice."""


@dataclass(frozen=True, slots=True)
class Trend:
    """What the paper says, and the test of it.

    A trend `of_time` is judged for every loop, any other only for the centres that the paper's rule gives.
    """

    statement: str
    test: Test
    of_time: bool = False


def among(rows: Iterable[Row], columns: str) -> list[Row]:
    """Return the rows of one direction (or of all, "xyz")."""
    return [row for row in rows if row.setting.columns == columns]


def by_columns(rows: Rows, name: Name) -> dict[str, list[float]]:
    """Return one figure of the rows, by direction in order of occurrence."""
    columns = dict.fromkeys(row.setting.columns for row in rows)
    return {one: [getattr(row, name) for row in among(rows, one)] for one in columns}


def title(columns: str) -> str:
    """Return how the paper calls it: MV or f_x."""
    return "MV" if columns == "xyz" else f"f_{columns}"


def listed(values: Iterable[float]) -> str:
    """Join numbers with few digits."""
    return ", ".join(f"{value:.3g}" if isinstance(value, float) else str(value) for value in values)


def rising(values: Sequence[float]) -> tuple[int, int]:
    """Return how many steps of a sequence rise, and how many there are."""
    return sum(b > a for a, b in pairwise(values)), max(len(values) - 1, 0)


def spread(values: Sequence[float]) -> float:
    """Return the largest value over the smallest."""
    return max(values) / min(values)


def ascending(values: Sequence[float]) -> bool:
    """Return True if every value is larger than the one before."""
    return all(a < b for a, b in pairwise(values))


def fewer_iterations(rows: Rows, _table: Table) -> Finding | None:
    """The final iteration number falls, or is zero throughout, as the initial centres grow."""
    counts = by_columns(rows, "iterations")
    if max(map(len, counts.values())) < 2:
        return None
    holds = all(ascending([-n for n in group]) or not any(group) for group in counts.values())
    return Finding(holds, "; ".join(f"{title(columns)} {listed(group)}" for columns, group in counts.items()))


def mostly_more_centers(rows: Rows, _table: Table) -> Finding | None:
    """The final number of centres rises in more than half of the steps to more initial centres."""
    steps = [rising(group) for group in by_columns(rows, "centers").values()]
    up, total = (sum(counts) for counts in zip(*steps, strict=True))
    return Finding(2 * up > total, f"it rises in {up} of {total} steps") if total else None


def same_time(rows: Rows, _table: Table) -> Finding | None:
    """The time of an adaptation hardly depends on its initial centres."""
    groups = by_columns(rows, "seconds")
    if max(map(len, groups.values())) < 2:
        return None
    holds = all(spread(group) <= HARDLY for group in groups.values())
    text = ", ".join(f"{title(columns)} {spread(group):.2f}" for columns, group in groups.items())
    return Finding(holds, f"longest over shortest time: {text}")


def y_then_x_then_z(rows: Rows, _table: Table) -> Finding | None:
    """For every number of initial centres f_y needs the fewest centres, then f_x, then f_z."""
    groups = [[row.centers for row in among(rows, columns)] for columns in "yxz"]
    holds = all(ascending(counts) for counts in zip(*groups, strict=True))
    text = "; ".join(f"f_{columns} {listed(counts)}" for columns, counts in zip("yxz", groups, strict=True))
    return Finding(holds, f"centres: {text}")


def z_equals_mv(rows: Rows, _table: Table) -> Finding | None:
    """SQUV for f_z ends with as many iterations and centres as MV."""
    pairs = list(zip(among(rows, "z"), among(rows, "xyz"), strict=True))
    same = sum((a.iterations, a.centers) == (b.iterations, b.centers) for a, b in pairs)
    return Finding(same == len(pairs), f"equal iterations and centres in {same} of {len(pairs)} rows")


def mv_twice_as_dear(rows: Rows, _table: Table) -> Finding | None:
    """MV takes more than twice the time of the three uni-variate adaptations together."""
    ratios = []
    for mv in among(rows, "xyz"):
        squv = (row.seconds for d in "xyz" for row in among(rows, d) if row.setting.initial == mv.setting.initial)
        ratios.append(mv.seconds / sum(squv))
    return Finding(min(ratios) > TWICE, f"time of MV over that of SQUV: {listed(ratios)}")


def mostly(rows: Rows, _table: Table, name: Name, way: Literal["falls", "rises"]) -> Finding:
    """A figure falls, or rises, in more than half of the steps to a larger M_add."""
    values = [getattr(row, name) for row in rows]
    steps, total = rising(values if way == "rises" else values[::-1])
    return Finding(2 * steps > total, f"it {way} in {steps} of {total} steps, from {values[0]} to {values[-1]}")


def always_faster(rows: Rows, _table: Table) -> Finding:
    """Every M_add above one takes less time than one."""
    one, slowest = rows[0].seconds, max(rows[1:], key=lambda row: row.seconds)
    text = f"{one:.3g} s with 1, at most {slowest.seconds:.3g} s with more (M_add = {slowest.setting.n_add})"
    return Finding(slowest.seconds < one, text)


def six_times_faster(rows: Rows, _table: Table) -> Finding:
    """Some M_add is faster than one by more than a factor of six."""
    best = min(rows, key=lambda row: row.seconds)
    factor = rows[0].seconds / best.seconds
    return Finding(factor > SPEED_UP, f"a factor of {factor:.1f} with M_add = {best.setting.n_add}")


def falls_then_rises(rows: Rows, _table: Table) -> Finding:
    """The time falls monotonically up to M_add = 25, and rises again at least once after that."""
    small = [row.seconds for row in rows if row.setting.n_add <= MONOTONIC_TO]
    large = [row.seconds for row in rows if row.setting.n_add >= MONOTONIC_TO]
    up, total = rising(large)
    holds = ascending([-seconds for seconds in small]) and up > 0
    return Finding(holds, f"{listed(small)} s up to 25; then it rises in {up} of {total} steps")


def by_angle(rows: Rows) -> dict[float, dict[str, Row]]:
    """Sort rows by angle (smaller deflections first) and direction."""
    angles = sorted({row.setting.angle for row in rows}, key=abs)
    return {angle: {row.setting.columns: row for row in rows if row.setting.angle == angle} for angle in angles}


def y_least(rows: Rows, _table: Table, name: Name = "centers", unit: str = "") -> Finding:
    """At each angle f_y has the smallest number of centres, or another figure."""
    values = {angle: {d: getattr(three[d], name) for d in "yxz"} for angle, three in by_angle(rows).items()}
    text = (
        f"{angle:+g} deg: " + ", ".join(f"f_{d} {listed([value])}{unit}" for d, value in three.items())
        for angle, three in values.items()
    )
    return Finding(all(min("xyz", key=three.__getitem__) == "y" for three in values.values()), "; ".join(text))


def grows(rows: Rows, _table: Table, name: Name = "centers") -> Finding:
    """In each direction the larger deflection needs more centres, or more of another figure."""
    small, large = by_angle(rows).values()
    factors = [getattr(large[d], name) / getattr(small[d], name) for d in "xyz"]
    return Finding(min(factors) > 1.0, f"by factors of {listed(factors)} in x, y, z")


def all_at_limit(rows: Rows, table: Table) -> Finding:
    """Every direction ends at the limit on the centres, after the same iterations, above the tolerance."""
    limited = all(row.centers == table.max_centers and row.max_error > table.tolerance for row in rows)
    text = "; ".join(
        f"f_{row.setting.columns} {row.centers} centres after {row.iterations} iterations, {row.max_error:.2e} m"
        for row in rows
    )
    return Finding(limited and len({row.iterations for row in rows}) == 1, text)


def error_y_then_x_then_z(rows: Rows, table: Table) -> Finding | None:
    """The largest error is smallest for f_y, followed by f_x and f_z; once all are converged there is no order."""
    errors = [among(rows, d)[0].max_error for d in "yxz"]
    if max(errors) < table.tolerance:
        return None
    return Finding(ascending(errors), f"{listed(errors)} m in y, x, z")


def hardly_different_times(rows: Rows, _table: Table) -> Finding:
    """The three directions take nearly the same time."""
    seconds = [row.seconds for row in rows]
    return Finding(spread(seconds) <= HARDLY, f"longest over shortest: {spread(seconds):.2f}")


TRENDS: dict[str, tuple[Trend, ...]] = {
    "table1": (
        Trend("More initial centres mean fewer iterations.", fewer_iterations),
        Trend("More initial centres mostly mean more centres in the end.", mostly_more_centers),
        Trend("The initial centres hardly influence the time.", same_time, of_time=True),
        Trend("f_y needs the fewest centres, followed by f_x and f_z.", y_then_x_then_z),
        Trend("SQUV for f_z ends with the same iterations and centres as MV.", z_equals_mv),
        Trend("MV is dearer than SQUV by more than a factor of two.", mv_twice_as_dear, of_time=True),
    ),
    "table2": (
        Trend("A larger M_add generally means fewer iterations.", partial(mostly, name="iterations", way="falls")),
        Trend("A larger M_add generally means more centres.", partial(mostly, name="centers", way="rises")),
        Trend("Any M_add above one takes less time than one.", always_faster, of_time=True),
        Trend("The time falls by a factor of more than 6 at best.", six_times_faster, of_time=True),
        Trend("It falls monotonically up to M_add = 25 only, then often rises again.", falls_then_rises, of_time=True),
    ),
    "table3": (
        Trend("f_y needs the fewest centres, although it has the most sites.", y_least),
        Trend("f_y takes the least time.", partial(y_least, name="seconds", unit=" s"), of_time=True),
        Trend("A larger deflection needs more centres in every direction.", grows),
        Trend("A larger deflection takes more time in every direction.", partial(grows, name="seconds"), of_time=True),
    ),
    "table4": (
        Trend("No direction reaches the tolerance; all end at the limit after the same iterations.", all_at_limit),
        Trend("The largest error is smallest for f_y, followed by f_x.", error_y_then_x_then_z),
        Trend("The times differ little.", hardly_different_times, of_time=True),
    ),
}
