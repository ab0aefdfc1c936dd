"""Cases of rhoCentralFoam: conditions by what a patch is, the change to second order, runs that end early or fail."""

import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, LostError, MeshFileError
from studies.flow.fields import iterations_done, read_field, start_from
from studies.flow.forces import Forces
from studies.flow.openfoam import FIRST, SECOND, SOLVER, write_case, write_settings
from studies.flow.setup import GAMMA, GAS, FreeStream, Hinge, Setup
from studies.flow.solver import lines, needed
from studies.flow.solver import run as run_solver
from tests.cases import foam
from tests.deform.blocks import block_with_body

BODY = Hinge.through("body", ["body"], np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
FAR = ("x-", "x+", "z-", "z+")


@pytest.fixture
def cube(tmp_path):
    """A cube in a wind between two planes of symmetry, of 7 iterations, the first 4 of first order."""
    setup = Setup(FreeStream(0.5, 3.0), (BODY,), iterations=7, settling=4, far=FAR)
    assert write_case(block_with_body(8), tmp_path / "cube", setup) == ()
    return tmp_path / "cube", setup


def conditions(case, name):
    """The line of each patch in a field of the start."""
    text = (case / "0" / name).read_text(errors="replace")
    return dict(re.findall(r"^ {4}(\S+) \{ type (\w+);", text, re.MULTILINE))


def test_each_patch_has_the_conditions_of_what_it_is(cube):
    case, setup = cube
    wall = {"U": "slip", "p": "zeroGradient", "T": "zeroGradient"}
    far = {"U": "freestreamVelocity", "p": "freestreamPressure", "T": "inletOutlet"}
    for name in wall:
        others = {"body": wall[name], "y-": "symmetryPlane", "y+": "symmetryPlane"}
        assert conditions(case, name) == dict.fromkeys(FAR, far[name]) | others
    velocity = re.search(r"internalField uniform \((.*)\);", (case / "0" / "U").read_text())[1]
    speed = 0.5 * np.sqrt(GAMMA * GAS * 288.15)
    angle = np.radians(3.0)
    assert [float(word) for word in velocity.split()] == pytest.approx(
        [speed * np.cos(angle), 0, speed * np.sin(angle)]
    )
    assert setup.stream.speed == pytest.approx(speed)


def test_the_case_goes_on_in_second_order_when_it_has_settled(cube):
    case, setup = cube
    foam.run(SOLVER, case)
    text = (case / "system" / "fvSchemes").read_text()
    assert SECOND in text
    assert FIRST not in text
    assert iterations_done(case) == 7
    pressure = read_field(case / "7" / "p", len(block_with_body(8).cells[0]))
    assert 0.0 < np.ptp(pressure) < 10.0 * setup.stream.dynamic_pressure
    whole = Forces.read(case, "all")
    assert whole.iteration.tolist() == [5]
    assert whole.force[0, 0] > 0.0  # drag
    write_settings(case, Setup(setup.stream, setup.hinges, iterations=12, settling=0), fields=False)
    foam.run(SOLVER, case)
    assert Forces.read(case, "all").iteration.tolist() == [5, 10]


def test_a_case_starts_from_where_another_one_ended(cube, tmp_path):
    case, setup = cube
    foam.run(SOLVER, case)
    mesh = block_with_body(8)
    centres = mesh.points[mesh.cells[0].nodes].mean(axis=1)
    write_case(mesh, tmp_path / "other", setup)
    start_from(tmp_path / "other", centres + 1e-6, case, centres)
    for name in ("U", "p", "T"):
        ended, begun = (read_field(path / name, len(centres)) for path in (case / "7", tmp_path / "other" / "0"))
        assert np.array_equal(ended, begun)
        assert conditions(tmp_path / "other", name) == conditions(case, name)
    foam.run(SOLVER, tmp_path / "other")
    with pytest.raises(InputError, match="should have the values of 3 cells"):
        read_field(case / "7" / "p", 3)


def test_a_solver_that_is_not_waited_for_ends(cube):
    case, setup = cube
    foam.run("checkMesh", case)
    write_settings(case, replace(setup, iterations=10**6), fields=False)
    with closing(lines(SOLVER, case)) as said:
        assert any(line.startswith("Time = 1") for line in said)
    assert iterations_done(case) < 10**6


def test_what_a_solver_complains_of_is_told(cube):
    case, _ = cube
    foam.run("checkMesh", case)
    (case / "system" / "fvSchemes").unlink()
    with pytest.raises(LostError, match=r"rhoCentralFoam ended with code \d+ in .*FOAM FATAL.*fvSchemes"):
        run_solver(SOLVER, case)


def test_a_program_that_is_not_there_is_named():
    with pytest.raises(InputError, match="nosuchFoam is not on PATH: install OpenFOAM"):
        needed("nosuchFoam")


def test_a_folder_that_is_there_stays(cube):
    case, setup = cube
    before = {path: path.read_bytes() for path in case.rglob("*") if path.is_file()}
    with pytest.raises(MeshFileError, match="exists already"):
        write_case(block_with_body(8), case, setup)
    assert {path: path.read_bytes() for path in case.rglob("*") if path.is_file()} == before
