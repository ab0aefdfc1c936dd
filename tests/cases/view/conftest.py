"""Finished runs without their validation and report: all that the view reads."""

import pytest

from sdm_deflect.cases.output import write_deformation
from sdm_deflect.cases.sdm.job import mover
from sdm_deflect.cases.sdm.pipeline import combined
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.view.live import Live


def silent(text, fraction):
    pass


@pytest.fixture(scope="session")
def bare_run(tmp_path_factory, make_mesh):
    """Deflect a case and write its files; return the folder."""

    def run(case, solve=deflect):
        mesh, _ = make_mesh(case)
        results = tuple(solve(mesh, case, one, silent) for one in case.deflections)
        folder = tmp_path_factory.mktemp(case.name)
        write_deformation(folder, case, mesh, combined(mesh, results), results, None)
        return folder

    return run


def in_two_steps(mesh, case, deflection, report):
    """Deflect in two steps, which a run does only where one inverts cells."""
    turn, move = turn_of(case, mesh, deflection), mover(case, mesh, deflection.surface)
    start = mesh.points[turn.motion.nodes]
    targets = [start + move(0.5 * turn.angle).displacements, start + turn.motion.displacements]
    points, steps = follow(mesh, case, turn.region, turn.motion.nodes, targets, report)
    return Deflected(turn, points, steps, 0)


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
