"""The fixtures and layers of the tests of the product."""

from tests.conftest import *  # noqa: F403
