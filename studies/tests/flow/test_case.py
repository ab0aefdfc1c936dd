"""Cases from Gmsh's mesh of a wing with a flap, which OpenFOAM runs as they are."""

from contextlib import closing
from functools import partial

import naca_wing
import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.geometry.datum import SURFACES, hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.openfoam_files import MESH, open_foam, parse
from sdm_deflect.meshing.formats.registry import FORMATS
from studies.flow.case import setup_of, write_flow
from studies.flow.forces import Forces, coefficients, hinge_moment
from studies.flow.setup import FreeStream, Hinge, Setup
from studies.flow.solver import lines
from studies.tests.flow.test_su2 import faults, options, words
from tests.calls import run_study
from tests.cases import foam
from tests.deform.blocks import block_with_body, joined
from tests.frozen.test_frozen import frozen_tets

HINGE = np.array([[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]])
CASE = ["--hinge", "flap", "0.7,0.6,0", "0.7,1.4,0"]
# Iterations at the end over which forces hardly change any more.
LATE = 50


@pytest.fixture(scope="module")
def flapped(tmp_path_factory):
    """Gmsh's wing, coarse, with a far field that is near; by angle of its flap a mesh of CGNS."""
    folder = tmp_path_factory.mktemp("naca")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(naca_wing, "FAR", 4.5)
        naca_wing.build(folder, 0.5)
    turn = partial(sdm_deflect.deflect, folder / "naca.msh", "flap", HINGE, motion="blended", fixed="wing")

    def deflected(angle):
        out = folder / f"{angle:g}.cgns"
        if not out.exists():
            turn(angle=angle, slide="symmetry:plane").save(out)
        return out

    return deflected


@pytest.fixture
def case(capsys):
    """Carry out `python -m studies case`."""
    return lambda *words: (run_study("case", *words), *capsys.readouterr())


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


def types_of(case):
    return {patch.name: patch.type for patch in parse(open_foam(case / MESH, "boundary").text())}


def test_a_case_from_a_mesh_of_gmsh_starts_and_settles_as_it_is(flapped, case, tmp_path):
    out = tmp_path / "case"
    assert case(flapped(-10.0), out, *CASE) == (0, f"{out}\n", "")
    assert types_of(out) == {"wing": "wall", "flap": "wall", "far_field": "patch", "symmetry": "symmetryPlane"}
    moment, lift = computed(out, 350)
    for values in (moment, lift):
        late = values[-LATE // 5 :]
        assert np.isfinite(values).all()
        assert np.ptp(late) < 0.05 * np.abs(late).mean() < 0.5 * np.ptp(values)
    assert moment[-1] > 0.0  # the air pushes the flap back
    assert lift[-1] < 0.0  # about y, from the root to the tip, a positive angle is trailing edge down


def test_the_hinge_moment_opposes_a_flap_that_goes_down_as_well(flapped, case, tmp_path):
    assert case(flapped(10.0), tmp_path / "case", *CASE)[0] == 0
    moment, lift = computed(tmp_path / "case", 100)
    assert moment[-1] < 0.0 < lift[-1]


def test_a_configuration_of_su2_stands_beside_its_mesh(flapped, case, tmp_path):
    out = tmp_path / "flap.su2"
    assert case(flapped(5.0), out, *CASE, "--mach", "0.4", "--alpha", "3")[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == {"flap.su2", "flap.cfg"}
    text, mesh = out.with_suffix(".cfg").read_text(), FORMATS["su2"].read(out)
    assert faults(text, mesh.names) == []
    found = options(text)
    assert found["MESH_FILENAME"] == "flap.su2"
    assert [float(found[name]) for name in ("MACH_NUMBER", "AOA")] == [0.4, 3.0]
    assert "CMy(flap)" in text
    code, _, said = case(flapped(5.0), out, *CASE)
    assert (code, "exists already" in said) == (2, True)


def test_the_aircraft_has_an_origin_of_moments_for_each_surface(tmp_path):
    mesh, fighter = frozen_tets("aircraft"), Fighter()
    assert write_flow(mesh, tmp_path / "sdm.su2", setup_of(fighter, FreeStream(), 100)) == ()
    text = (tmp_path / "sdm.cfg").read_text()
    assert faults(text, mesh.names) == []
    found = options(text)
    walls = words(found["MARKER_MONITORING"])
    origins = np.array([[float(word) for word in words(found[f"REF_ORIGIN_MOMENT_{axis}"])] for axis in "XYZ"]).T
    for name in SURFACES:
        assert np.array_equal(origins[walls.index(name)], hinge_line(fighter, name)[0])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["my wing.su2"], "SU2 reads no name of a file with blanks"),
        (["out", "--far-field", "nosuch"], "far field 'nosuch' is no patch"),
        (["out", "--far-field", "wing", "--far-field", "flap"], "no patch is a wall"),
        (["out", "--mach", "0"], "mach = 0 must be between 0.01 and 5"),
        (["out", "--hinge", "flap", "0,0", "0,x"], "0,x"),
    ],
)
def test_what_cannot_be_is_one_sentence(given, said, flapped, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, complaint = case(flapped(5.0), *given)
    assert (code, complaint.count("\n")) == (2, 1)
    assert said in complaint
    assert not list(tmp_path.iterdir())


def test_a_plane_mesh_and_zones_are_refused(tmp_path, plane_foil):
    with pytest.raises(MeshFileError, match="OpenFOAM holds no two-dimensional meshes"):
        write_flow(sdm_deflect.read(plane_foil), tmp_path / "plane", Setup(far=("far_field",)))
    one = block_with_body(8)
    with pytest.raises(InputError, match="a mesh of one zone, and this one has several: near, far"):
        write_flow(joined(one, one.with_points(one.points + 10.0)), tmp_path / "two.su2", Setup())
    assert not list(tmp_path.iterdir())


def test_a_far_field_that_nothing_but_its_place_tells(tmp_path):
    mesh, hinge = block_with_body(8), Hinge.through("body", ["body"], [[0, 0, 0], [0, 1, 0]])
    setup = Setup(FreeStream(0.3, 1.0), (hinge,), far=("x*", "y*"))
    assert write_flow(mesh, tmp_path / "cube", setup) == ()
    types = types_of(tmp_path / "cube")
    assert [types[name] for name in ("body", "x-", "y+", "z-")] == ["wall", "patch", "patch", "symmetryPlane"]
    run(tmp_path / "cube", 5)
    assert len(Forces.read(tmp_path / "cube", "body").iteration)


def test_names_that_openfoam_cannot_read_are_others_everywhere(tmp_path):
    mesh = block_with_body(8)
    patches = [sdm_deflect.Patch({"body": "2 flaps", "x-": "1"}.get(p.name, p.name), p.faces) for p in mesh.patches]
    odd = sdm_deflect.Mesh(mesh.points, mesh.cells, tuple(patches))
    hinge = Hinge.through("flaps", ["2 flaps"], [[0, 0, 0], [0, 1, 0]])
    lost = write_flow(odd, tmp_path / "odd", Setup(hinges=(hinge,)))
    assert lost == ("patch 2 flaps is called _2_flaps", "patch 1 is called _1")
    run(tmp_path / "odd", 5)
    assert len(Forces.read(tmp_path / "odd", "flaps").iteration)
