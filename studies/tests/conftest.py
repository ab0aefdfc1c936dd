"""The fixtures and layers of the tests of the product."""

from tests.cases.conftest import aileron_run, finish  # noqa: F401
from tests.conftest import *  # noqa: F403
