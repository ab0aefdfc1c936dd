"""Finished runs without their validation and report: all that the view reads."""

import json
from dataclasses import replace

import pytest
import tomli_w

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import FinishedCase, write_deformation
from sdm_deflect.cases.api import deflect, read
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.report.folder import is_small, settings_of, write_arrays
from sdm_deflect.cases.run.mesh_files import SETTINGS, write_mesh
from sdm_deflect.cases.view.run import InteractiveRun
from sdm_deflect.deform.base.threads import silent
from sdm_deflect.deform.volume.deflection import Deflection, adapted_steps
from sdm_deflect.deform.volume.deflection import deflect as carried_out


@pytest.fixture(scope="session")
def bare_run(tmp_path_factory, make_mesh):
    """Deflect a case and write its files; return the folder."""

    def run(case, solve=carried_out):
        mesh, _ = make_mesh(case)
        plan = plan_of(case, mesh)
        found = solve(plan, plan.angle)
        folder = tmp_path_factory.mktemp(case.name)
        write_deformation(folder, case, found, None)
        write_figures(folder, found)
        return folder

    return run


def in_two_steps(plan, angle):
    """Deflect in two steps, which a run does only where one inverts cells."""
    return Deflection(plan, tuple(adapted_steps(box, plan.amounts_of(box, angle), 2, silent) for box in plan.boxes))


@pytest.fixture(scope="session")
def bare_deflection(tmp_path_factory):
    """Write a mesh to a file, deflect that, and write what the view reads of the folder beside; return the folder."""

    def run(mesh, name, *surface, **options):
        home = tmp_path_factory.mktemp("mesh")
        write_mesh(None, mesh, mesh.points, home / name)
        return written(home / "report", deflect(read(home / name), *surface, **options).deflection)

    return run


def words(answer):
    """What an answer to a page says; its numbers follow."""
    return json.loads(answer[4 : 4 + int.from_bytes(answer[:4], "little")])


def write_figures(folder, one):
    figures = {"mesh": {"points": len(one.points)}, "validation": {"checks": []}}
    (folder / "metrics.json").write_text(json.dumps(figures), encoding="utf-8")


def written(folder, one):
    """Write the settings, points and centres of a deflection; return the folder."""
    folder.mkdir()
    (folder / SETTINGS).write_text(tomli_w.dumps(settings_of(one, folder, folder)), encoding="utf-8")
    write_figures(folder, one)
    write_arrays(folder, one, is_small(one.plan.mesh))
    return folder


@pytest.fixture(scope="session")
def aileron_folder(bare_run):
    """The interpolant's own mesh, without a repair."""
    return bare_run(replace(case_named("aileron"), repair="off"))


@pytest.fixture(scope="session")
def stepped_folder(bare_run):
    return bare_run(case_named("aileron"), in_two_steps)


@pytest.fixture(scope="session")
def aileron(aileron_folder):
    return InteractiveRun.of(FinishedCase.of(aileron_folder))


@pytest.fixture(scope="session")
def tail(bare_run):
    return InteractiveRun.of(FinishedCase.of(bare_run(case_named("tail"))))


@pytest.fixture(scope="session")
def wing_folder(bare_deflection, hybrid_wing, flap_names):
    """A flap in a mesh of hexahedra, prisms, pyramids and tetrahedra."""
    options = {"motion": "blended", "fixed": "wing_*", "slide": {"symmetry": "plane"}, "repair": "off"}
    return bare_deflection(hybrid_wing.mesh, "wing.su2", flap_names, hybrid_wing.hinge, 10.0, **options)


@pytest.fixture(scope="session")
def hybrid(wing_folder):
    return InteractiveRun.of(FinishedRun.of(wing_folder))


@pytest.fixture(scope="session")
def repaired_folder(bare_run):
    """A tail at 33 degrees, where the interpolant alone inverts cells."""
    return bare_run(replace(case_named("tail"), angle=33.0, repair="auto"))


@pytest.fixture(scope="session")
def repaired(repaired_folder):
    return InteractiveRun.of(FinishedCase.of(repaired_folder))
