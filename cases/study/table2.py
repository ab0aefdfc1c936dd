"""Table 2: the number of centres added in an iteration, M_add, for f_z."""

from sdm_deflect.cases.study.paper import Table
from sdm_deflect.cases.study.trend import Finding, Rows, Trend, ascending, listed, rising

SPEED_UP = 6.0
MONOTONIC_TO = 25


def fewer_iterations(rows: Rows, _table: Table) -> Finding:
    """The final iteration number falls in more than half of the steps to a larger M_add."""
    down, total = rising([-row.iterations for row in rows])
    return Finding(2 * down > total, f"it falls in {down} of {total} steps, from {rows[0].iterations} to "
                   f"{rows[-1].iterations}")  # fmt: skip


def more_centers(rows: Rows, _table: Table) -> Finding:
    """The final number of centres rises in more than half of the steps to a larger M_add."""
    up, total = rising([row.centers for row in rows])
    return Finding(2 * up > total, f"it rises in {up} of {total} steps, from {rows[0].centers} to {rows[-1].centers}")


def always_faster(rows: Rows, _table: Table) -> Finding:
    """Every M_add above one takes less time than one."""
    slowest = max(rows[1:], key=lambda row: row.seconds)
    return Finding(
        slowest.seconds < rows[0].seconds,
        f"{rows[0].seconds:.3g} s with 1, at most {slowest.seconds:.3g} s with more (M_add = {slowest.setting.n_add})",
    )


def six_times_faster(rows: Rows, _table: Table) -> Finding:
    """Some M_add is faster than one by more than a factor of six."""
    best = min(rows, key=lambda row: row.seconds)
    factor = rows[0].seconds / best.seconds
    return Finding(factor > SPEED_UP, f"a factor of {factor:.1f} with M_add = {best.setting.n_add}")


def monotonic_then_not(rows: Rows, _table: Table) -> Finding:
    """The time falls monotonically up to M_add = 25, and rises again at least once after that."""
    small = [row.seconds for row in rows if row.setting.n_add <= MONOTONIC_TO]
    large = [row.seconds for row in rows if row.setting.n_add >= MONOTONIC_TO]
    up, total = rising(large)
    holds = ascending([-seconds for seconds in small]) and up > 0
    return Finding(holds, f"{listed(small)} s up to 25; then it rises in {up} of {total} steps")


TRENDS = (
    Trend("A larger M_add generally means fewer iterations.", fewer_iterations),
    Trend("A larger M_add generally means more centres.", more_centers),
    Trend("Any M_add above one takes less time than one.", always_faster, of_time=True),
    Trend("The time falls by a factor of more than 6 at best.", six_times_faster, of_time=True),
    Trend("It falls monotonically up to M_add = 25 only, then often rises again.", monotonic_then_not, of_time=True),
)
