"""`sdm export --to-solver`: the mesh of a finished run as a case, with every control surface as a monitor."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from sdm_deflect.cases.aircraft.flow_case import export_flow
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.cli import cli
from sdm_deflect.cases.flow.flow_case import FlowCase
from sdm_deflect.cases.settings.conversion import to_toml
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.geometry.datum import SURFACES, hinge_line
from sdm_deflect.meshing.formats.openfoam_files import MESH, open_foam, parse
from sdm_deflect.meshing.formats.vtu_write import write_vtu
from tests.cases.flow.test_su2 import faults, options, words
from tests.frozen.test_frozen import frozen_tets


@pytest.fixture
def finished_run(tmp_path):
    """The files of a run that an export reads, of the aircraft's frozen mesh."""
    folder, mesh = tmp_path / "aileron", frozen_tets("aircraft")
    folder.mkdir()
    (folder / "case.toml").write_text(to_toml(case_named("aileron")))
    for which in ("undeflected", "deflected"):
        write_vtu(folder / f"{which}.vtu", mesh)
    return folder, mesh


def test_a_case_of_openfoam(finished_run):
    folder, mesh = finished_run
    result = CliRunner().invoke(cli, ["export", str(folder), "--to-solver", "openfoam", "--alpha", "4", "-q"])
    assert result.exit_code == 0, result.output
    case = folder.with_name("aileron-deflected")
    assert result.output.strip() == str(case)
    types = {patch.name: patch.type for patch in parse(open_foam(case / MESH, "boundary").text())}
    assert {*types} == {*mesh.names}
    assert [name for name, kind in types.items() if kind == "patch"] == ["far_field"]
    control = (case / "system" / "controlDict").read_text()
    assert all(f"    {name}  // hinge moment" in control for name in SURFACES)


def test_a_configuration_of_su2_with_an_origin_for_each_surface(finished_run):
    folder, mesh = finished_run
    files, lost = export_flow(folder, FlowCase("su2"), "undeflected")
    assert [path.name for path in files] == ["aileron-undeflected.su2", "aileron-undeflected.cfg"]
    assert lost == ()
    text = files[1].read_text()
    assert faults(text, mesh.names) == []
    found = options(text)
    walls = words(found["MARKER_MONITORING"])
    origins = np.array([[float(word) for word in words(found[f"REF_ORIGIN_MOMENT_{axis}"])] for axis in "XYZ"]).T
    for name in SURFACES:
        assert np.array_equal(origins[walls.index(name)], hinge_line(case_named("aileron").fighter, name)[0])
    before = {path: path.read_bytes() for path in files}
    with pytest.raises(InputError, match="exists already"):
        export_flow(folder, FlowCase("su2"), "undeflected")
    assert before == {path: path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "give either --format or --to-solver"),
        (["--format", "su2", "--to-solver", "su2"], "give either --format or --to-solver"),
        (["--format", "su2", "--mach", "0.5"], "mach has no use without a solver"),
        (["--to-solver", "su2", "--out", "x.cgns"], "writes a file .su2"),
    ],
)
def test_options_that_do_not_fit(given, said, finished_run):
    result = CliRunner().invoke(cli, ["export", str(finished_run[0]), *given])
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)


def test_what_is_no_flow_is_refused(finished_run, tmp_path):
    folder, _ = finished_run
    (folder / "case.toml").write_text(to_toml(case_named("aileron-chimera")))
    with pytest.raises(InputError, match="a Chimera block is no flow without its background"):
        export_flow(folder, FlowCase("openfoam"))
    shutil.rmtree(folder)
    folder.mkdir()
    with pytest.raises(InputError, match=r"it has no case\.toml"):
        export_flow(folder, replace(FlowCase("openfoam"), iterations=3))
    assert [path.name for path in tmp_path.iterdir()] == ["aileron"]
