"""`sdm validate` of a deflected mesh: what is on the disk is judged again, and every edit is noticed."""

import json
import shutil

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.cli.commands import carry_out as main
from sdm_deflect.cases.finished import read_run
from sdm_deflect.meshing.formats.registry import format_of
from tests.limits import limited
from tests.meshing.formats.wing import wing

TURN = ("--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--angle", "8")
WING = wing()
OWN = {"site_error", "inverted_cells", "mesh_file"}


def code_of(*words):
    """Run a command; return its exit code."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("sys.argv", ["sdm", *map(str, words), "--quiet"])
        with pytest.raises(SystemExit) as end:
            main()
    return end.value.code


def deflected(folder, suffix, *words):
    """Deflect a wing; return the folder of its report."""
    source = folder / f"wing{suffix}"
    format_of(source).write(WING.mesh, source)
    hinge = [",".join(map(str, point)) for point in WING.hinge]
    assert code_of("deflect", source, *TURN, "--hinge", *hinge, *words) == 0
    (report,) = folder.glob("*-report")
    return report


def failing(report):
    """Names of the checks that fail."""
    return {check.name for check in read_run(report).recheck() if not check.passed}


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return deflected(tmp_path_factory.mktemp("validated"), ".su2")


@pytest.fixture
def copy(report, tmp_path):
    """The folder, the mesh before and after beside it, to be spoiled."""
    return shutil.copytree(report.parent, tmp_path / "home") / report.name


def test_what_was_written_passes(report, capsys):
    assert {check.name for check in read_run(report).recheck()} > OWN
    capsys.readouterr()
    assert code_of("validate", report, "--json") == 0
    assert json.loads(capsys.readouterr().out)["passed"] is True


@pytest.mark.parametrize(
    ("suffix", "words"),
    [
        pytest.param(".lb4.ugrid", (), marks=pytest.mark.nightly),
        (".cgns", ("--strategy", "mv")),
        (".su2", ("--steps", "4", "--repair", "off")),
        pytest.param(".msh", ("--repair", "always"), marks=pytest.mark.nightly),
        (".su2", ("--set", "kernel=wendland")),
    ],
)
def test_any_format_step_and_kernel_passes(tmp_path, suffix, words):
    assert failing(deflected(tmp_path, suffix, *words)) == set()


def test_a_mesh_that_was_read_in_pieces_passes(tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        limited(patched, file=0, shown=0)
        report = deflected(tmp_path, ".b8.ugrid")
    assert failing(report) == set()


def moved(name):
    """Return an edit that moves a node of a mesh file by a thousandth."""

    def edit(report):
        path = report.parent / name if (report.parent / name).exists() else report / name
        points = format_of(path).read(path).points.copy()
        points[np.flatnonzero((points != WING.mesh.points).any(axis=1))[0]] += 1e-3
        format_of(path).rewrite(path.rename(path.with_stem("old")), points, path)

    return edit


@pytest.mark.parametrize(("edit", "by"), [
    (moved("wing-deflected.su2"), "mesh_file"),
    (moved("deflected.vtu"), "mesh_file"),
    (lambda report: (report.parent / "wing-deflected.su2").unlink(), "mesh_file"),
])  # fmt: skip
def test_an_edit_is_noticed(copy, edit, by):
    edit(copy)
    assert by in failing(copy)
    assert code_of("validate", copy) == 1


@pytest.mark.parametrize(("name", "text"), [
    ("interpolant.npz", "no archive of arrays"), ("convergence.csv", "no history of a run"),
    ("metrics.json", "no table of figures"), ("settings.toml", "has no case.toml and no settings.toml"),
])  # fmt: skip
def test_a_file_that_is_missing_is_one_sentence(copy, name, text):
    (copy / name).unlink()
    with pytest.raises(InputError, match=text):
        read_run(copy).recheck()


def test_another_mesh_of_as_many_points_is_noticed(copy):
    path = copy.parent / "wing.su2"
    format_of(path).rewrite(path.rename(path.with_stem("old")), 1.01 * WING.mesh.points, path)
    assert "outside_moved" in failing(copy)
