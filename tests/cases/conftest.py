"""Finished runs that the tests of this folder share."""

from dataclasses import replace
from pathlib import Path

import pytest

from cases.output import output_folder
from cases.pipeline import run_case
from cases.progress import Silent, Stopwatch
from cases.registry import case_named


@pytest.fixture(scope="session")
def finish(tmp_path_factory, make_mesh):
    """Run a case into a folder of its own; return the run and the folder."""

    def run(case):
        make_mesh(case)
        folder = tmp_path_factory.mktemp(case.name)
        with output_folder(folder) as scratch:
            return run_case(case, Stopwatch(Silent()), Path(scratch)), folder

    return run


@pytest.fixture(scope="session")
def aileron_run(finish):
    """Case 5.1 at -12 degrees, SQUV."""
    return finish(case_named("aileron"))


@pytest.fixture(scope="session")
def aileron_mv_run(finish):
    """The same with one set of centres for all directions."""
    return finish(replace(case_named("aileron"), strategy="mv"))
