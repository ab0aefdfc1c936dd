"""Cases that OpenFOAM's decomposePar cut up: deflecting the parts is deflecting the whole and cutting it up then."""

import re
import shutil

import numpy as np
import pytest
from scipy.spatial import KDTree

from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from tests.cases import foam

TURN = ["--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--quiet"]
TURN += ["--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "8", "--no-report"]
DECOMPOSE = """FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }
numberOfSubdomains 4; method %s; manualCoeffs { dataFile "parts"; }
"""
BLOCK = """FoamFile { version 2.0; format ascii; class dictionary; object blockMeshDict; }
vertices ((0 0 0) (4 0 0) (4 1 0) (0 1 0) (0 0 1) (4 0 1) (4 1 1) (0 1 1));
blocks (hex (0 1 2 3 4 5 6 7) (6 5 4) simpleGrading (1 1 1));
boundary
(
    floor { type wall; faces ((0 3 2 1)); }
    left { type cyclic; neighbourPatch right; faces ((0 4 7 3)); }
    hole { type patch; faces (); }
    right { type cyclic; neighbourPatch left; faces ((1 2 6 5)); }
    rest { type patch; faces ((0 1 5 4) (3 7 6 2) (4 5 6 7)); }
);
"""
METHODS = {"binary": "manual", "ascii": "random", "collated": "random"}
"""How decomposePar cuts, whatever the points: by cells in order, or at random. Debian's OpenFOAM has no scotch."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory, hybrid_wing):
    case = tmp_path_factory.mktemp("foam") / "whole"
    OpenFoam().write(hybrid_wing.mesh, case)
    return case


def decompose(case, kind):
    """Cut a case into four parts with decomposePar."""
    form = "writeFormat ascii; writePrecision 17;" if kind == "ascii" else "writeFormat binary;"
    control = case / "system" / "controlDict"
    control.write_text(re.sub(r"writeFormat +\w+;", form, control.read_text()))
    (case / "system" / "decomposeParDict").write_text(DECOMPOSE % METHODS[kind])
    count = len(OpenFoam().read(case).cells[0])
    numbers = "\n".join(str(4 * cell // count) for cell in range(count))
    head = "FoamFile { version 2.0; format ascii; class labelList; object parts; }\n"
    (case / "constant" / "parts").write_text(f"{head}{count}\n(\n{numbers}\n)\n")
    foam.run("decomposePar", case, *(["-fileHandler", "collated"] if kind == "collated" else []))


def parts_in(case):
    """The files of all parts; a collated one names its case, which is left out."""
    return {str(p.relative_to(case)): re.sub(rb'location +"[^"]*"', b"", p.read_bytes())
            for p in sorted(case.glob("processor*/**/*")) if p.is_file()}  # fmt: skip


def values_in(case):
    """Points of the whole as the parts have them."""
    part = "processors4" if (case / "processors4").is_dir() else "processor0"
    return OpenFoam().read(case / part).points


@pytest.mark.parametrize("kind", sorted(METHODS))
def test_the_parts_of_the_deflected_whole_are_the_deflected_parts(kind, whole, sdm, tmp_path):
    case, deflected = tmp_path / "case", tmp_path / "whole"
    shutil.copytree(whole, case)
    decompose(case, kind)
    shutil.rmtree(case / MESH)
    assert sdm("deflect", whole, *TURN, "--out", deflected)[0] == 0
    decompose(deflected, kind)
    code, table, complaint = sdm("deflect", case, *TURN, "--out", tmp_path / "parts")
    assert code == 0, table + complaint
    found, expected = parts_in(tmp_path / "parts"), parts_in(deflected)
    assert found.keys() == expected.keys()
    differing = [name for name in found if found[name] != expected[name]]
    assert all(name.endswith("/points") for name in differing)
    if kind != "ascii":  # whose numbers decomposePar writes with 17 digits, we with as many as are needed
        assert not differing
    np.testing.assert_array_equal(values_in(tmp_path / "parts"), OpenFoam().read(deflected).points)
    np.testing.assert_array_equal(values_in(deflected), OpenFoam().read(deflected).points)
    handler = ["-fileHandler", "collated"] if kind == "collated" else []
    before, after = (foam.run("checkMesh", one, *handler, ranks=4) for one in (case, tmp_path / "parts"))
    assert foam.complaints(after) == foam.complaints(before)
    assert "Mesh OK." in after
    if kind != "collated":
        foam.run("reconstructParMesh", tmp_path / "parts", "-constant")
        again = OpenFoam().read(tmp_path / "parts").points  # in an order of its own, texts off by their last digit
        distance, nearest = KDTree(OpenFoam().read(deflected).points).query(again)
        assert sorted(nearest) == list(range(len(again)))
        assert distance.max() <= (1e-15 if kind == "ascii" else 0.0)


def test_cyclic_patches_that_are_cut_and_patches_without_faces_are_those_of_the_whole(tmp_path, whole):
    case = tmp_path / "case"
    shutil.copytree(whole / "system", case / "system")
    (case / "system" / "blockMeshDict").write_text(BLOCK)
    (case / "constant").mkdir()
    foam.run("blockMesh", case)
    decompose(case, "ascii")
    assert "processorCyclic" in (case / "processor0" / MESH / "boundary").read_text("latin-1")
    expected, found = OpenFoam().read(case), OpenFoam().read(case / "processor0")
    np.testing.assert_array_equal(found.points, expected.points)
    for name in expected.names:
        np.testing.assert_array_equal(found.patch(name).faces[0].nodes, expected.patch(name).faces[0].nodes)
    assert found.names == expected.names
    np.testing.assert_array_equal(found.periodic[0].nodes, expected.periodic[0].nodes)
    assert len(found.periodic[0].nodes) == 6 * 5
    for list_ in case.glob(f"processor*/{MESH}/*ProcAddressing"):
        list_.unlink()
    joined = OpenFoam().read(case / "processor0")
    assert {p.name: len(p) for p in joined.patches} == {p.name: len(p) for p in expected.patches}
    one, other = joined.points[joined.periodic[0].nodes.T]
    assert len(one) == 6 * 5
    np.testing.assert_allclose(other - one, [[4.0, 0.0, 0.0]] * len(one), atol=1e-12)


def test_a_part_that_is_missing_is_one_line_and_code_two(whole, sdm, tmp_path):
    case = tmp_path / "case"
    shutil.copytree(whole, case)
    decompose(case, "binary")
    shutil.rmtree(case / "processor1")
    for name in ("quality", "deflect"):
        words = TURN if name == "deflect" else []
        code, out, complaint = sdm(name, case / "processor0", *words)
        assert (code, out, complaint.count("\n")) == (2, "", 1)
        assert complaint == (
            f"sdm: {case}: there is processor0, processor2, processor3, but no mesh in processor1; a part is missing\n"
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case"]


def test_the_parts_beside_a_whole_are_told_of_and_written_beside_the_case(whole, sdm, tmp_path):
    case = tmp_path / "case"
    shutil.copytree(whole, case)
    decompose(case, "binary")
    assert f"name {case / 'processor0'} in place of the case" in sdm("quality", case)[1].replace("\n", "")
    code, table, complaint = sdm("deflect", case / "processor0", *TURN)
    assert code == 0, table + complaint
    assert "wrote" in table
    out = tmp_path / "case-deflected"
    np.testing.assert_array_equal(values_in(out), OpenFoam().read(out).points)
    assert np.any(values_in(out) != values_in(case))
