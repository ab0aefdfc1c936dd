"""`--to-solver`: cases from Gmsh's mesh of a wing with a flap, which OpenFOAM runs as they are."""

import json
from contextlib import closing
from functools import partial

import naca_wing
import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.cases.flow.setup import FreeStream, Hinge, Setup
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.meshing.formats.openfoam_files import MESH, open_foam, parse
from sdm_deflect.meshing.formats.registry import FORMATS, format_of
from studies.flow.forces import Forces, coefficients, hinge_moment
from studies.flow.solver import lines
from tests.cases import foam
from tests.cases.flow.test_su2 import faults, options
from tests.deform.blocks import block_with_body, joined

HINGE = np.array([[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]])
JOB = ["--surface", "flap", "--fixed", "wing", "--slide", "symmetry:plane", "--motion", "blended", "--no-report", "-q"]
TURN = [*JOB, "--hinge", "0.7,0.6,0", "0.7,1.4,0"]
LATE = 50
"""Iterations at the end over which forces hardly change any more."""


@pytest.fixture(scope="module")
def naca(tmp_path_factory):
    """Gmsh's wing, coarse, with a far field that is near."""
    folder = tmp_path_factory.mktemp("naca")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(naca_wing, "FAR", 4.5)
        naca_wing.build(folder, 0.5)
    return folder / "naca.msh"


@pytest.fixture
def sdm(sdm):
    return partial(sdm, "deflect")


def run(case, iterations):
    """Run a case, as it is, for so many iterations."""
    foam.run("checkMesh", case)  # skips the test where there is no OpenFOAM
    with closing(lines("rhoCentralFoam", case)) as said:
        for line in said:
            if line.startswith(f"Time = {iterations + 1}"):
                return


def computed(case, iterations):
    """Hinge moment and lift coefficient, every 5 iterations, of the wing's case."""
    run(case, iterations)
    hinge = Hinge.through("flap", ["flap"], HINGE)
    whole, flap = Forces.read(case, "all"), Forces.read(case, hinge.name)
    rows = iterations // 5
    assert whole.iteration[:rows].tolist() == flap.iteration[:rows].tolist() == list(range(5, iterations + 1, 5))
    return hinge_moment(flap, hinge)[:rows], coefficients(whole, Setup(FreeStream(), area=2.0))["CL"][:rows]


def test_a_case_from_a_mesh_of_gmsh_starts_and_settles_as_it_is(naca, sdm, tmp_path):
    out, words = tmp_path / "case", ["--to-solver", "openfoam", "--angle", "-10", "--json"]
    code, said, _ = sdm(naca, *TURN, *words, "--out", out)
    assert (code, json.loads(said)["files"]) == (0, [str(out)])
    types = {patch.name: patch.type for patch in parse(open_foam(out / MESH, "boundary").text())}
    assert types == {"wing": "wall", "flap": "wall", "far_field": "patch", "symmetry": "symmetryPlane"}
    moment, lift = computed(out, 350)
    for values in (moment, lift):
        late = values[-LATE // 5 :]
        assert np.isfinite(values).all()
        assert np.ptp(late) < 0.05 * np.abs(late).mean() < 0.5 * np.ptp(values)
    assert moment[-1] > 0.0  # the air pushes the flap back
    assert lift[-1] < 0.0  # about y, from the root to the tip, a positive angle is trailing edge down


def test_the_hinge_moment_opposes_a_flap_that_goes_down_as_well(naca, sdm, tmp_path):
    assert sdm(naca, *TURN, "--to-solver", "openfoam", "--angle", "10", "--out", tmp_path / "case")[0] == 0
    moment, lift = computed(tmp_path / "case", 100)
    assert moment[-1] < 0.0 < lift[-1]


def test_each_angle_has_a_configuration_of_su2_beside_its_mesh(naca, sdm, tmp_path):
    words = ["--angles", "-5,5", "--to-solver", "su2", "--mach", "0.4", "--alpha", "3", "--out", tmp_path / "flap.su2"]
    names = [f"flap_{angle}.{end}" for angle in ("-5", "+5") for end in ("cfg", "su2")]
    dry = json.loads(sdm(naca, *TURN, *words, "--dry-run", "--json")[1])
    assert dry["case"] | {"hinges": []} == {
        "solver": "su2", "mach": 0.4, "alpha": 3.0, "walls": ["wing", "flap"], "far_field": ["far_field"],
        "symmetry": ["symmetry"], "hinges": [],
    }  # fmt: skip
    (hinge,) = dry["case"]["hinges"]
    assert (hinge["name"], hinge["patches"], hinge["axis"]) == ("flap", ["flap"], [0.0, 1.0, 0.0])
    assert {*dry["files"]} == {str(tmp_path / name) for name in names}
    assert not list(tmp_path.iterdir())
    code, said, _ = sdm(naca, *TURN, *words, "--json")
    assert code == 0
    assert {*json.loads(said)["files"]} == {*dry["files"]}
    assert {path.name for path in tmp_path.iterdir()} == {*names}
    for angle in ("-5", "+5"):
        text, mesh = (tmp_path / f"flap_{angle}.cfg").read_text(), FORMATS["su2"].read(tmp_path / f"flap_{angle}.su2")
        assert faults(text, mesh.names) == []
        found = options(text)
        assert found["MESH_FILENAME"] == f"flap_{angle}.su2"
        assert [float(found[name]) for name in ("MACH_NUMBER", "AOA")] == [0.4, 3.0]
        marked = " ".join(found[name] for name in ("MARKER_EULER", "MARKER_FAR", "MARKER_SYM"))
        assert sorted(marked.replace("(", "").replace(")", "").replace(",", "").split()) == sorted(mesh.names)
    code, _, said = sdm(naca, *TURN, *words)
    assert code == 2
    assert "exists already" in said


def test_the_table_says_what_each_patch_is(naca, sdm):
    words = ["--angle", "5", "--to-solver", "openfoam", "--dry-run"]
    told = "far field: far_field; symmetry: symmetry; hinge moment of: flap"
    assert told in " ".join(sdm(naca, *TURN, *words)[1].split())


def test_of_su2_s_own_file_only_coordinates_change_unless_parts_become_markers(naca, sdm, tmp_path):
    source, old = naca.with_suffix(".su2"), FORMATS["su2"].read(naca.with_suffix(".su2"))
    turn = ["--angle", "5", "--to-solver", "su2"]
    assert sdm(source, *TURN, *turn, "--out", tmp_path / "copy.su2")[0] == 0
    one, other = ((source).read_bytes().split(b"NMARK="), (tmp_path / "copy.su2").read_bytes().split(b"NMARK="))
    assert one[1] == other[1]
    part = ["--select", "tail=wing box:0.69,0.1,-1,2,0.55,1", "--surface", "tail", "--fixed", "wing,flap"]
    words = [*part, *JOB[4:], "--hinge", "0.7,0,0", "0.7,0.55,0", *turn, "--out", tmp_path / "parts.su2"]
    assert sdm(source, *words)[0] == 0
    assert {*FORMATS["su2"].read(tmp_path / "parts.su2").names} == {*old.names, "tail"}
    assert "CMy(tail)" in (tmp_path / "parts.cfg").read_text()


def test_the_default_name_is_beside_the_source(naca, sdm):
    for solver, name in (("openfoam", "naca-deflected"), ("su2", "naca-deflected.su2")):
        dry = json.loads(sdm(naca, *TURN, "--angle", "5", "--to-solver", solver, "--dry-run", "--json")[1])
        assert dry["files"][0] == str(naca.with_name(name))


def test_a_table_has_no_hinge_moment(naca, sdm, tmp_path):
    (tmp_path / "table.csv").write_text("x,y,z,dx,dy,dz\n0,0,0,0,0,0\n1,0,0,0,0,0\n0,1,0,0,0,0\n0,0,1,0,0,.001\n")
    words = ["--surface", "flap,wing", "--slide", "symmetry:plane", "--table", tmp_path / "table.csv", "--no-report"]
    code, _, said = sdm(naca, *words, "--to-solver", "su2", "--out", tmp_path / "bent.su2", "-q")
    assert code == 0, said
    assert "Hinge moment" not in (tmp_path / "bent.cfg").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--mach", "0.5"], "mach has no use without a solver"),
        (["--far-field", "far_field"], "far_field has no use without a solver"),
        (["--to-solver", "su2", "--out", "x.cgns"], "x.cgns: --to-solver su2 writes a file .su2"),
        (["--to-solver", "openfoam", "--out", "x.su2"], "x.su2: --to-solver openfoam writes a folder"),
        (["--to-solver", "su2", "--out", "my wing.su2"], "SU2 reads no name of a file with blanks"),
        (["--to-solver", "openfoam", "--far-field", "nosuch"], "far field 'nosuch' is no patch"),
        (["--to-solver", "openfoam", "--far-field", "wing, flap"], "no patch is a wall"),
        (["--to-solver", "openfoam", "--mach", "0"], "mach = 0 must be between 0.01 and 5"),
    ],
)
def test_what_cannot_be_is_one_sentence(words, said, naca, sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, complaint = sdm(naca, *TURN, "--angle", "5", *words)
    assert (code, complaint.count("\n")) == (2, 1)
    assert said in complaint
    assert not list(tmp_path.iterdir())


def test_a_case_as_source_and_a_plane_mesh_and_zones_are_refused(naca, sdm, tmp_path, plane_foil):
    FORMATS["openfoam"].write(FORMATS["gmsh"].read(naca), tmp_path / "case")
    code, _, said = sdm(tmp_path / "case", *TURN, "--angle", "5", "--to-solver", "openfoam")
    assert code == 2
    assert "is an OpenFOAM case already" in said
    assert sdm(tmp_path / "case", *TURN, "--angle", "5", "--to-solver", "su2")[0] == 0
    assert (tmp_path / "case-deflected.cfg").is_file()
    turned = sdm_deflect.deflect(plane_foil, "flap", [0.75, 0.0], 5.0, motion="blended", fixed="wing")
    with pytest.raises(InputError, match="OpenFOAM holds no two-dimensional meshes"):
        turned.save(tmp_path / "plane", to_solver="openfoam", far_field="far_field")
    one = block_with_body(8)
    two = joined(one, one.with_points(one.points + 10.0))
    turned = sdm_deflect.deflect(two, "body", [[0, 0, 0], [0, 1, 0]], 5.0)
    with pytest.raises(InputError, match="takes a mesh of one zone, and this one has several: near, far"):
        turned.save(tmp_path / "two.su2", to_solver="su2")
    assert {path.name for path in tmp_path.iterdir()} == {"case", "case-deflected.su2", "case-deflected.cfg"}


def test_from_python_and_from_arrays(tmp_path):
    """A mesh of no file: a cube, whose far field nothing but its place tells."""
    mesh = block_with_body(8)
    result = sdm_deflect.deflect(mesh, "body", [[0, 0, 0], [0, 1, 0]], 5.0)
    assert result.save(tmp_path / "cube", to_solver="openfoam", mach=0.3, alpha=1.0, far_field=["x*", "y*"]) == ()
    types = {patch.name: patch.type for patch in parse(open_foam(tmp_path / "cube" / MESH, "boundary").text())}
    assert types["body"] == "wall"
    assert types["x-"] == types["y+"] == "patch"
    assert types["z-"] == "symmetryPlane"
    run(tmp_path / "cube", 5)
    assert len(Forces.read(tmp_path / "cube", "body").iteration)
    with pytest.raises(InputError, match="exists already"):
        result.save(tmp_path / "cube", to_solver="openfoam")
    result.save(tmp_path / "cube.su2", to_solver="su2")
    assert faults((tmp_path / "cube.cfg").read_text(), mesh.names) == []
    assert np.array_equal(format_of(tmp_path / "cube.su2").read(tmp_path / "cube.su2").points, result.points)


def test_names_that_openfoam_cannot_read_are_others_everywhere(tmp_path):
    mesh = block_with_body(8)
    patches = [sdm_deflect.Patch({"body": "2 flaps", "x-": "1"}.get(p.name, p.name), p.faces) for p in mesh.patches]
    odd = sdm_deflect.Mesh(mesh.points, mesh.cells, tuple(patches))
    lost = sdm_deflect.deflect(odd, "2 flaps", [[0, 0, 0], [0, 1, 0]], 5.0).save(tmp_path / "odd", "openfoam")
    assert lost == ("patch 2 flaps is called _2_flaps", "patch 1 is called _1")
    run(tmp_path / "odd", 5)
    assert len(Forces.read(tmp_path / "odd", "_2_flaps").iteration)
