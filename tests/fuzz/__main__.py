"""Try random inputs: ``python -m tests.fuzz --minutes 60 --jobs 2``.

Exit code 1 if something was found; what was is kept in the folder of ``--keep``, and tried again by ``--again``.
"""

import argparse
import gc
import logging
import sys
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any

import click
import coverage

FORMATS = "*/meshing/formats/*"
"""Of these files the coverage is measured."""
LOADED = (
    "h5py", "pyvista", "meshio", "sdm_deflect.cases.cli", "sdm_deflect.cases.run.deflect_file",
    "sdm_deflect.cases.cli.examination", "sdm_deflect.cases.run.inspection", "sdm_deflect.cases.settings.job_settings",
    "sdm_deflect.cases.report.folder", "sdm_deflect.cases.aircraft.pipeline", "sdm_deflect.cases.aircraft.report",
    "studies.page", "sdm_deflect.cases.view.page", "sdm_deflect.geometry.errors", "sdm_deflect.meshing.errors",
    "tests.fuzz.targets",
)  # fmt: skip
"""What workers need, loaded once before they are forked."""


def main() -> int:
    """Try inputs, print what came of them, return the exit code."""
    words = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    words.add_argument(
        "--minutes", type=float, default=1.0, help="how long; known inputs grow by those that reach new lines"
    )
    words.add_argument("--sample", action="store_true", help="instead: a few of each target, always the same ones")
    words.add_argument("--known", action="store_true", help="instead: sound inputs, and those that once did harm")
    words.add_argument("--inputs", type=int, help="instead: so many of each target, always the same ones")
    words.add_argument("--jobs", type=int, default=2)
    words.add_argument("--target", action="append", help="only this one; repeat")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs that were found")
    words.add_argument("--json", type=Path, help="file for the figures")
    words.add_argument(
        "--coverage",
        action="store_true",
        help="known inputs and --inputs in this process; print what of the formats they reach",
    )
    words.add_argument("--again", type=Path, help="a folder of one finding: TARGET/NUMBER of an earlier --keep")
    given = words.parse_args()
    measured = coverage.Coverage(branch=True, include=[FORMATS], omit=["*/tests/*"], data_file=None, config_file=False)
    if given.coverage:
        measured.start()
    for name in LOADED:
        import_module(name)
    gc.freeze()
    from tests.fuzz.targets import TARGETS
    from tests.fuzz.watch import Findings, Watch, print_figures, save, seeds_of

    if given.again:
        return again(given.again)
    chosen = [TARGETS[name] for name in given.target or TARGETS]
    found = [Findings(target, seeds_of(target)) for target in chosen]
    if given.coverage:
        tried_here(found, given.seed, given.inputs or 0)
        measured.stop()
        measured.report(show_missing=True)
        return 0
    timed = given.inputs is None and not given.sample and not given.known
    watch = Watch(found, given.seed, timed, given.jobs)
    if timed:
        watch.for_minutes(given.minutes, given.keep)
    else:
        watch.for_counts([len(one.known) if given.known else given.inputs or one.target.sample for one in found])
    save(found, given.keep)
    print_figures(found, given.json)
    return int(any(one.bad for one in found))


def tried_here(found: Sequence[Any], seed: int, count: int) -> None:
    """Try the known inputs of each target and `count` in all, in this process."""
    from tests.fuzz.worker import input_of, outcome, random_of

    logging.disable()
    for one in found:
        for number in range(max(count, len(one.known))):
            given = input_of(one.target, seed, number, one.known)
            with tempfile.TemporaryDirectory() as name:
                given.put(Path(name))
                outcome(one.target, Path(name), given, random_of(seed, one.target, -number))


def again(folder: Path) -> int:
    """Try one input that was kept, in this process."""
    from tests.fuzz.inputs import Input
    from tests.fuzz.targets import TARGETS
    from tests.fuzz.worker import outcome

    given = Input.kept(folder)
    with tempfile.TemporaryDirectory() as name:
        given.put(Path(name))
        kind, where, text = outcome(TARGETS[folder.parent.name], Path(name), given, Random(1))
    click.echo("\n".join((kind, where, text)))
    return int(kind not in ("ok", "clean"))


if __name__ == "__main__":
    sys.exit(main())
