"""Table 3: SQUV for two deflections in a Chimera block, whose face carries further sites for f_y."""

from sdm_deflect.cases.study.paper import Row, Table
from sdm_deflect.cases.study.trend import Finding, Rows, Trend, listed


def by_angle(rows: Rows) -> dict[float, dict[str, Row]]:
    """Sort rows by angle (smaller deflections first) and direction."""
    angles = sorted({row.setting.angle for row in rows}, key=abs)
    return {angle: {row.setting.columns: row for row in rows if row.setting.angle == angle} for angle in angles}


def y_fewest_centers(rows: Rows, _table: Table) -> Finding:
    """At each angle f_y ends with the fewest centres."""
    sorted_rows = by_angle(rows)
    holds = all(min(three, key=lambda d: three[d].centers) == "y" for three in sorted_rows.values())
    text = (
        f"{angle:+g} deg: " + ", ".join(f"f_{d} {three[d].centers}" for d in "yxz")
        for angle, three in sorted_rows.items()
    )
    return Finding(holds, "; ".join(text))


def y_least_time(rows: Rows, _table: Table) -> Finding:
    """At each angle f_y takes the least time."""
    sorted_rows = by_angle(rows)
    holds = all(min(three, key=lambda d: three[d].seconds) == "y" for three in sorted_rows.values())
    text = (
        f"{angle:+g} deg: " + ", ".join(f"f_{d} {three[d].seconds:.3g} s" for d in "yxz")
        for angle, three in sorted_rows.items()
    )
    return Finding(holds, "; ".join(text))


def larger_angle_more_centers(rows: Rows, _table: Table) -> Finding:
    """In each direction the larger deflection needs more centres."""
    small, large = by_angle(rows).values()
    factors = [large[d].centers / small[d].centers for d in "xyz"]
    return Finding(min(factors) > 1.0, f"by factors of {listed(factors)} in x, y, z")


def larger_angle_more_time(rows: Rows, _table: Table) -> Finding:
    """In each direction the larger deflection takes more time."""
    small, large = by_angle(rows).values()
    factors = [large[d].seconds / small[d].seconds for d in "xyz"]
    return Finding(min(factors) > 1.0, f"by factors of {listed(factors)} in x, y, z")


TRENDS = (
    Trend("f_y needs the fewest centres, although it has the most sites.", y_fewest_centers),
    Trend("f_y takes the least time.", y_least_time, of_time=True),
    Trend("A larger deflection needs more centres in every direction.", larger_angle_more_centers),
    Trend("A larger deflection takes more time in every direction.", larger_angle_more_time, of_time=True),
)
