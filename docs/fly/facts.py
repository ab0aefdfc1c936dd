"""Numbers of the method on the fighter, and of README's wing, measured once for all texts: `python -m docs.fly.facts`.

They are kept in `docs/fly/facts.json`, and written into texts by `texts.py`. `--check` measures nothing, and ends with
1 if a text has other numbers than the file.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

import sdm_deflect
from docs.fly import texts
from docs.fly.lesson import RUNS, centres, lesson
from docs.fly.tail import Tail, fighter
from docs.fly.texts import Facts
from docs.fly.wing import wing
from sdm_deflect.deform.volume.deflection import BoxDeflection

KEPT = Path(__file__).with_name("facts.json")
# Numbers of centres of the greedy steps.
CENTRES = (8, 12, 16, 20, 24, 28, 32, 50)
# Number of centres whose worst cell is better than with all.
COARSE = 60


def measured() -> Facts:
    """Measure everything."""
    mesh, settings = fighter()
    surfaces = {surface["patches"]: surface for surface in settings["surface"]}
    return {
        "cells": len(mesh.cells[0]),
        "nodes": len(mesh.points),
        "tail": of_tail(),
        "strategies": {name: dict(strategies(name)) for name in surfaces},
        "lesson": lesson(),
        "rigid": rigid(),
        "wing": wing(),
    }


def rigid() -> float:
    """Run the free aileron; return the largest distance (m) of its surface from CAD that was turned rigidly."""
    with TemporaryDirectory() as scratch:
        out = Path(scratch, "out")
        command = [sys.executable, "-m", "sdm_deflect", "run", "aileron-free", "--scale", "small", "--out", str(out)]
        subprocess.run([*command, "--no-report", "--quiet"], check=True)
        checks = json.loads((out / "metrics.json").read_text(encoding="utf-8"))["validation"]["checks"]
    return float(next(check["value"] for check in checks if check["name"] == "surface_to_rigid_cad"))


def of_tail() -> Facts:
    """Measure the steps of the method on the left tail."""
    tail = Tail.at()
    zero = tail.sites.points[tail.in_mesh :]
    free, whole = tail.without_box(), tail.with_all()
    return {
        "angle": tail.angle,
        "motion": float(np.linalg.norm(tail.sites.values, axis=1).max()),
        "sites": len(tail.sites.points),
        "zero_sites": len(zero),
        "jump": float(np.linalg.norm(free(zero), axis=1).max()),
        "without_box": tail.judged(tail.moved(free))._asdict(),
        "with_box": tail.judged(tail.moved(whole))._asdict(),
        "stretched": stretched(tail),
        "product": tail.judged(tail.mesh.points + tail.displacement)._asdict(),
        "centres": {
            str(count): {**tail.judged(tail.moved(found))._asdict(), "error": float(tail.error(found).max())}
            for count, found in ((count, tail.greedy(count).interpolant) for count in CENTRES)
        },
    }


def stretched(tail: Tail) -> Facts:
    """Return how many times as much one way as another the field of `COARSE` centres, and that of all, stretch a cell.

    It is the worst cell with all: the largest over the least singular value of the deformation gradient.
    """
    fields = {str(COARSE): tail.greedy(COARSE).interpolant, "all": tail.with_all()}
    points = {name: tail.moved(found) for name, found in fields.items()}
    nodes = tail.tets[tail.cells[int(np.argmin(tail.quality(points["all"], tail.cells)[0]))]]
    before, *after = ((at[nodes[1:]] - at[nodes[0]]).T for at in (tail.mesh.points, *points.values()))
    values = [np.linalg.svd(edges @ np.linalg.inv(before), compute_uv=False) for edges in after]
    return {name: float(some[0] / some[-1]) for name, some in zip(points, values, strict=True)}


def turned(name: str, strategy: str) -> BoxDeflection:
    """Turn a surface to the end of its range with the settings of `fighter.toml`, in one step and without repair."""
    mesh, settings = fighter()
    surface = next(one for one in settings["surface"] if one["patches"] == name)
    own = {key: surface[key] for key in ("motion", "on", "box") if key in surface}
    own |= {"fixed": settings["fixed"], "strategy": strategy, "repair": "off", "max_steps": 1}
    result = sdm_deflect.deflect(mesh, name, surface["hinge"], surface["range"][1], **own)
    return result.deflection.boxes[0]


def strategies(name: str) -> Iterator[tuple[str, Facts]]:
    """Yield the centres, the weights of kernels and the seconds of both ways to choose centres."""
    for strategy, columns in (("squv", 1), ("mv", 3)):
        boxes = [turned(name, strategy) for _ in range(RUNS + 1)]
        seconds = median(box.seconds for box in boxes[1:])
        found = centres(boxes[0])
        yield strategy, {"centres": found, "weights": columns * sum(found), "seconds": round(seconds, 3)}


def main() -> None:
    """Measure, unless texts are only checked, and write the blocks of all texts."""
    parser = argparse.ArgumentParser(prog="python -m docs.fly.facts", description=__doc__)
    parser.add_argument("--check", action="store_true", help="measure and write nothing; end with 1 if a text is stale")
    check = parser.parse_args().check
    if not check:
        KEPT.write_text(json.dumps(measured(), indent=1) + "\n", encoding="utf-8")
    facts = json.loads(KEPT.read_text(encoding="utf-8"))
    stale = texts.stale(facts)
    if not check:
        for path in stale:
            path.write_text(texts.with_facts(path.read_text(encoding="utf-8"), facts), encoding="utf-8")
    sys.exit(f"stale: {', '.join(path.name for path in stale)}" if check and stale else 0)


if __name__ == "__main__":
    main()
