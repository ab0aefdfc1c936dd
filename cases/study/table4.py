"""Table 4: SQUV for the horizontal tail, with a limit on the number of centres."""

from sdm_deflect.cases.study.paper import Table
from sdm_deflect.cases.study.trend import HARDLY, Finding, Rows, Trend, among, ascending, listed, spread


def all_at_limit(rows: Rows, table: Table) -> Finding:
    """Every direction ends at the limit on the centres, after the same iterations, above the tolerance."""
    holds = (
        all(row.centers == table.max_centers and row.max_error > table.tolerance for row in rows)
        and len({row.iterations for row in rows}) == 1
    )
    text = "; ".join(
        f"f_{row.setting.columns} {row.centers} centres after {row.iterations} iterations, {row.max_error:.2e} m"
        for row in rows
    )
    return Finding(holds, text)


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


TRENDS = (
    Trend("No direction reaches the tolerance; all end at the limit after the same iterations.", all_at_limit),
    Trend("The largest error is smallest for f_y, followed by f_x.", error_y_then_x_then_z),
    Trend("The times differ little.", hardly_different_times, of_time=True),
)
