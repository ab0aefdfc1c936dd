"""Random parameters of a case, in their declared ranges: each set gives a valid solid, or a sentence that says why not.

``python -m tests.fuzz.parameters 120 --processes 2`` builds the CAD of 120 sets, each in a process of its own, and
counts; ``--runs 20 --out FOLDER`` hands the first 20 that gave a solid to ``sdm run`` as well.
"""

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

CASES = ("aileron", "tail")
TABLES = ("fuselage", "canopy", "inlet", "pedestal", "strake", "wing", "aileron", "tail", "ventral", "fin", "rudder")
SETTINGS = ("confinement", "blending", "angle")
"""What a run has beside the aircraft."""
NEAR = 0.15
"""Share of a default by which a value near it differs, at most."""
SECONDS = 600.0
"""Time that one set may take to be built."""
RUN_SECONDS = 3600.0
"""Time that one run may take."""
SOLID, SENTENCE, TRACEBACK, STUCK = "valid solid", "clear error", "traceback", "too long"


def ranges(case: Any, tables: tuple[str, ...]) -> dict[str, tuple[float, float, float]]:
    """Return the default, the smallest and the largest value of every declared quantity of some tables."""
    found: dict[str, tuple[float, float, float]] = {}
    for holder in (case, case.fighter):
        for one in fields(holder):
            value = getattr(holder, one.name)
            if one.name in tables and "unit" in one.metadata:
                found[one.name] = (value, one.metadata["low"], one.metadata["high"])
            elif one.name in tables and is_dataclass(value):
                for inner in (each for each in fields(value) if "unit" in each.metadata):
                    limits = inner.metadata["low"], inner.metadata["high"]
                    found[f"{one.name}.{inner.name}"] = (getattr(value, inner.name), *limits)
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


def build(name: str, changed: dict[str, float]) -> tuple[str, str]:
    """Return what becomes of a set, and the sentence or the traceback."""
    from traceback import format_exc

    from sdm_deflect.cases.aircraft.cad import deflected_cad, undeflected_cad
    from sdm_deflect.cases.aircraft.registry import resolve
    from sdm_deflect.cases.errors import is_reported

    try:
        case = resolve(name, assignments=assignments(changed))
        model = undeflected_cad(case)
        deflected_cad(case)
    except (ValueError, RuntimeError) as error:
        return (SENTENCE, " ".join(str(error).split())) if is_reported(error) else (TRACEBACK, format_exc())
    return SOLID, f"{len(model.faces)} faces"


def _answer(pipe: Connection, name: str, changed: dict[str, float]) -> None:
    pipe.send(build(name, changed))


def built(name: str, changed: dict[str, float], seconds: float = SECONDS) -> tuple[str, str]:
    """Return what becomes of a set in a process of its own, which may crash."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["sdm_deflect.cases.aircraft.cad", "sdm_deflect.cases.aircraft.registry"])
    mine, other = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(other, name, changed))
    child.start()
    other.close()
    try:
        if not mine.poll(seconds):
            return STUCK, f"more than {seconds:g} s"
        return mine.recv()  # type: ignore[no-any-return]
    except EOFError:
        child.join()
        return TRACEBACK, f"ended with code {child.exitcode}"
    finally:
        child.kill()
        child.join()


def run(name: str, changed: dict[str, float], folder: Path) -> tuple[str, str]:
    """Return what becomes of a run: its exit code, and the failed checks or the sentence."""
    words = [sys.executable, "-m", "sdm_deflect", "run", name, "--no-report", "--quiet", "--out", str(folder)]
    words += [word for text in assignments(changed) for word in ("--set", text)]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=RUN_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return STUCK, f"more than {RUN_SECONDS:g} s"
    said = done.stderr.strip()
    if "Traceback" in said or done.returncode not in (0, 1, 2) or (done.returncode == 2 and said.count("\n")):
        return TRACEBACK, said
    if done.returncode == 2:
        return f"{SENTENCE}, exit 2", said
    checks = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))["validation"]["checks"]
    failed = [one["name"] for one in checks if not one["passed"]]
    if bool(failed) != bool(done.returncode):
        return TRACEBACK, f"exit {done.returncode}, failed: {failed}"
    return f"exit {done.returncode}", ", ".join(failed)


def told(line: str) -> None:
    """Write a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    """Count what becomes of random sets; 1 if any gave a traceback or took too long."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--runs", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/parameters"))
    given = parser.parse_args()
    wanted = list(islice(sets(given.seed), given.count))
    found: list[str] = []
    ran: list[str] = []
    with ThreadPoolExecutor(given.processes) as pool:
        for one, (kind, text) in zip(wanted, pool.map(lambda one: built(*one), wanted), strict=True):
            found.append(kind)
            told(f"{len(found):4} {one[0]} {' '.join(assignments(one[1]))}: {kind}: {text}")
            if kind == SOLID and len(ran) < given.runs:
                code, text = run(*one, given.out / f"{len(ran):02}")
                ran.append(code)
                told(f"run {len(ran):2} {one[0]}: {code}: {text}")
    for what in (found, ran):
        told(", ".join(f"{kind}: {count}" for kind, count in sorted(Counter(what).items())))
    return int(any(kind in (TRACEBACK, STUCK) for kind in (*found, *ran)))


if __name__ == "__main__":
    sys.exit(main())
