"""The deflected CAD of a case, built in this process and kept: many tests measure against the same one."""

from functools import cache

from cases.case import Case
from cases.reference import Reference, decoded, encoded, variants
from cases.reference_worker import reduced


@cache
def built(case: Case) -> Reference:
    """Return the reference of a case as a run gets it."""
    return decoded(encoded(reduced(case.fighter, variants(case))))
