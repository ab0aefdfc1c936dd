"""The deflected CAD of a case, built in this process and kept: many tests measure against the same one."""

from contextlib import nullcontext
from functools import cache
from unittest.mock import patch

from sdm_deflect.cases.aircraft import run_folder
from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.reference import Reference, answer, decode, question


@cache
def built(case: Case) -> Reference:
    """Return the reference of a case as a run gets it."""
    return decode(answer(question(case)))


def rechecked(folder, case, models):
    """Validate a folder again against CAD that was built once: that of a case, and what its meshes follow before."""
    run = run_folder.finished_case(folder)
    with (
        patch.object(run_folder, "reference", lambda *_: nullcontext(lambda: built(case))),
        patch.object(run_folder, "undeflected_models", lambda _: models),
    ):
        return run.recheck()
