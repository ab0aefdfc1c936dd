"""Finished runs that the tests of this folder share."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from filelock import FileLock

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.pipeline import run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.validation import validate
from sdm_deflect.cases.run.output import output_folder
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.volume.deflection import deflect
from tests.cases.sdm.deflected_cad import built
from tests.extras import Library, missing_program

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SWITCHES = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--disable-background-networking", "--disable-dev-shm-usage",
]  # fmt: skip
DRAWN = "#turnable[data-state=deflected]"
UNFOLD = "document.querySelectorAll('details').forEach((one) => { one.open = true })"


@pytest.fixture(scope="session")
def browser():
    """Chromium without a window, drawing by software; one for all files, since Playwright allows one at a time."""
    if CHROMIUM is None:
        pytest.skip(missing_program("chromium"))
    with Library("playwright.sync_api").sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=SWITCHES)
        yield started
        started.close()


@pytest.fixture
def opened(browser):
    """Open a file; return the page, what it asked of any network, and what it complained of."""
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    asked, complaints = [], []

    def open_file(path):
        tab = context.new_page()
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.goto(path.as_uri())
        tab.wait_for_selector(DRAWN, timeout=60_000)
        return tab, asked, complaints

    yield open_file
    context.close()


@pytest.fixture(scope="session")
def finish(shared_folder, make_mesh):
    """Run a case into a folder, once among all workers; return the run and the folder."""

    def run(case, name, report=False):
        folder = shared_folder / "runs" / name
        with FileLock(shared_folder / f"{name}.lock"):
            kept = folder.with_suffix(".pickle")
            if not kept.exists():
                make_mesh(case)
                with output_folder(folder) as scratch:
                    finished = run_case(case, Stopwatch(), Path(scratch), report=report)
                kept.write_bytes(pickle.dumps(finished))
            return pickle.loads(kept.read_bytes()), folder

    return run


@pytest.fixture(scope="session")
def aileron_run(finish):
    """Case 5.1 at -12 degrees, SQUV, with its report."""
    return finish(case_named("aileron"), "aileron", report=True)


@pytest.fixture(scope="session")
def aileron_mv_run(finish):
    """The same with one set of centres for all directions."""
    case = case_named("aileron")
    return finish(replace(case, adaptation=replace(case.adaptation, strategy="mv")), "aileron-mv")


@pytest.fixture(scope="session")
def tail_run(finish):
    """Case 5.3 at +12 degrees."""
    return finish(case_named("tail"), "tail")


@pytest.fixture(scope="session")
def chimera_run(finish):
    """Case 5.2 at -30 degrees, with its background."""
    return finish(replace(case_named("aileron-chimera"), angle=-30.0), "aileron-chimera")


@pytest.fixture(scope="session")
def turned(make_mesh):
    """Mesh, deflect and validate a case without report and background; return run-like pieces."""

    def turn(case):
        mesh, _ = make_mesh(case)
        plan = plan_of(case, mesh)
        found = deflect(plan)
        moved = mesh.with_points(found.points)
        return mesh, moved, validate(case, found, checks_of(found, unit="m"), built(case))

    return turn
