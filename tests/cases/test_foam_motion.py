"""The motion solver of `solvers/openfoam`, compiled, moves meshes in OpenFOAM as the plan does."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from sdm_deflect import plan, read
from sdm_deflect.meshing.formats.openfoam import OpenFoam, write_files
from sdm_deflect.meshing.formats.openfoam_files import labels, open_foam, vectors
from tests import calls
from tests.cases import foam
from tests.deform.blocks import two_bodies
from tests.deform.test_mesh_motion import AROUND_BOTH, SLAT_AND_FLAP
from tests.deform.test_motion_fields import TRACK
from tests.docs.commands import ROOT

# Angles of a flap at times, by a table.
TIMES = {"0.1": 4.0, "0.5": 20.0, "0.8": -1.0, "1": -15.0}
AMOUNTS = 'dynamicFvMesh dynamicMotionSolverFvMesh;\nmotionSolverLibs ("libsdmMotion.so");\nsolver sdmMotion;\n'
CONTROL = (
    "application %s; startFrom startTime; startTime 0; stopAt endTime; endTime %g; deltaT %g; writeControl timeStep;\n"
    "writeInterval %d; writeFormat binary; timePrecision 8; runTimeModifiable false;\n"
)
DECOMPOSE = "numberOfSubdomains 2; method hierarchical;\nhierarchicalCoeffs { n (2 1 1); delta 0.001; order xyz; }\n"
ROUNDING = 1e-14
pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The folder of the library, built as its script says."""
    foam.needed("g++", "moveDynamicMesh")
    folder = tmp_path_factory.mktemp("library")
    subprocess.run([ROOT / "solvers" / "openfoam" / "build", folder], check=True, capture_output=True)
    return folder


@pytest.fixture(autouse=True)
def found(library, monkeypatch):
    """Let OpenFOAM find the library."""
    monkeypatch.setenv("LD_LIBRARY_PATH", f"{library}:{os.environ.get('LD_LIBRARY_PATH', '')}")


@pytest.fixture(scope="module")
def half_wing(tmp_path_factory):
    """The example's half wing as a case, and a plan of its flap."""
    folder = tmp_path_factory.mktemp("half-wing")
    assert calls.sdm("example", folder) == 0
    OpenFoam().write(read(folder / "naca.su2"), folder / "case")
    given = {"motion": "blended", "fixed": "wing", "slide": "symmetry:plane", "range": (-15, 20)}
    held = plan(folder / "case", "flap", [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], **given)
    held.save(folder / "flap.npz")
    files = [path.read_bytes() for path in held.save_openfoam(folder / "case")]
    assert calls.sdm("export", folder / "flap.npz", "--format", "openfoam", "--out", folder / "case") == 0
    assert [path.read_bytes() for path in held.save_openfoam(folder / "case")] == files[:-1]  # but for dynamicMeshDict
    return held, folder / "case"


def prepared(case, folder, amounts, **control):
    """A copy of a case with amounts by time and a controlDict."""
    shutil.copytree(case, folder)
    (folder / "constant/dynamicMeshDict").unlink()
    values = tuple(control[name] for name in ("application", "end", "step", "interval"))
    files = {
        "constant/dynamicMeshDict": f"{AMOUNTS}sdmMotionCoeffs {{ {amounts} }}\n",
        "system/controlDict": CONTROL % values,
        "system/decomposeParDict": DECOMPOSE,
    }
    write_files(folder, files)
    return folder


def points(folder):
    return vectors(open_foam(folder / "polyMesh", "points")).values


def test_points_are_those_of_the_plan_in_one_process_and_in_two(half_wing, tmp_path):
    modes, case = half_wing
    control = {"application": "moveDynamicMesh", "end": 1, "step": 0.1, "interval": 1}
    moved = prepared(case, tmp_path / "moved", "flap table ((0 0) (0.5 20) (1 -15));", **control)
    foam.run("moveDynamicMesh", moved)
    parts = shutil.copytree(moved, tmp_path / "parts", ignore=shutil.ignore_patterns("0.*", "1"))
    foam.run("decomposePar", parts)
    foam.run("moveDynamicMesh", parts, ranks=2)
    assert "Mesh OK" in foam.run("checkMesh", case, "-constant")
    for time, angle in TIMES.items():
        expected = modes.at((angle,))
        assert np.abs(points(moved / time) - expected).max() <= ROUNDING, time
        assert "Mesh OK" in foam.run("checkMesh", moved, "-time", time), time
        for rank in (0, 1):
            part = parts / f"processor{rank}"
            own = labels(open_foam(part / "constant" / "polyMesh", "pointProcAddressing"))
            assert np.abs(points(part / time) - expected[own]).max() <= ROUNDING, (time, rank)


def test_surfaces_with_other_functions_move_together(tmp_path):
    """One turns; the other is on a track with kinks."""
    (tmp_path / "track.csv").write_text(TRACK)
    right = {"hinge": SLAT_AND_FLAP["right"]["hinge"], "track": str(tmp_path / "track.csv"), "range": (-0.8, 1)}
    held = plan(two_bodies(), {"left": SLAT_AND_FLAP["left"], "right": right}, box=AROUND_BOTH)
    OpenFoam().write(two_bodies(), tmp_path / "case")
    held.save_openfoam(tmp_path / "case")
    control = {"application": "moveDynamicMesh", "end": 1, "step": 0.1, "interval": 1}
    amounts = "left table ((0 0) (0.5 8) (1 -2)); right table ((0 0) (0.5 0.9) (1 -0.8));"
    moved = prepared(tmp_path / "case", tmp_path / "moved", amounts, **control)
    foam.run("moveDynamicMesh", moved)
    for time, pose in {"0.2": (3.2, 0.36), "0.4": (6.4, 0.72), "0.5": (8.0, 0.9), "1": (-2.0, -0.8)}.items():
        assert np.abs(points(moved / time) - held.at(pose)).max() <= ROUNDING, time
    beyond = prepared(
        tmp_path / "case", tmp_path / "beyond", "left table ((0 0) (1 9)); right table ((0 0));", **control
    )
    with pytest.raises(AssertionError, match=r"left = 8\.1 is outside its range"):
        foam.run("moveDynamicMesh", beyond)


# A flow along the plane of symmetry that is the same everywhere.
STREAM = {"p": "100000", "T": "300", "U": "(200 0 20)"}
THERMO = (
    "thermoType { type hePsiThermo; mixture pureMixture; transport const; thermo hConst; equationOfState perfectGas;\n"
    "specie specie; energy sensibleInternalEnergy; }\n"
    "mixture { specie { molWeight 28.96; } thermodynamics { Cp 1004.5; Hf 0; } transport { mu 0; Pr 1; } }\n"
)
SCHEMES = (
    "fluxScheme Kurganov; ddtSchemes { default Euler; } gradSchemes { default Gauss linear; }\n"
    "divSchemes { default none; div(tauMC) Gauss linear; } laplacianSchemes { default Gauss linear corrected; }\n"
    "interpolationSchemes { default linear; reconstruct(rho) vanLeer; reconstruct(U) vanLeerV;\n"
    "reconstruct(T) vanLeer; }\n"
    "snGradSchemes { default corrected; }\n"
)
SOLVERS = 'solvers { "(rho|rhoU|rhoE)" { solver diagonal; } "(U|e)" { solver smoothSolver; smoother GaussSeidel;\n'
SOLVERS += "tolerance 1e-12; relTol 0; } }\n"


def field_of(name, value):
    """A field that is the same everywhere, on walls as well, and a plane of symmetry."""
    dimensions = {"p": "[1 -1 -2 0 0 0 0]", "T": "[0 0 0 1 0 0 0]", "U": "[0 1 -1 0 0 0 0]"}[name]
    kinds = f'symmetry {{ type symmetryPlane; }} ".*" {{ type fixedValue; value uniform {value}; }}'
    return f"dimensions {dimensions};\ninternalField uniform {value};\nboundaryField {{ {kinds} }}\n"


def test_a_uniform_stream_stays_uniform_on_the_moving_mesh(half_wing, tmp_path):
    control = {"application": "rhoCentralDyMFoam", "end": 8e-5, "step": 8e-7, "interval": 50}
    case = prepared(half_wing[1], tmp_path / "stream", "flap table ((0 0) (4e-5 1) (8e-5 -0.5));", **control)
    files = {f"0/{name}": field_of(name, value) for name, value in STREAM.items()}
    files |= {"constant/thermophysicalProperties": THERMO, "constant/turbulenceProperties": "simulationType laminar;\n"}
    write_files(case, files | {"system/fvSchemes": SCHEMES, "system/fvSolution": SOLVERS})
    told = foam.run("rhoCentralDyMFoam", case)
    assert max(map(float, re.findall(r"max Courant Numbers = \S+ (\S+)", told))) < 0.5
    for time, angle in {"4e-05": 1.0, "8e-05": -0.5}.items():
        assert np.abs(points(case / time) - half_wing[0].at((angle,))).max() <= ROUNDING
        for name, value in STREAM.items():
            stream = np.array(value.strip("()").split(), dtype=np.float64)
            assert np.abs(inner(case / time / name, len(stream)) - stream).max() <= 1e-12 * np.linalg.norm(stream)


def inner(path, columns):
    """The values at cells of a field in binary (N, columns)."""
    file = open_foam(path.parent, path.name)
    if file.data.find(b"uniform", file.start) == file.data.find(b"internalField", file.start) + 16:
        return np.array(re.search(rb"uniform \(?([^;)]+)", file.data)[1].split(), dtype=np.float64)[None]
    begin = file.data.index(b"nonuniform", file.start)
    found = re.compile(rb"(\d+)\n\(").search(file.data, begin)
    return np.frombuffer(file.data, "<f8", columns * int(found[1]), found.end()).reshape(-1, columns)
