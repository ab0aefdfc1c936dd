"""Meshes that are nobody else's to read."""

import stat
from pathlib import Path

import pytest

from sdm_deflect import deflect, read
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.wing import wing

TURN = (
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--repair", "off",
    "--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "5", "--quiet",
)  # fmt: skip


def modes(folder: Path) -> dict[str, str]:
    return {path.name: f"{stat.S_IMODE(path.stat().st_mode):o}" for path in folder.rglob("*")}


def test_what_is_written_of_a_private_mesh_is_private(sdm, tmp_path):
    source, out = tmp_path / "wing.su2", tmp_path / "out"
    FORMATS["su2"].write(wing(cells=3).mesh, source)
    source.chmod(0o600)
    code, _, said = sdm("deflect", source, *TURN, "--report", "--sensitivity", "--out", out / "w.su2")
    assert code == 0, said
    found = modes(out)
    assert {"w.su2", "report.html", "w-sensitivity.npz"} < found.keys()
    assert {found.pop("w-report"), found.pop("figures")} == {"700"}
    assert set(found.values()) == {"600"}


@pytest.mark.parametrize(
    ("form", "mode", "file", "folder"), [("su2", 0o600, "600", "700"), ("openfoam", 0o640, "640", "750")]
)
def test_a_private_mesh_stays_private_in_every_format(form, mode, file, folder, tmp_path):
    source, out = tmp_path / {"su2": "wing.su2", "openfoam": "case"}[form], tmp_path / "out"
    FORMATS[form].write(wing(cells=3).mesh, source)
    (source / "constant" / "polyMesh" / "points" if source.is_dir() else source).chmod(mode)
    hinge = {"fixed": "wing_*", "slide": {"symmetry": "plane"}, "hinge": ((0.7, 0.3, 0), (0.7, 0.7, 0))}
    found = deflect(read(source), "flap_*", angle=3, motion="blended", repair="off", **hinge)
    for name in ("w.vtu", "w.cgns", "w.su2", "copy"):
        found.save(out / name)
    paths = list(out.rglob("*"))
    assert {modes(out)[path.name] for path in paths if path.is_file()} == {file}
    assert {modes(out)[path.name] for path in paths if path.is_dir()} == {folder}
