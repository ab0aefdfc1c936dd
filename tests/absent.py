"""Tests that lack something, which `test_newcomer.py` runs."""

from tests.extras import Library, needs_program

absent = Library("no_such_library")


def test_that_uses_a_library():
    absent.function()


@needs_program("no-such-program")
def test_that_runs_a_program():
    pass


def test_of_a_part_of_the_package():
    raise ModuleNotFoundError("No module named 'meshio'", name="meshio")


def test_that_needs_nothing():
    pass


def test_that_is_wrong():
    raise ModuleNotFoundError("No module named 'rich'", name="rich")
