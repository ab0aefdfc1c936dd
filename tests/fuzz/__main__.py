"""Try random inputs: ``python -m tests.fuzz --minutes 60 --jobs 2``.

Exit code 1 if something was found; what was is kept in the folder of ``--keep``, and tried again by ``--again``.
"""

import argparse
import gc
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from random import Random

import click

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
    words.add_argument("--again", type=Path, help="a folder of one finding: TARGET/NUMBER of an earlier --keep")
    given = words.parse_args()
    for name in LOADED:
        import_module(name)
    gc.freeze()
    from tests.fuzz.targets import TARGETS
    from tests.fuzz.watch import Findings, Watch, print_figures, save, seeds_of

    if given.again:
        return again(given.again)
    chosen = [TARGETS[name] for name in given.target or TARGETS]
    found = [Findings(target, seeds_of(target)) for target in chosen]
    timed = given.inputs is None and not given.sample and not given.known
    watch = Watch(found, given.seed, timed, given.jobs)
    if timed:
        watch.for_minutes(given.minutes, given.keep)
    else:
        watch.for_counts([len(one.known) if given.known else given.inputs or one.target.sample for one in found])
    save(found, given.keep)
    print_figures(found, given.json)
    return int(any(one.bad for one in found))


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
