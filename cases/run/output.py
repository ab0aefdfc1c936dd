"""The files of a run, in a folder that replaces the old one as a whole; also versions, interpreter and machine."""

import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from platform import machine, platform, python_version

import numpy as np
from threadpoolctl import threadpool_info  # type: ignore[import-untyped, unused-ignore]

from sdm_deflect.base.errors import FULL, InputError
from sdm_deflect.base.files import replacing, replacing_files
from sdm_deflect.deform.rbf.data_sites import DIRECTIONS
from sdm_deflect.deform.rbf.kernels import arrays_of
from sdm_deflect.deform.volume.deflection import BoxDeflection

# Parts of the page, with which the names of its pictures begin.
PARTS = ("convergence", "quality", "slices", "cad_map", "rigid_cad_map")
# What text begins with that a spreadsheet runs, and our mark of it.
FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")
# What every command needs.
LIBRARIES = ("numpy", "scipy", "numba", "h5py", "click", "rich", "threadpoolctl", "tomli-w", "platformdirs")
# What extras bring.
OPTIONAL = (
    "cadquery", "cadquery-ocp", "gmsh", "pymeshlab", "pytetwild", "trimesh", "rtree", "vtk", "pyvista", "meshio",
    "matplotlib", "pillow", "jinja2",
)  # fmt: skip
# Modules that an installation may lack, by the extra that brings them.
EXTRAS = {
    "report": ("jinja2", "markupsafe", "matplotlib", "PIL"),
    "aircraft": ("cadquery", "OCP", "gmsh", "meshio", "pymeshlab", "pytetwild", "pyvista", "rtree", "trimesh"),
    "cluster": ("cryptography", "dask", "distributed"),
}
# What needs an extra.
BRINGS = {
    "report": "a report, or a page of sdm view",
    "aircraft": "making and measuring the SDM's CAD and meshes (sdm run, geometry, limit CASE)",
    "cluster": "work by others (--workers, --scheduler)",
}
# A page and its pictures, as patterns.
PAGE = ("report.html", *(f"figures/{part}*.{form}" for part in PARTS for form in ("png", "pdf", "svg")))
# Files of settings: one of them marks a folder as a run's.
SETTINGS_FILES = ("case.toml", "settings.toml")
# Everything that a run folder may hold of ours.
RUN = (
    *SETTINGS_FILES, "metrics.json", "convergence.csv", "interpolant.npz", "plan.npz", "table_[0-9]*.npz",
    "track_[0-9]*.csv",
    "undeflected.vtu", "deflected.vtu", "background.vtu", *PAGE,
)  # fmt: skip


class OutputError(ValueError):
    """The output folder cannot be written."""


@contextmanager
def output_folder(target: Path, stale: Sequence[str] = RUN) -> Iterator[Path]:
    """Yield an empty folder that replaces `target` as one on success; else nothing changes.

    Files of the old folder stay, unless their names match a pattern in `stale`.

    Raises OutputError at once if the folder cannot be made or written, later if a file cannot, for example on a full
    disk; the message names the folder or the final file.
    """
    if target.exists() and not target.is_dir():
        raise OutputError(f"--out {target}: Not a directory; choose a folder that can be written")
    if Path.cwd().is_relative_to(target.resolve()):
        raise OutputError(
            f"--out {target}: this command works in the folder that it is to replace; run it from another"
        )
    _refuse_others(target, stale)
    with _name_errors(target, replacing(target, stale)) as scratch:
        scratch.mkdir()
        yield scratch


def _refuse_others(target: Path, stale: Sequence[str]) -> None:
    """Raise OutputError for a folder that is no earlier run and has files that a run would remove."""
    if not {*stale} & {*SETTINGS_FILES}:
        return
    theirs = [path.name for pattern in stale for path in target.glob(pattern)] if target.is_dir() else []
    if theirs and not {*theirs} & {*SETTINGS_FILES}:
        raise OutputError(f"--out {target} holds {theirs[0]}, and is no earlier run: name another folder")


@contextmanager
def output_files(folder: Path, stale: Sequence[str] = RUN) -> Iterator[Path]:
    """Yield an empty folder whose files and run folders replace those in `folder` together on success.

    Raises OutputError as `output_folder`.
    """
    with _name_errors(folder, replacing_files(folder, stale)) as scratch:
        yield scratch


@contextmanager
def _name_errors(target: Path, scratch: AbstractContextManager[Path]) -> Iterator[Path]:
    """Turn errors of writing into OutputErrors that name the folder."""
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(scratch)
        except OSError as error:
            raise OutputError(f"--out {target}: {error.strerror}; choose a folder that can be written") from None
        try:
            yield folder
        except OSError as error:
            if error.errno in FULL:
                raise OutputError(f"{target}: cannot be written: {error.strerror}") from error
            raise


def write_interpolants(path: Path, deflections: Sequence[BoxDeflection]) -> None:
    """Write kernel, centres and coefficients by direction, by which other programs can evaluate the deformation.

    The first surface's first step has the plain names `centers_x`, `beta_x`, `alpha_x`; further surfaces and
    steps append `_<surface>` and `_step<k>`. Those of the fit for sliding nodes, which are projected onto their
    shapes afterwards, begin with `sliding_`. If planes at an angle slide, that fit is along the rows of
    `sliding_directions` (3, 3) in place of x, y and z. `hexahedron` (8, 3) is the box of each.
    """
    arrays: dict[str, np.ndarray] = {}
    for i, deflection in enumerate(deflections):
        tag = f"_{deflection.plan.surface}" if i else ""
        arrays |= arrays_of(deflection.plan.sites.kernel, tag)
        arrays[f"hexahedron{tag}"] = deflection.plan.region.hexahedron.corners
        for k, step in enumerate(deflection.steps):
            suffix = tag + (f"_step{k + 1}" if k else "")
            carrying = [("sliding_", fit) for fit in step.first.adaptations] if step.first else []
            if carrying and step.start.directions is not None:
                arrays[f"sliding_directions{suffix}"] = step.start.directions
            for prefix, fit in (*carrying, *(("", fit) for fit in step.fits.adaptations)):
                for column, component in enumerate(fit.components):
                    name = f"{DIRECTIONS[component]}{suffix}"
                    arrays[f"{prefix}centers_{name}"] = fit.interpolant.centers
                    arrays[f"{prefix}beta_{name}"] = fit.interpolant.beta[:, column]
                    arrays[f"{prefix}alpha_{name}"] = fit.interpolant.alpha[:, column]
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


def write_convergence(path: Path, deflections: Sequence[BoxDeflection]) -> None:
    """Write the adaptation history: one row per surface, step, group and iteration."""
    rows: list[Sequence[object]] = [("direction", "iteration", "centres", "max_error", "seconds", "surface", "step")]
    for deflection in deflections:
        for k, step in enumerate(deflection.steps, 1):
            for fit in step.fits.adaptations:
                direction = "".join(DIRECTIONS[c] for c in fit.components)
                for row in fit.history:
                    figures = (f"{row.max_residual:.6e}", f"{row.seconds:.6f}")
                    rows.append((direction, row.iteration, row.n_centers, *figures, deflection.plan.surface, k))
    write_table(path, rows)


def write_table(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write a .csv; text that a spreadsheet would run as a formula has an apostrophe before it (`text_of`)."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([_cell(cell) for cell in row] for row in rows)


def _cell(value: object) -> object:
    if isinstance(value, str) and value.startswith(FORMULA):
        try:
            float(value)
        except ValueError:
            return f"'{value}"
    return value


def text_of(cell: str) -> str:
    """Return the text that `write_table` wrote as a cell."""
    return cell[1:] if cell.startswith("'") and cell[1:].startswith(FORMULA) else cell


def lacks(extra: str) -> str:
    """Return a sentence on the libraries of an extra that are not installed; empty if all are."""
    absent = [name for name in EXTRAS[extra] if find_spec(name) is None]
    return f"{BRINGS[extra]} needs {', '.join(absent)}: in your clone, pip install '.[{extra}]'" if absent else ""


def check_installed(extra: str) -> None:
    """Raise InputError if a library of an extra is missing."""
    if text := lacks(extra):
        raise InputError(text)


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
    lines = {f"{pool['internal_api']} {pool.get('version') or ''}, {pool['num_threads']} threads" for pool in pools}
    return "; ".join(sorted(lines)) or "none loaded"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def missing(error: ModuleNotFoundError) -> str:
    """Return a sentence on the extra that installs a missing module; empty if none does."""
    module = (error.name or "").partition(".")[0]
    extra = next((name for name, modules in EXTRAS.items() if module in modules), "")
    return extra and f"this needs {module}, which is not installed: in your clone, pip install '.[{extra}]'"
