"""Other limits of size for a test."""

from dataclasses import replace
from typing import Any

import pytest

from sdm_deflect.deform.base import limits


def limited(patch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Set some limits until the patch is undone."""
    patch.setattr(limits, "LIMITS", replace(limits.LIMITS, **changes))
