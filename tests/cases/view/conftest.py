"""Finished runs without their validation and report: all that the view reads."""

import pytest

from sdm_deflect.cases.sdm.job import deflected, plans_of
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.sdm.run_folder import write_deformation
from sdm_deflect.cases.view.live import Live
from sdm_deflect.deform.progress import silent
from sdm_deflect.deform.volume.deflection import _stepped, combined


@pytest.fixture(scope="session")
def bare_run(tmp_path_factory, make_mesh):
    """Deflect a case and write its files; return the folder."""

    def run(case, solve=deflected):
        mesh, _ = make_mesh(case)
        flow = mesh.as_mesh(case.name)
        results = solve(case, plans_of(case, flow))
        folder = tmp_path_factory.mktemp(case.name)
        write_deformation(folder, case, mesh, mesh.with_points(combined(flow, results)), results, None)
        return folder

    return run


def in_two_steps(case, plans):
    """Deflect in two steps, which a run does only where one inverts cells."""
    return tuple(
        _stepped(plan, turn.factor * case.angle, 2, silent, None)
        for plan, turn in zip(plans, case.deflections, strict=True)
    )


@pytest.fixture(scope="session")
def aileron_folder(bare_run):
    return bare_run(case_named("aileron"))


@pytest.fixture(scope="session")
def stepped_folder(bare_run):
    return bare_run(case_named("aileron"), in_two_steps)


@pytest.fixture(scope="session")
def aileron(aileron_folder):
    return Live.of(aileron_folder)


@pytest.fixture(scope="session")
def tail(bare_run):
    return Live.of(bare_run(case_named("tail")))
