"""Other limits of size for a test."""

from dataclasses import replace
from typing import Any

import pytest

from sdm_deflect.base import threads


def limited(patch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Set some limits until the patch is undone."""
    patch.setattr(threads, "LIMITS", replace(threads.LIMITS, **changes))
