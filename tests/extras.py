"""Libraries and programs that some tests need, and a newcomer may not have."""

import shutil
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import pytest

# What installs everything that tests need.
INSTALL = "pip install -c constraints.txt -e '.[dev]'"
# Debian's packages of the programs that judge files and pages.
PACKAGES = {"cgnscheck": "cgns-convert", "chromium": "chromium", "g++": "g++", "mpirun": "openmpi-bin"}

# The library of the aircraft's CAD.
AIRCRAFT = "cadquery"
# Libraries of extras that parts of the core use, for files of Gmsh, meshes of other libraries and generated ones.
OF_PARTS = ("meshio", "pyvista", "vtkmodules", "gmsh", "cadquery-ocp")


class Library:
    """A library that is loaded when a test uses it; a test without it is skipped, and fails in a pipeline (CI)."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith(("_", "pytest")):  # pytest asks each name of a file whether it is a test
            raise AttributeError(name)
        return getattr(loaded(self._name), name)


def loaded(name: str) -> ModuleType:
    """Return a library, or skip the test or the tests that are collected."""
    try:
        return import_module(name)
    except ModuleNotFoundError:
        pytest.skip(f"{name} is not installed: {INSTALL}", allow_module_level=True)


def without(name: str) -> str:
    """Return the sentence that says how to install a library; empty if it is installed."""
    return "" if name.isidentifier() and find_spec(name) else f"{name} is not installed: {INSTALL}"


def needs_program(name: str) -> pytest.MarkDecorator:
    """Return the mark that skips a test without a program; it fails in a pipeline (CI)."""
    return pytest.mark.skipif(shutil.which(name) is None, reason=missing_program(name))


def missing_program(name: str) -> str:
    """Return the sentence that says how to install a program, by default one of OpenFOAM."""
    return f"{name} is not installed: apt-get install {PACKAGES.get(name, 'openfoam')}"
