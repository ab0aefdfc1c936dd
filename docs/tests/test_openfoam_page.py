"""The page on OpenFOAM: its commands run as they are printed."""

import re
import shlex

import numpy as np

from sdm_deflect.meshing.formats.registry import read
from tests.cases import foam
from tests.cases.test_apply import DECOMPOSE, points_in
from tests.docs.commands import ROOT

PARTS = 4


def test_a_decomposed_case_is_deflected_as_the_page_says(sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sdm("example")[0] == 0
    still = ("--surface", "flap", "--fixed", "wing", "--hinge", "0.7,0.6,0", "0.7,1.4,0", "--angle", "0", "--no-report")
    assert sdm("deflect", "naca.su2", *still, "--out", "case")[0] == 0
    (tmp_path / "case" / "system" / "decomposeParDict").write_text(DECOMPOSE % PARTS)
    foam.run("decomposePar", tmp_path / "case")
    page = (ROOT / "docs" / "openfoam.md").read_text(encoding="utf-8").split("## Decomposed cases")[1]
    block = re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)[0].replace("\\\n", " ")
    commands = [shlex.split(line) for line in block.splitlines()]
    assert [words[0] for words in commands] == ["reconstructParMesh", "sdm", "sdm", "mpirun"]
    foam.run("reconstructParMesh", tmp_path / "case", "-constant")
    for words in commands[1:3]:
        parts = [str(part) for part in sorted((tmp_path / "case").glob("processor*"))]
        given = [one for word in words[1:] for one in (parts if word == "case/processor*" else [word])]
        code, said, error = sdm(*given)
        assert code == 0, said + error
    moved = read(tmp_path / "case-deflected").points
    found = np.vstack([points_in(part) for part in sorted((tmp_path / "case15").glob("processor*"))])
    assert set(map(bytes, found)) == set(map(bytes, moved)), "each part has the bits of the whole"
    assert "Mesh OK" in foam.run("checkMesh", tmp_path / "case15", ranks=PARTS)
