"""What the program runs on: libraries and their versions, interpreter, machine."""

import os
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from platform import machine, platform, python_version

from threadpoolctl import threadpool_info  # type: ignore[import-untyped, unused-ignore]

LIBRARIES = ("numpy", "scipy", "numba", "h5py", "click", "rich", "threadpoolctl", "tomli-w", "platformdirs")
"""What every command needs."""
OPTIONAL = (
    "cadquery", "cadquery-ocp", "gmsh", "pymeshlab", "pytetwild", "trimesh", "rtree", "vtk", "pyvista", "meshio",
    "matplotlib", "pillow", "jinja2", "aiohttp",
)  # fmt: skip
"""What extras bring."""
EXTRAS = {
    "report": ("jinja2", "markupsafe", "matplotlib", "PIL"),
    "view": ("aiohttp",),
    "aircraft": ("cadquery", "OCP", "gmsh", "meshio", "pymeshlab", "pytetwild", "rtree", "trimesh"),
    "cluster": ("cryptography", "dask", "distributed"),
}
"""Modules that an installation may lack, by the extra that brings them."""


def versions(libraries: Sequence[str] = (*LIBRARIES, *OPTIONAL)) -> dict[str, str]:
    """Return the version of each library, empty where it is missing."""
    return {name: _version(name) for name in libraries}


def surroundings() -> dict[str, str]:
    """Return program, interpreter, system and threads in words."""
    return {
        "sdm-deflect": _version("sdm-deflect"),
        "Python": python_version(),
        "system": platform(),
        "processor": f"{machine()}, {usable_cores()} cores for this process",
        "linear algebra": blas(),
    }


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def blas() -> str:
    """Return the linear algebra libraries that are loaded and their threads."""
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    found = {f"{pool['internal_api']} {pool.get('version') or ''}, {pool['num_threads']} threads" for pool in pools}
    return "; ".join(sorted(found)) or "none loaded"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def missing(error: ModuleNotFoundError) -> str:
    """Return which extra brings a module that is not installed, as a sentence; empty if none does."""
    module = (error.name or "").partition(".")[0]
    extra = next((name for name, modules in EXTRAS.items() if module in modules), "")
    return extra and f"this needs {module}, which is not installed: in your clone, pip install '.[{extra}]'"
