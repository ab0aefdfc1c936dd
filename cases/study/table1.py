"""Table 1: the number of initial centres, for MV and SQUV, one centre added at a time."""

from sdm_deflect.cases.study.paper import Row, Table
from sdm_deflect.cases.study.trend import (
    HARDLY,
    Finding,
    Rows,
    Trend,
    among,
    ascending,
    columns_of,
    listed,
    rising,
    spread,
    title,
)

TWICE = 2.0


def fewer_iterations(rows: Rows, _table: Table) -> Finding | None:
    """The final iteration number falls, or is zero throughout, as the initial centres grow."""
    counts = {columns: [row.iterations for row in among(rows, columns)] for columns in columns_of(rows)}
    if max(map(len, counts.values())) < 2:
        return None
    holds = all(ascending([-n for n in group]) or not any(group) for group in counts.values())
    return Finding(holds, "; ".join(f"{title(columns)} {listed(group)}" for columns, group in counts.items()))


def mostly_more_centers(rows: Rows, _table: Table) -> Finding | None:
    """The final number of centres rises in more than half of the steps to more initial centres."""
    steps = [rising([row.centers for row in among(rows, columns)]) for columns in columns_of(rows)]
    up, total = (sum(counts) for counts in zip(*steps, strict=True))
    return Finding(2 * up > total, f"it rises in {up} of {total} steps") if total else None


def same_time(rows: Rows, _table: Table) -> Finding | None:
    """The time of an adaptation hardly depends on its initial centres."""
    groups = {columns: [row.seconds for row in among(rows, columns)] for columns in columns_of(rows)}
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
    ratios = [mv.seconds / squv_seconds(rows, mv) for mv in among(rows, "xyz")]
    return Finding(min(ratios) > TWICE, f"time of MV over that of SQUV: {listed(ratios)}")


def squv_seconds(rows: Rows, mv: Row) -> float:
    """Return the time of the three uni-variate adaptations with the initial centres of a multi-variate one."""
    return sum(
        row.seconds for row in rows if row.setting.columns != "xyz" and row.setting.initial == mv.setting.initial
    )


TRENDS = (
    Trend("More initial centres mean fewer iterations.", fewer_iterations),
    Trend("More initial centres mostly mean more centres in the end.", mostly_more_centers),
    Trend("The initial centres hardly influence the time.", same_time, of_time=True),
    Trend("f_y needs the fewest centres, followed by f_x and f_z.", y_then_x_then_z),
    Trend("SQUV for f_z ends with the same iterations and centres as MV.", z_equals_mv),
    Trend("MV is dearer than SQUV by more than a factor of two.", mv_twice_as_dear, of_time=True),
)
