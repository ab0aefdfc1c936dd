"""One mesh cache for all test processes, so that each real mesh is made once per test run."""

import os
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

from sdm_deflect.base.compiled import CODE_VARIABLE, FOLDER_VARIABLE, code_folder
from sdm_deflect.cases.run.progress import Stopwatch
from tests import calls
from tests.deform.blocks import annulus_with_fin, block_with_body
from tests.extras import AIRCRAFT, OF_PARTS, loaded, without
from tests.meshing.formats.wing import FLAP, wing

# Environment variable: a folder in which meshes are kept from one test run to the next.
KEPT_MESHES = "SDM_DEFLECT_TEST_MESHES"

# Folders whose tests need the aircraft's libraries to be collected.
OF_AIRCRAFT = ("cases", "geometry", "meshing/generate")
# Folders whose tests need neither a run of a case nor a browser nor a solver.
UNIT = {"deform", "frozen", "geometry", "meshing"}

# A shared machine may pause a test: no example of a property fails by the clock.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_itemcollected(item: pytest.Item) -> None:
    """Put a test in its layer: nightly if it says so, unit by its folder, else contract."""
    if item.get_closest_marker("nightly") is None:
        folder = item.path.relative_to(Path(__file__).parents[1]).parts[1]
        item.add_marker("unit" if folder in UNIT else "contract")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item):
    """Skip a test whose fixtures need a library of an extra that is not installed."""
    return (yield from skipping())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item):
    """Skip a test of a part of the package that needs a library of an extra that is not installed."""
    return (yield from skipping())


def skipping():
    """Turn the want of a library of `OF_PARTS` into a skip."""
    try:
        return (yield)
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name in OF_PARTS:
            pytest.skip(without(name) or str(error))
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):
    """Let a test that is skipped, for want of a library or a program, fail in a pipeline (CI)."""
    report = yield
    if report.skipped and os.environ.get("CI"):
        report.outcome = "failed"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector):
    """Let a file that is skipped for want of a library fail in a pipeline (CI), too."""
    report = yield
    if report.skipped and os.environ.get("CI"):
        report.outcome = "failed"
    return report


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out the tests of the aircraft where its libraries are not installed; in a pipeline (CI) they fail."""
    left_out = without(AIRCRAFT) and not os.environ.get("CI")
    return True if left_out and collection_path.relative_to(Path(__file__).parent).as_posix() in OF_AIRCRAFT else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests were left out, and what they need."""
    if without(AIRCRAFT) and not os.environ.get("CI"):
        terminalreporter.write_line(f"left out: tests/{', tests/'.join(OF_AIRCRAFT)}; {without(AIRCRAFT)}")


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder that every worker of this test run sees."""
    base = tmp_path_factory.getbasetemp()
    return base if worker_id == "master" else base.parent


@pytest.fixture(scope="session", autouse=True)
def mesh_cache(shared_folder: Path):
    """Keep the user's mesh cache out of the tests, and put the meshes of `tests.kept_meshes` in theirs.

    Compiled code is that of all commands.
    """
    folder = Path(os.environ.get(KEPT_MESHES) or shared_folder / "meshes")
    with FileLock(shared_folder / "kept.lock"):
        if not folder.exists():
            folder.mkdir(parents=True)
            if not without(AIRCRAFT):
                loaded("tests.kept_meshes").put(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CODE_VARIABLE, str(code_folder()))
        patch.setenv(FOLDER_VARIABLE, str(folder))
        yield folder


@pytest.fixture(scope="session")
def make_mesh(shared_folder: Path, mesh_cache: Path):
    """Mesh a case, once among all workers."""

    def make(case):
        with FileLock(shared_folder / "meshing.lock"):
            return loaded("sdm_deflect.cases.aircraft.pipeline").mesh_of_case(case, Stopwatch())

    return make


@pytest.fixture(scope="session")
def aileron_mesh(make_mesh):
    """The undeflected small mesh of the aileron case and how it was made."""
    return make_mesh(loaded("sdm_deflect.cases.aircraft.registry").case_named("aileron"))


@pytest.fixture
def sdm(capsys: pytest.CaptureFixture[str]):
    """Carry out `sdm` in this process; return its exit code, standard output and error."""
    return lambda *words: (calls.sdm(*words), *capsys.readouterr())


@pytest.fixture(scope="session")
def flap_names():
    """Patches of the flap of `hybrid_wing`."""
    return FLAP


@pytest.fixture(scope="session")
def hybrid_wing():
    """Half wing with a flap in the middle of its trailing edge, no gap."""
    return wing(cells=4)


@pytest.fixture(scope="session")
def inboard_wing():
    """The same with a flap that ends at the symmetry plane."""
    return wing(flap=(0.0, 0.5), cells=4)


@pytest.fixture(scope="session")
def block():
    """A cube of hexahedra around a cubic body."""
    return block_with_body()


@pytest.fixture(scope="session")
def block_on_cylinder():
    """A quarter annulus of hexahedra with a fin on its inner cylinder."""
    return annulus_with_fin()
