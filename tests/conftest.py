"""One mesh cache for all test processes, so that each real mesh is made once per test run."""

import os
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

from sdm_deflect.cases.progress import Silent, Stopwatch
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.pipeline import meshed
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.meshing.cache import FOLDER_VARIABLE

# A shared machine may pause a test: no example of a property fails by the clock.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):
    """Let a test that a developer may skip, for want of OpenFOAM or a browser, fail in a pipeline (CI)."""
    report = yield
    if report.skipped and os.environ.get("CI"):
        report.outcome = "failed"
    return report


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder that every worker of this test run sees."""
    base = tmp_path_factory.getbasetemp()
    return base if worker_id == "master" else base.parent


@pytest.fixture(scope="session", autouse=True)
def mesh_cache(shared_folder: Path):
    """Keep the user's mesh cache out of the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(shared_folder / "meshes"))
        yield shared_folder / "meshes"


@pytest.fixture(scope="session")
def make_mesh(shared_folder: Path, mesh_cache: Path):
    """Mesh a case, once among all workers."""

    def make(case: Case):
        with FileLock(shared_folder / "meshing.lock"):
            return meshed(case, Stopwatch(Silent()))

    return make


@pytest.fixture(scope="session")
def aileron_mesh(make_mesh):
    """The undeflected small mesh of the aileron case and how it was made."""
    return make_mesh(case_named("aileron"))
