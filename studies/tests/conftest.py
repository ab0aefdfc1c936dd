"""The fixtures and layers of the tests of the product."""

from tests.cases.conftest import aileron_run, chimera_run, finish, tail_run  # noqa: F401
from tests.conftest import *  # noqa: F403
