"""The deflected CAD of a case, built in this process and kept: many tests measure against the same one."""

from functools import cache

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.reference import Reference, decoded, encoded, variants
from sdm_deflect.cases.reference_worker import reduced


@cache
def built(case: Case) -> Reference:
    """Return the reference of a case as a run gets it."""
    return decoded(encoded(reduced(case.fighter, variants(case))))
