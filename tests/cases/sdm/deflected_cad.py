"""The deflected CAD of a case, built in this process and kept: many tests measure against the same one."""

from functools import cache

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.reference import Reference, answer, decode, question


@cache
def built(case: Case) -> Reference:
    """Return the reference of a case as a run gets it."""
    return decode(answer(question(case)))
