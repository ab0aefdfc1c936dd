"""Machine code on disk is of our own kernels alone."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from sdm_deflect.base.compiled import MARK, for_code
from sdm_deflect.deform.rbf.kernels import (
    Kernel,
    MultiquadricCode,
    ThinPlateSplineCode,
    _sum_rows,
    kernel_matrix,
    kernel_sum,
)

ROOT = Path(__file__).parents[3]
SOURCES = ("sdm_deflect", "cases", "deform", "geometry", "meshing")
FOREIGN = """
from typing import Any, NamedTuple
import numpy as np
from sdm_deflect.deform.rbf.kernels import Kernel

class CubicCode(NamedTuple):
    pass

class Cubic(Kernel):
    numbers = CubicCode

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:
        return r2 * np.sqrt(r2)
"""
PROGRAM = """
import numpy as np
from sdm_deflect.deform.rbf.kernels import kernel_matrix, kernel_sum, _matrix_rows, _sum_rows
from {module} import {kernel}
x, zero = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.zeros((4, 1))
print(kernel_sum({kernel}(), x, x, np.array([[1.0], [0.0]]), zero)[1, 0], kernel_matrix({kernel}(), x, x)[0, 1])
print(*(sum(loop.stats.cache_hits.values()) for loop in (_sum_rows, _matrix_rows)))
"""


@pytest.fixture
def results(tmp_path):
    """Run the program with a kernel: its two results and the loops that it found on disk."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba")}

    def run(module, kernel, path=""):
        words = [sys.executable, "-c", PROGRAM.format(module=module, kernel=kernel)]
        paths = os.pathsep.join(filter(None, [str(path), *sys.path]))
        done = subprocess.run(words, env={**environment, "PYTHONPATH": paths}, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        values, hits = done.stdout.splitlines()
        return [float(value) for value in values.split()], [int(hit) for hit in hits.split()]

    return run


def test_a_foreign_kernel_leaves_nothing_that_stops_others(results, tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "foreign.py").write_text(FOREIGN)
    assert results("foreign", "Cubic", own) == ([8.0, 8.0], [0, 0])
    spline = pytest.approx([2.7725887222397811] * 2)  # 4 log 2
    assert results("sdm_deflect.deform.rbf.kernels", "ThinPlateSpline") == (spline, [0, 0])
    assert results("sdm_deflect.deform.rbf.kernels", "ThinPlateSpline") == (spline, [1, 1])
    (own / "foreign.py").write_text(FOREIGN.replace("r2 * np.sqrt(r2)", "np.sqrt(r2)"))
    assert results("foreign", "Cubic", own) == ([2.0, 2.0], [0, 0])


SUM = """
import numba
from sdm_deflect.deform.rbf.kernels import kernel_matrix, _matrix_rows
import sdm_deflect, resource, numpy as np
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
assert not numba.config.CACHE_DIR  # functions of others stay where they were
resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))
x = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
print(kernel_matrix(ThinPlateSpline(), x, x)[0, 1], sum(_matrix_rows.stats.cache_hits.values()), sdm_deflect.__file__)
"""


@pytest.fixture
def sums(tmp_path):
    """Run a program in a copy of the package: a sum, whether its loop was on disk, and files of compiled code there."""
    place = tmp_path / "place" / "sdm_deflect"
    for room in ("deform", "meshing"):
        shutil.copytree(ROOT / room, place / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "sdm_deflect" / "base", place / "base")
    (place / "__init__.py").touch()

    def run(room=1 << 30, **given):
        clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        environment = {**clean, "SDM_DEFLECT_CACHE": str(tmp_path / "cache"), "HOME": str(tmp_path / "home"), **given}
        words = [sys.executable, "-c", SUM.format(room=room)]
        done = subprocess.run(words, env=environment, cwd=place.parent, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        value, hits, file = done.stdout.split()
        assert Path(file).parent == place
        assert not list(tmp_path.glob("home/**/*.nb*"))
        assert not list(place.rglob("*.nb*"))
        return float(value), int(hits)

    run.place, run.cache = place, tmp_path / "cache"
    return run


def test_machine_code_is_kept_in_the_cache_folder_for_the_sources_as_they_are(sums):
    spline = pytest.approx(2.7725887222397811)  # 4 log 2
    assert sums(room=0) == (spline, 0)  # as on a full disk
    assert sums() == (spline, 0)
    assert sums() == (spline, 1)
    assert list(sums.cache.glob("numba/*/*/*.nbc"))
    kernels = sums.place / "deform" / "rbf" / "kernels.py"
    kernels.write_text(kernels.read_text().replace("return r2 * scaled_log(r2)", "return 3.0 * r2 * scaled_log(r2)"))
    assert sums() == (pytest.approx(3.0 * 2.7725887222397811), 0)


FOLDER = """
from sdm_deflect.base import compiled
print(len([text for text in compiled._sources() if compiled.MARK in text]), compiled._folder())
"""


@pytest.mark.parametrize("tree", ["clone", "clone without links", "wheel"])
def test_an_edit_of_a_called_function_changes_the_folder_of_machine_code(tree, tmp_path):
    rooms = tmp_path / "sdm_deflect" if tree == "wheel" else tmp_path
    for room in ("deform", "meshing"):
        shutil.copytree(ROOT / room, rooms / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "sdm_deflect" / "base", tmp_path / "sdm_deflect" / "base")
    shutil.copy(ROOT / "sdm_deflect" / "__init__.py", tmp_path / "sdm_deflect")
    for room in ("deform", "meshing"):
        link = tmp_path / "sdm_deflect" / room
        if tree == "clone":
            link.symlink_to(f"../{room}")
        elif tree == "clone without links":
            link.write_text(f"../{room}")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba")}

    def folder():
        words = [sys.executable, "-c", FOLDER]
        done = subprocess.run(words, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    marked = [path for room in SOURCES for path in (ROOT / room).rglob("*.py") if MARK in path.read_bytes()]
    folders = [folder()]
    assert int(folders[0][0]) == len(marked) > 10
    for file in ("deform/rbf/kernels.py", "meshing/mesh/compiled_quality.py", "meshing/mesh/layers.py"):
        edited = rooms / file
        assert MARK in edited.read_bytes()
        edited.write_text(edited.read_text().replace("    return ", "    return 1.0 * ", 1))
        folders.append(folder())
        assert folders[-1] not in folders[:-1]


def test_where_no_folder_can_be_written_functions_are_compiled_all_the_same(sums):
    assert sums(SDM_DEFLECT_CACHE="/dev/null/none") == (pytest.approx(2.7725887222397811), 0)


class LinearCode(NamedTuple):
    """The linear kernel has no number."""


class Linear(Kernel):
    """phi(r) = r, of a module outside the package."""

    sign = -1.0
    numbers = LinearCode

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:
        return np.sqrt(r2)


def test_a_foreign_kernel_is_summed_like_any():
    rng = np.random.default_rng(0)
    points, centers, beta = rng.random((300, 3)), rng.random((90, 3)), rng.random((90, 3))
    distances = np.linalg.norm(points[:, None] - centers, axis=2)
    np.testing.assert_allclose(kernel_matrix(Linear(), points, centers), distances, rtol=1e-13)
    got = kernel_sum(Linear(), points, centers, beta, np.zeros((4, 3)))
    np.testing.assert_allclose(got, distances @ beta, rtol=1e-12)


def test_our_own_kernels_keep_the_loops_of_the_disk():
    assert for_code(_sum_rows, ThinPlateSplineCode()) is _sum_rows
    assert for_code(_sum_rows, MultiquadricCode(1.0)) is _sum_rows
    assert for_code(_sum_rows, LinearCode()) is for_code(_sum_rows, LinearCode()) is not _sum_rows
