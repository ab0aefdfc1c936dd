"""What pip installs: one import name, with all its files, and nothing beside it."""

import csv
import email
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, metadata, version
from pathlib import Path, PurePosixPath

import numpy
import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
FOLDERS = ("sdm_deflect", "cases", "deform", "geometry", "meshing")
FILES = ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "CHANGELOG.md", "CITATION.cff", "SECURITY.md")
BUILD = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"
DATA = (".html", ".css", ".js", ".gz", ".xz", ".LICENSE")


def built(what: str, source: Path, out: Path) -> Path:
    """Build a distribution (``build_wheel`` or ``build_sdist``) of a source folder as pip does."""
    done = subprocess.run(
        [sys.executable, "-c", BUILD, what, str(out)], cwd=source, capture_output=True, text=True, check=True
    )
    return out / done.stdout.split()[-1]


def recorded(wheel: Path) -> set[str]:
    """Return the names in the RECORD of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/RECORD"))
        return {row[0] for row in csv.reader(archive.read(name).decode().splitlines())}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of the checkout, its links kept as links: a build leaves files in its source."""
    folder = tmp_path_factory.mktemp("source")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, folder)
    for name in ("tests", "benchmarks", "docs"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").touch()
    (folder / "tests" / "test_something.py").touch()
    return folder


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    return built("build_wheel", source, tmp_path_factory.mktemp("wheel"))


def test_the_package_is_the_only_name_at_top_level(wheel):
    names = {PurePosixPath(name).parts[0] for name in recorded(wheel)}
    assert {name for name in names if not name.endswith(".dist-info")} == {"sdm_deflect"}
    assert len(names) == 2


def test_every_module_and_data_file_of_the_checkout_is_inside(wheel):
    files = {
        f"sdm_deflect/{path.relative_to(ROOT).as_posix()}"
        for folder in FOLDERS[1:]
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".py", *DATA) or path.name == "py.typed"
    }
    assert {Path(name).suffix for name in files} >= {".py", *DATA}
    own = {path.relative_to(ROOT).as_posix() for path in (ROOT / "sdm_deflect").rglob("*.py")}
    assert "sdm_deflect/base/compiled.py" in own
    assert files | own | {"sdm_deflect/py.typed"} <= recorded(wheel)


def test_each_package_of_the_checkout_is_named():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    folders = {path.parent.relative_to(ROOT) for name in FOLDERS[1:] for path in (ROOT / name).rglob("*.py")}
    links = {f"sdm_deflect.{'.'.join(folder.parts)}" for folder in folders}
    assert set(listed) == {"sdm_deflect", "sdm_deflect.base", *links}


def test_a_clone_without_symbolic_links_is_whole(source, wheel, tmp_path):
    """Git on Windows makes text files of links: the wheel is the same, and the tree can be imported."""
    shutil.copytree(source, tmp_path / "clone", symlinks=True)
    for name in FOLDERS[1:]:
        link = tmp_path / "clone" / "sdm_deflect" / name
        target = link.readlink()
        link.unlink()
        link.write_text(str(target))
    (tmp_path / "wheel").mkdir()
    assert recorded(built("build_wheel", tmp_path / "clone", tmp_path / "wheel")) == recorded(wheel)
    work = "import sdm_deflect; from sdm_deflect.deform.volume import step; print(sdm_deflect.deflect, step.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", work], cwd=tmp_path / "clone", capture_output=True, text=True, check=True
    )
    assert str(tmp_path / "clone" / "deform" / "volume" / "step.py") in done.stdout


ELSEWHERE = """
import importlib, json, os, pkgutil, signal, sys, time
for name in json.loads(sys.argv[1]):  # libraries know what each system has
    importlib.import_module(name)
gone = {signal: "SIGHUP SIGKILL SIGPIPE pthread_sigmask", time: "CLOCK_BOOTTIME clock_gettime"}
gone[os] = "O_DIRECTORY O_NOFOLLOW O_NONBLOCK fork geteuid getuid sched_getaffinity sysconf"
for module, names in gone.items():
    for name in names.split():
        delattr(module, name)
sys.modules |= dict.fromkeys(("fcntl", "pwd", "resource", "termios"))
import sdm_deflect
for found in pkgutil.walk_packages(sdm_deflect.__path__, "sdm_deflect."):
    if not found.name.endswith("__main__"):
        print(importlib.import_module(found.name).__name__)
from sdm_deflect.cases.run.metrics import peak_rss_bytes
from sdm_deflect.cases.run.progress import process_start
assert peak_rss_bytes() == 0 and process_start() > 0.0
"""
LIBRARIES = (
    "cadquery", "click", "gmsh", "h5py", "jinja2", "matplotlib.figure", "matplotlib.tri", "meshio",
    "numba", "PIL.Image", "pyvista", "rich.progress", "rich.table", "scipy.interpolate", "scipy.optimize",
    "scipy.sparse.linalg",
    "scipy.spatial", "threadpoolctl", "tomli_w", "trimesh",
)  # fmt: skip


def test_all_modules_import_where_the_names_of_linux_are_missing():
    """As on Windows and macOS, as far as names go; no test runs there."""
    words = [sys.executable, "-c", ELSEWHERE, json.dumps(LIBRARIES)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    modules = {path for name in FOLDERS[1:] for path in (ROOT / name).rglob("*.py") if path.name != "__main__.py"}
    modules |= {*(ROOT / "sdm_deflect" / "base").glob("*.py")}
    assert len(done.stdout.splitlines()) == len(modules) + 1  # and the one for OpenMDAO


def test_licence_readme_and_command_are_in_the_metadata(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {PurePosixPath(name).name: name for name in archive.namelist() if ".dist-info/" in name}
        about = email.message_from_bytes(archive.read(names["METADATA"]))
        commands = archive.read(names["entry_points.txt"]).decode()
        licence = archive.read(names["LICENSE"]).decode()
    assert about["License-Expression"] == "MIT"
    assert licence == (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert about.get_payload().strip() == (ROOT / "README.md").read_text(encoding="utf-8").strip()
    assert "sdm = sdm_deflect.cases.cli:main" in commands


@pytest.fixture(scope="module")
def source_archive(source, tmp_path_factory):
    return built("build_sdist", source, tmp_path_factory.mktemp("sdist"))


def test_the_source_distribution_holds_what_a_build_needs_and_no_tests(source_archive):
    with tarfile.open(source_archive) as content:
        names = {PurePosixPath(*PurePosixPath(name).parts[1:]) for name in content.getnames()}
    assert {PurePosixPath(name) for name in FILES} <= names
    assert {str(name.parts[0]) for name in names if name.parts} & {"tests", "benchmarks", "studies", "docs"} == set()


def test_a_wheel_from_the_source_distribution_is_the_same(source_archive, wheel, tmp_path):
    archive = source_archive
    with tarfile.open(archive) as content:
        content.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.2 has none
        content.extractall(tmp_path)
    (tmp_path / "again").mkdir()
    again = built("build_wheel", tmp_path / archive.name.removesuffix(".tar.gz"), tmp_path / "again")
    assert recorded(again) == recorded(wheel)


def test_the_unpacked_wheel_works_away_from_the_checkout(wheel, tmp_path):
    """Modules import, data files are found beside them, and the command answers."""
    zipfile.ZipFile(wheel).extractall(tmp_path)
    work = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
import sdm_deflect
from sdm_deflect.cases.report import page
assert page.HERE
print(sdm_deflect.__file__)
"""
    isolated = [sys.executable, "-c", work]
    done = subprocess.run(isolated, cwd=tmp_path, env={}, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).is_relative_to(tmp_path)
    command = [sys.executable, "-m", "sdm_deflect", "list"]
    done = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, check=True)
    assert "aileron-chimera" in done.stdout


USE = """
from sdm_deflect.deform.rbf.kernels import scaled_log
assert abs(scaled_log(4.0) - scaled_log(2.0)) > 0.1
import sdm_deflect
print(sdm_deflect.__file__)
"""


@pytest.fixture
def environment(tmp_path):
    """An empty virtual environment that sees all libraries of this one but the package: its interpreter."""
    venv.create(tmp_path / "venv", with_pip=False)
    own, (new,) = Path(numpy.__file__).parents[1], (tmp_path / "venv").glob("lib/*/site-packages")
    (tmp_path / "libraries").mkdir()
    for one in own.iterdir():
        if "sdm_deflect" not in one.name:
            (tmp_path / "libraries" / one.name).symlink_to(one)
    (new / "libraries.pth").write_text(str(tmp_path / "libraries"))
    return tmp_path / "venv" / "bin" / "python"


def test_pip_replaces_and_removes_a_package_that_was_used(environment, wheel, source, tmp_path):
    """Nothing that use leaves in the package's folder outlives it, where it would hide the next one."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
    clean |= {"SDM_DEFLECT_CACHE": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}

    def python(*words):
        done = subprocess.run([environment, *words], cwd=tmp_path, env=clean, capture_output=True, text=True)
        return done.stdout.strip() + done.stderr

    def pip(*words):
        said = python("-m", "pip", "-q", "--disable-pip-version-check", *words)
        assert "ERROR" not in said, said

    pip("install", "--no-deps", "--no-index", str(wheel))
    installed = Path(python("-c", USE)).parent
    assert installed.parent.name == "site-packages"
    assert list(tmp_path.glob("cache/numba/*/*/*.nbc"))
    pip("install", "--no-deps", "--no-index", "--no-build-isolation", "-e", str(source))
    assert not installed.exists()
    assert Path(python("-c", USE)) == source / "sdm_deflect" / "__init__.py"
    pip("uninstall", "-y", "sdm-deflect")
    assert "ModuleNotFoundError: No module named 'sdm_deflect'" in python("-c", "import sdm_deflect")
    assert not list(source.rglob("*.nb[ci]"))


# Pythons that the constraints must suit: the oldest that is allowed, Debian 12's, Ubuntu 24.04's, and a new one.
PYTHONS = ("3.11.0", "3.11.2", "3.12.3", "3.13.0")


def constraints() -> dict[str, str]:
    """Return the versions of constraints.txt by name."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return dict(line.split("==") for line in lines if line and not line.startswith("#"))


@pytest.mark.parametrize("python", PYTHONS)
def test_each_version_in_the_constraints_is_for_every_python_that_the_package_allows(python):
    """By the metadata of what is installed; the nightly test below asks pip."""
    allowed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert SpecifierSet(allowed).contains(python)
    others, seen = {}, 0
    for name, wanted in constraints().items():
        with suppress(PackageNotFoundError):
            needed = metadata(name).get("Requires-Python", "")
            if version(name) == wanted and not SpecifierSet(needed).contains(python):
                others[f"{name}=={wanted}"] = needed
            seen += version(name) == wanted
    assert others == {}
    assert seen > 100, "the environment is not that of README's test command"


@pytest.mark.nightly
@pytest.mark.parametrize("python", PYTHONS)
def test_pip_resolves_the_constraints(python, tmp_path):
    words = ["install", "--dry-run", "--ignore-installed", "--only-binary=:all:", "-q", "--python-version", python]
    command = [sys.executable, "-m", "pip", *words, "--target", tmp_path, "-c", "constraints.txt", ".[dev]"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("python", "allowed"), [("3.10.13", False), ("3.12.0", False), ("3.12.1", False), ("3.12.2", True)]
)
def test_pythons_that_end_in_segmentation_faults_are_left_out(python, allowed):
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert SpecifierSet(needed).contains(python) is allowed
