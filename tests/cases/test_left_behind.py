"""What else holds the moved surface is moved, is named in fixed, or is named by a failed check or a warning."""

import json
import shutil

import h5py
import numpy as np
import pytest

from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import FACES, SIDES, block_with_body, grid, joined

TURN = ["--hinge", "0,-0.5,0", "0,0.5,0", "--angle", "5", "--no-report", "--json"]


def solid():
    """A cube that fills the hole of `block_with_body`, node by node: patch ``body``."""
    points, cells = grid([-0.5] * 3, [0.5] * 3, [2] * 3)
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return Mesh(points, (Cells("hexahedron", cells),), (Patch("body", (Cells("quad", faces[first[count == 1]]),)),))


@pytest.fixture(params=[".su2", ".cgns"])
def two_zones(request, tmp_path):
    path = tmp_path / f"both{request.param}"
    format_of(path).write(joined(block_with_body(), solid()), path)
    return path


def checks(sdm, path, *words):
    """The exit code, and the check."""
    code, out, err = sdm("deflect", path, *TURN, *words)
    assert code < 2, err
    (one,) = [check for check in json.loads(out)["angles"][0]["validation"]["checks"] if check["name"] == "left_behind"]
    return code, one


def names(path):
    mesh = format_of(path).read(path)
    (body, *_), (skin, *_) = ([p.name for p in mesh.patches if p.name.startswith("body") and ("'" in p.name) == c]
                              for c in (False, True))  # fmt: skip
    return body, skin, mesh.zones[1].name


def test_a_zone_that_holds_the_same_surface_is_named_and_the_advice_helps(two_zones, sdm):
    body, skin, zone = names(two_zones)
    code, check = checks(sdm, two_zones, "--surface", body)
    assert (code, check["value"]) == (1, 24.0)  # the hinge is in the middle of two sides, whose nodes are not on it
    for words in (f"24 of patch {skin}", "--zone", "--surface", "name the patch in fixed"):
        assert words in check["where"]
    assert checks(sdm, two_zones, "--surface", body, "--fixed", skin)[0] == 0
    assert checks(sdm, two_zones, "--surface", body, "--surface", skin, "--zone", zone)[0] == 0


def test_a_node_that_moved_less_than_the_same_place_is_not_left_behind(two_zones, sdm):
    code, check = checks(sdm, two_zones, "--surface", names(two_zones)[0], "--angle", "1e-9")
    assert (code, check["verdict"]) == (0, "not applicable")


def test_one_zone_is_measured_too(sdm, tmp_path):
    format_of(tmp_path / "one.su2").write(block_with_body(), tmp_path / "one.su2")
    assert checks(sdm, tmp_path / "one.su2", "--surface", "body", "--fixed", "?[+-]")[0] == 0
    assert set(SIDES) < set(block_with_body().names)


def warned(sdm, path):
    """The warnings of a dry run."""
    code, out, err = sdm("deflect", path, "--surface", "body", *TURN, "--dry-run")
    assert code == 0, err
    return json.loads(out)["warnings"]


def test_free_form_boxes_are_warned_of(sdm, tmp_path):
    path = tmp_path / "boxes.su2"
    format_of(path).write(block_with_body(), path)
    assert warned(sdm, path) == []
    with path.open("a") as file:
        file.write("FFD_NBOX= 1\nFFD_NLEVEL= 1\nFFD_TAG= WING_BOX\nFFD_SURFACE_POINTS= 0\n")
    (text,) = warned(sdm, path)
    assert "free-form boxes of the file (WING_BOX)" in text


@pytest.mark.parametrize("time", ["0", "0.005", "1e-05"])
def test_meshes_of_other_times_are_warned_of(sdm, tmp_path, time):
    format_of(tmp_path / "case").write(block_with_body(), tmp_path / "case")
    assert warned(sdm, tmp_path / "case") == []
    shutil.copytree(tmp_path / "case/constant/polyMesh", tmp_path / "case" / time / "polyMesh")
    (text,) = warned(sdm, tmp_path / "case")
    assert text.startswith(f"{time}/polyMesh is not deflected, and a solver that starts at that time reads it")


def test_regions_are_warned_of(sdm, tmp_path):
    format_of(tmp_path / "case").write(block_with_body(), tmp_path / "case")
    shutil.copytree(tmp_path / "case/constant/polyMesh", tmp_path / "case/constant/solid/polyMesh")
    (text,) = warned(sdm, tmp_path / "case")
    assert "regions solid are not deflected: name one as constant/solid/polyMesh" in text


def test_other_coordinates_of_a_cgns_file_are_warned_of(sdm, tmp_path):
    path = tmp_path / "bases.cgns"
    format_of(path).write(block_with_body(), path)
    assert warned(sdm, path) == []
    with h5py.File(path, "r+") as file:
        (base,) = [name for name in file if file[name].attrs.get("label", b"").startswith(b"CGNSBase_t")]
        (zone,) = [name for name in file[base] if file[base][name].attrs.get("label", b"").startswith(b"Zone_t")]
        file.copy(f"{base}/{zone}/GridCoordinates", f"{base}/{zone}/GridCoordinates#1")
        file.copy(base, "Surface")
        file["Surface/ data"][...] = [2, 3]
    assert [text.partition(" stay ")[0] for text in warned(sdm, path)] == [
        "the coordinates in base Surface",
        f"the coordinates in GridCoordinates#1 of zone {zone}",
    ]
