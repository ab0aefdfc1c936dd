"""What SECURITY.md says: nothing in a file is executed."""

import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.api import deflect, read
from sdm_deflect.meshing.formats.openfoam import OpenFoam

ROOT = Path(__file__).parents[1]
# Modules that hand values to processes of the same command, or to the user's workers.
OWN_PICKLES = {"cases/run/cluster.py", "cases/aircraft/reference.py"}


class Touch:
    """What a pickle would execute."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def sources():
    for name in ("cases", "deform", "geometry", "meshing", "sdm_deflect"):
        for path in sorted((ROOT / name).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def test_pickles_are_loaded_where_the_page_says():
    found = {name for name, text in sources() if re.search(r"^(import pickle|from pickle import)", text, re.MULTILINE)}
    assert found == OWN_PICKLES


def test_text_is_never_executed():
    call = re.compile(r"(?<![.\w])(eval|exec)\(|os\.system|shell=True|yaml\.load|allow_pickle=True")
    assert [name for name, text in sources() if call.search(text)] == []


def test_archives_are_loaded_without_pickles():
    loads = [(name, line) for name, text in sources() for line in text.splitlines() if "np.load(" in line]
    assert len(loads) >= 3
    assert [one for one in loads if "allow_pickle=False" not in one[1]] == []


@pytest.mark.parametrize(
    "entry", ['#calc "1"', '#codeStream { code #{ system("touch pwned"); #}; }', '#include "other"']
)
def test_directives_of_openfoam_are_not_carried_out(entry, hybrid_wing, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    OpenFoam().write(hybrid_wing.mesh, tmp_path / "case")
    file = tmp_path / "case" / "constant" / "polyMesh" / "boundary"
    file.write_text(re.sub(r"nFaces\s+\d+;", f"nFaces {entry};", file.read_text(), count=1))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError):
        read(tmp_path / "case")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_table_with_a_pickle_is_refused(hybrid_wing, tmp_path):
    """Values of `.npz` that are Python objects stay what they are: bytes."""
    arrays = {"points": np.zeros((4, 3)), "vectors": np.zeros((4, 3))}
    np.savez(tmp_path / "table.npz", **arrays)
    header = (
        b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '|O', 'fortran_order': False, 'shape': (4, 3), }".ljust(117) + b"\n"
    )
    with zipfile.ZipFile(tmp_path / "table.npz", "w") as archive:
        archive.writestr("points.npy", header + pickle.dumps(Touch(tmp_path / "pwned")))
        archive.writestr("vectors.npy", header + pickle.dumps(Touch(tmp_path / "pwned")))
    with pytest.raises(InputError, match=r"table\.npz"):
        deflect(hybrid_wing.mesh, list(hybrid_wing.mesh.names[:1]), table=tmp_path / "table.npz")
    assert not (tmp_path / "pwned").exists()
