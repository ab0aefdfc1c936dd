"""Random parameters of a case, in their declared ranges: each set gives a valid solid, or a sentence that says why not.

``python -m tests.fuzz.parameters 120 --processes 2`` builds the CAD of 120 sets, each in a process of its own, and
counts.
"""

import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import is_dataclass
from itertools import islice
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import click

from sdm_deflect.base.schema import Range, settings_in

CASES = ("aileron", "tail")
TABLES = ("fuselage", "canopy", "inlet", "pedestal", "strake", "wing", "aileron", "tail", "ventral", "fin", "rudder")
# What a run has beside the aircraft.
SETTINGS = ("confinement", "blending", "angle")
# Share of a default by which a value near it differs, at most.
NEAR = 0.15
# Time that one set may take to be built.
SECONDS = 600.0
SOLID, SENTENCE, TRACEBACK, STUCK = "valid solid", "clear error", "traceback", "too long"


def ranges(case: Any, tables: tuple[str, ...]) -> dict[str, tuple[float, float, float]]:
    """Return the default, the smallest and the largest value of every declared quantity of some tables."""
    found: dict[str, tuple[float, float, float]] = {}
    for name, setting in settings_in(type(case)).items():
        value = setting.of(case)
        inner = settings_in(type(value)).items() if is_dataclass(value) else ()
        own = {name: (setting, case), **{f"{name}.{each}": (one, value) for each, one in inner}}
        known = {place: (one.of(table), one.note(Range)) for place, (one, table) in own.items() if name in tables}
        found |= {place: (value, limits.low, limits.high) for place, (value, limits) in known.items() if limits}
    return found


def drawn(known: dict[str, tuple[float, float, float]], random: Random) -> dict[str, float]:
    """Return one to four quantities with values in their ranges: near the default, anywhere, or at an end."""
    return {name: _value(random, *known[name]) for name in random.sample(sorted(known), random.randint(1, 4))}


def _value(random: Random, default: float, low: float, high: float) -> float:
    kind = random.random()
    if kind < 0.6:
        return min(max(default * random.uniform(1.0 - NEAR, 1.0 + NEAR), low), high)
    return random.uniform(low, high) if kind < 0.8 else random.choice((low, high))


def sets(seed: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield cases with changed quantities, without end: the same for the same seed."""
    from sdm_deflect.cases.aircraft.registry import CASES as REGISTERED

    random = Random(seed)
    while True:
        name = random.choice(CASES)
        tables = TABLES + SETTINGS if random.random() < 0.3 else TABLES
        yield name, drawn(ranges(REGISTERED[name], tables), random)


def assignments(changed: dict[str, float]) -> list[str]:
    """Return the values as ``--set`` takes them."""
    return [f"{name}={value!r}" for name, value in changed.items()]


def built(name: str, changed: dict[str, float]) -> tuple[str, str]:
    """Return what becomes of a set, and the sentence or the traceback: the CAD is built in a process that may crash."""
    with TemporaryDirectory() as folder:
        words = ["--case", name, "--angle", str(changed.get("angle", 12.0)), "--out", f"{folder}/sdm.brep", "--quiet"]
        for text in assignments({key: value for key, value in changed.items() if key != "angle"}):
            words += ["--set", text]
        command = [sys.executable, "-m", "sdm_deflect", "geometry", *words]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return STUCK, f"more than {SECONDS:g} s"
    said = done.stderr.strip()
    if done.returncode == 0:
        return SOLID, ""
    return (SENTENCE if done.returncode == 2 and said.count("\n") == 0 else TRACEBACK), said


def main() -> int:
    """Count what becomes of random sets; 1 if any gave a traceback or took too long."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    wanted, found = list(islice(sets(given.seed), given.count)), Counter[str]()
    with ThreadPoolExecutor(given.processes) as pool:
        for (name, changed), (kind, text) in zip(wanted, pool.map(lambda one: built(*one), wanted), strict=True):
            found[kind] += 1
            click.echo(f"{found.total():4} {name} {' '.join(assignments(changed))}: {kind}: {text}")
    click.echo(", ".join(f"{kind}: {count}" for kind, count in sorted(found.items())))
    return int(found[TRACEBACK] + found[STUCK] > 0)


if __name__ == "__main__":
    sys.exit(main())
