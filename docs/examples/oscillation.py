"""A flap that swings: one period of a harmonic oscillation as times and angles.

    python oscillation.py [FOLDER]

writes ``flap.csv``: 5 degrees to either side in 0.2 s, in 16 steps. Angles are rounded, so that those of equal size are
equal to the last bit, and each is computed once.
"""

import sys
from math import pi, sin
from pathlib import Path

AMPLITUDE, PERIOD, STEPS = 5.0, 0.2, 16


def rows() -> list[tuple[float, float]]:
    """Return a time and an angle for each line."""
    return [(PERIOD * k / STEPS, round(AMPLITUDE * sin(2.0 * pi * k / STEPS), 6) + 0.0) for k in range(STEPS + 1)]


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    lines = "".join(f"{time:g},{angle}\n" for time, angle in rows())
    (folder / "flap.csv").write_text(f"time,angle\n{lines}")
