"""Run the golden commands and keep what they write, or compare two such runs.

python -m tests.golden run FOLDER FILE.json [--real]
python -m tests.golden compare OLD.json NEW.json [--known FILE]
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.progress import track

from tests.golden import inputs
from tests.golden.commands import Command, everything

# Parts of names of figures that differ from run to run.
TIMED = ("seconds", "timings", "per_second", "rss", "version", "evaluation", "date", "source", "when")
# Suffixes of what shows results: they are compared by the figures.
UNSEEN = (".html", ".png", ".svg", ".toml")


def untimed(value: Any) -> Any:
    """Return JSON values without those that differ from run to run; numbers keep twelve digits."""
    if isinstance(value, dict):
        return {key: untimed(one) for key, one in value.items() if not any(part in key for part in TIMED)}
    if isinstance(value, list):
        return [untimed(one) for one in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def digest(path: Path) -> Any:
    """Return what stands for a file: its figures, or a hash of its bytes, of arrays those of each."""
    if path.suffix == ".json":
        return untimed(json.loads(path.read_text()))
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return {name: hashlib.sha256(arrays[name].tobytes()).hexdigest()[:16] for name in sorted(arrays)}
    content = path.read_bytes()
    if path.name == "convergence.csv":
        rows = [line.split(b",") for line in content.splitlines()]
        clock = rows[0].index(b"seconds")
        content = b"\n".join(b",".join([*row[:clock], *row[clock + 1 :]]) for row in rows)
    return hashlib.sha256(content).hexdigest()[:16]


def results(command: Command, made: Path, folder: Path) -> Iterator[tuple[str, Any]]:
    """Run a command in a copy of the inputs; yield exit code, what it says, and what it writes."""
    shutil.copytree(made, folder)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    words = [sys.executable, "-m", "sdm_deflect", *command.words]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, env=os.environ)
    yield "code", done.returncode
    if command.words[-1] == "--json" and not done.returncode:
        yield "json", untimed(json.loads(done.stdout.replace(str(folder), "")))
    elif done.returncode == 2:
        yield "error", done.stderr.replace(str(folder), "").splitlines()[-1:]
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix not in UNSEEN and before.get(path) != path.stat().st_mtime_ns:
            yield path.relative_to(folder).as_posix(), digest(path)


@click.group()
def main() -> None:
    """Compare what commands write before and after a change of the code's structure."""


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--real", is_flag=True, help="Also the aircraft; SDM_DEFLECT_CACHE names the folder of its meshes.")
@click.option("--only", default="", help="Only commands whose name holds this text.")
def run(folder: Path, file: Path, real: bool, only: str) -> None:
    """Run every command in FOLDER, which is made, and write what stands for the results to FILE."""
    made = folder.resolve() / "inputs"
    made.mkdir(parents=True)
    inputs.write(made)
    found = {}
    for name, command in track([one for one in everything(real) if only in one[0]], "commands"):
        work = made.with_name("work")
        found[name] = dict(results(command, made, work))
        shutil.rmtree(work)
    file.write_text(json.dumps(found, indent=1, sort_keys=True))


@main.command()
@click.argument("old", type=click.Path(path_type=Path, exists=True))
@click.argument("new", type=click.Path(path_type=Path, exists=True))
@click.option("--known", type=click.Path(path_type=Path, exists=True), help="Patterns of places that may differ.")
def compare(old: Path, new: Path, known: Path | None) -> None:
    """Print what differs, a line each; exit with 1 if anything does that is not known to."""
    rows = known.read_text().splitlines() if known else []
    patterns = [row for row in rows if row and not row.startswith("#")]
    found = list(differences(json.loads(old.read_text()), json.loads(new.read_text())))
    lines = [line for line in found if not any(fnmatch(line.partition(": ")[0], pattern) for pattern in patterns)]
    click.echo("\n".join(lines) or f"the same, but for {len(found)} known places")
    sys.exit(bool(lines))


def differences(old: Any, new: Any, place: str = "") -> Iterator[str]:
    """Yield what differs between two JSON values, with its place."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            yield from differences(old.get(key), new.get(key), f"{place} / {key}" if place else key)
    elif old != new:
        yield f"{place}: {str(old)[:120]} -> {str(new)[:120]}"


if __name__ == "__main__":
    main()
