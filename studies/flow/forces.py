"""Forces and moments that a case of OpenFOAM has reported, and the coefficients of an aircraft made from them."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from studies.flow.setup import Hinge, Setup

REPORTS = Path("postProcessing")
# Numbers in a line, at least: the iteration and the whole vector; then what pressure and friction give of it.
VALUES = 4
BRACKETS = str.maketrans("()", "  ")


@dataclass(frozen=True, slots=True, eq=False)
class Forces:
    """Forces on some patches over the iterations.

    Attributes
    ----------
    iteration : (K,) numbers of iterations, rising.
    force, moment : (K, 3) newtons and newton metres, the moment about the monitor's point.
    """

    iteration: IntArray = field(repr=False)
    force: FloatArray = field(repr=False)
    moment: FloatArray = field(repr=False)

    @classmethod
    def read(cls, case: Path, name: str) -> "Forces":
        """Read what the monitor `name` of a case has reported, over all its starts.

        Raises InputError if it has reported nothing, or what it has reported is damaged.
        """
        folder = case / REPORTS / name
        starts = sorted((path for path in folder.glob("*") if path.is_dir()), key=lambda path: float(path.name))
        rows: dict[int, FloatArray] = {}
        for start in starts:  # a later start repeats what an earlier one had not kept
            rows |= _rows(start, "")
            if (start / f"force_{start.name}.dat").is_file():  # it began there once more
                rows |= _rows(start, f"_{start.name}")
        if not rows:
            raise InputError(f"{folder}: no forces are reported; the solver has not run")
        table = np.array([rows[key] for key in sorted(rows)])
        return cls(table[:, 0].round().astype(np.intp), table[:, 1:4], table[:, 4:7])


def _rows(start: Path, suffix: str) -> dict[int, FloatArray]:
    """Return what was reported since a start by iteration: its number, force and moment (7,)."""
    force, moment = (_numbers(start / f"{what}{suffix}.dat") for what in ("force", "moment"))
    count = min(len(force), len(moment))
    both = np.hstack([force[:count, :4], moment[:count, 1:4]])
    return {round(row[0]): row for row in both}


def _numbers(path: Path) -> FloatArray:
    """Return the rows (K, 4 or more) of a table of vectors in brackets; an unfinished last line is left out."""
    try:
        lines = [line.translate(BRACKETS) for line in path.read_text().split("\n")[:-1] if not line.startswith("#")]
        table = np.array([[float(word) for word in line.split()] for line in lines])
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    return table if len(lines) else np.empty((0, VALUES))


LIFT, DRAG, PITCH, ROLL, YAW = "CL", "CD", "Cm", "Cl", "Cn"
WHOLE = (LIFT, DRAG, PITCH, ROLL, YAW)


def coefficients(forces: Forces, setup: Setup) -> dict[str, FloatArray]:
    """Return lift, drag, pitching, rolling and yawing moment coefficient (K,) of the whole.

    Forces are along and normal to the wind. Moments are about axes of the body, in the signs of flight mechanics:
    pitching nose up, rolling starboard wing down, yawing nose to starboard; x points aft, y to starboard, z up.
    """
    pressure, (drag, _, lift) = setup.stream.dynamic_pressure, setup.stream.directions
    scale = 1.0 / (pressure * setup.area)
    mx, my, mz = forces.moment.T
    return {
        LIFT: scale * forces.force @ lift,
        DRAG: scale * forces.force @ drag,
        PITCH: scale / setup.length * my,
        ROLL: -scale / setup.span * mx,
        YAW: -scale / setup.span * mz,
    }


def hinge_moment(forces: Forces, hinge: Hinge) -> FloatArray:
    """Return the moment (K,) in newton metres about a hinge's axis, right-handed along it."""
    return np.asarray(forces.moment @ np.array(hinge.axis))
