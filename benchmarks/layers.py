"""Meshes with layers at moderate and large angles, before and after the repair: ``python -m benchmarks.layers FOLDER``.

FOLDER holds two public meshes: ``30p30n_L1_coarse.su2`` and ``717_wl_L2.cgns``. The tables go to standard output. Only
public names are used, so that the script of one checkout measures another one, with ``PYTHONPATH``.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import sdm_deflect
from tests.meshing.formats.wing import wing

ANGLES = (-30.0, -20.0, 20.0, 30.0)
STEP = 2.5
"""Degrees between the angles of the sweep."""
LARGEST = 45.0


@dataclass(frozen=True, slots=True)
class Example:
    """A mesh: what it is, how it is made or read, and the settings that deflect it."""

    name: str
    mesh: Callable[[Path], Any]
    settings: dict[str, Any]


def _slotted(hinge: tuple[float, float]) -> dict[str, Any]:
    return {"surfaces": "flap", "hinge": [hinge], "select": {"flap": "wall#3"}, "fixed": "wall"}


def _half_wing(_: Path) -> Any:
    return wing(first_height=1e-6, layers=20).mesh


SLOTTED = "30p30n_L1_coarse.su2"
EXAMPLES = (
    *(
        Example(f"30P30N, flap about {hinge}", lambda folder: sdm_deflect.read(folder / SLOTTED), _slotted(hinge))
        for hinge in ((0.41, -0.005), (0.41025, -0.02073))
    ),
    Example(
        "717 wing, the rear of its inner half",
        lambda folder: sdm_deflect.read(folder / "717_wl_L2.cgns"),
        {
            "surfaces": "turn",
            "hinge": [[5.5, -0.15, 4.3], [6.6, -0.15, 8.4]],
            "motion": "blended",
            "strip": 0.05,
            "fixed": "wall",
            "select": {"turn": "wall side:5.5,0,4.3,4.1,0,-1.1 box:-inf,-inf,4.3,inf,inf,8.4"},
        },
    ),
    Example(
        "half wing, 20 layers from 1e-6 of the chord",
        _half_wing,
        {"surfaces": "flap_*", "hinge": wing().hinge, "motion": "blended", "strip": 0.1, "fixed": "wing_*"},
    ),
)


def rows(example: Example, mesh: Any) -> Iterator[str]:
    """Yield a row for each angle: quality in one step, by default, and after the repair, with processor time."""
    for angle in ANGLES:
        cells = [f"{angle:+g}"]
        for options in ({"repair": "off", "max_steps": 1}, {"repair": "off"}, {}):
            start = process_time()
            found = sdm_deflect.deflect(mesh, angle=angle, **example.settings, **options)
            seconds = process_time() - start
            least, low = (min(getattr(own, name) for own in found.quality) for name in ("min", "p01"))
            cells.append(f"{least:.3f} / {low:.3f} / {sum(own.inverted for own in found.quality)} ({seconds:.1f} s)")
        yield f"| {' | '.join(cells)} |"


def reaches(example: Example, mesh: Any) -> str:
    """Return the largest angles without inverted cells: both signs, without repair and with."""
    found = []
    for repair in ("off", "auto"):
        for sign in (-1.0, 1.0):
            last = 0.0
            for angle in np.arange(STEP, LARGEST + STEP, STEP).tolist():
                done = sdm_deflect.deflect(mesh, angle=sign * angle, repair=repair, **example.settings)
                if any(own.inverted for own in done.quality):
                    break
                last = sign * angle
            found.append(f"{last:+g}")
    return " | ".join(found)


def main(folder: Path) -> None:
    """Write the tables."""
    print("Least quality / exceeded by 99 % / inverted cells (processor time)\n")
    limits = []
    for example in EXAMPLES:
        mesh = example.mesh(folder)
        print(f"### {example.name}\n\n| angle | one step | steps as needed | repaired |\n| --- | --- | --- | --- |")
        for row in rows(example, mesh):
            print(row, flush=True)
        print()
        limits.append(f"| {example.name} | {reaches(example, mesh)} |")
    print(
        "### Largest angles without inverted cells, degrees\n\n| mesh | down, repair off | up, repair off | down | up |"
    )
    print("| --- | --- | --- | --- | --- |", *limits, sep="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
