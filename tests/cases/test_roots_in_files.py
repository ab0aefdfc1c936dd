"""A tail that turns on a body: its panel is cut from the body for the motion, and is part of it in every file."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from tests.deform.blocks import annulus_with_fin

RADIAL = np.array([np.cos(0.8), np.sin(0.8), 0.0])
HINGE = [RADIAL.tolist(), (1.5 * RADIAL).tolist()]
TAIL = {"motion": "root", "on": "round", "panel": 0.3}


def turned(mesh, angle=5.0, **more):
    return sd.deflect(mesh, "body", HINGE, angle, **(TAIL | more))


@pytest.mark.filterwarnings("ignore:.*mapbc tells boundary conditions")
@pytest.mark.parametrize("name", writable())
def test_the_panel_is_part_of_its_patch_in_every_format(name, tmp_path):
    mesh = annulus_with_fin()
    sizes = {patch.name: len(patch) for patch in mesh.patches}
    suffix = "" if name == "openfoam" else FORMATS[name].suffixes[0]
    path = turned(mesh).save(tmp_path / f"five{suffix}")
    found = sd.read(path)
    assert {patch.name: len(patch) for patch in found.patches} == sizes
    again = turned(found, 3.0)
    (node,) = np.flatnonzero(np.all(mesh.points == mesh.points[mesh.on("body")][0], axis=1))
    assert again.passed
    assert found.points[node] == pytest.approx(turned(mesh).points[node])


def test_the_width_of_the_panel_is_a_setting(tmp_path, sdm):
    mesh, path = annulus_with_fin(), tmp_path / "fin.su2"
    FORMATS["su2"].write(mesh, path)
    words = ["--surface", "body", "--hinge", *(",".join(map(str, end)) for end in HINGE), "--motion", "root"]
    words += ["--on", "round", "--angle", "5", "--out", tmp_path / "five.su2"]
    moved = []
    for width in (0.2, 0.3):
        code, _, err = sdm("deflect", path, *words, "--panel", width, "--json")
        assert code == 0, err
        settings = tomllib.loads((tmp_path / "five-report" / "settings.toml").read_text())
        assert settings["surface"][0]["panel"] == width
        moved.append(np.flatnonzero(np.any(sd.read(tmp_path / "five.su2").points != mesh.points, axis=1)))
    on_round = [np.intersect1d(one, mesh.on("round")) for one in moved]
    assert len(on_round[0]) < len(on_round[1])
    for width in ("0", "-1", "nan"):
        code, _, err = sdm("deflect", path, *words, "--panel", width)
        assert (code, "panel" in err) == (2, True)
    code, _, err = sdm("deflect", path, *words, "--panel", "50")
    assert (code, "all of round is near body" in " ".join(err.split())) == (2, True)


def test_panel_is_of_a_root_alone():
    with pytest.raises(sd.InputError, match="panel"):
        sd.deflect(annulus_with_fin(), "body", HINGE, 1.0, panel=0.3)


def test_a_tail_that_fails_is_told_of_a_wider_panel(tmp_path, sdm):
    path = tmp_path / "fin.su2"
    FORMATS["su2"].write(annulus_with_fin(), path)
    words = ["--surface", "body", "--hinge", *(",".join(map(str, end)) for end in HINGE), "--motion", "root"]
    words += ["--on", "round", "--panel", "0.3", "--no-report", "--out", tmp_path / "out.su2"]
    code, out, _ = sdm("deflect", path, *words, "--angle", "5", "--min-quality", "0.99", "--repair", "off")
    assert code == 1
    assert "--panel 0.6" in out
    assert "--panel" not in sdm("deflect", path, *words, "--angle", "5")[1]


def with_ring():
    """The mesh with the outer strip of `round` as a patch of its own, `ring`."""
    mesh = annulus_with_fin()
    skin = mesh.patch("round").faces[0].nodes
    outer = mesh.points[skin].mean(axis=1)[:, 2] > 0.6
    cut = [Patch("round", (Cells("quad", skin[~outer]),)), Patch("ring", (Cells("quad", skin[outer]),))]
    return replace(mesh, patches=(*(one for one in mesh.patches if one.name != "round"), *cut))


def test_patches_beside_the_body_stay():
    """The far boundary shares nodes with the body here, too; a plane one is left to the rules of planes."""
    mesh = with_ring()
    done = turned(mesh)
    assert done.passed
    (one,) = done.plan.boxes
    assert one.boundary.fixed == ("round", "rest", "ring")
    assert np.array_equal(done.points[mesh.on("ring")], mesh.points[mesh.on("ring")])
    assert np.array_equal(done.points, turned(mesh, fixed=["ring", "rest"]).points)


def test_a_plane_patch_beside_the_body_is_no_part_of_it():
    mesh = annulus_with_fin()
    faces = mesh.patch("rest").faces[0].nodes
    end = mesh.points[faces].mean(axis=1)[:, 2] < -0.999
    cut = [Patch("end", (Cells("quad", faces[end]),)), Patch("rest", (Cells("quad", faces[~end]),))]
    mesh = replace(mesh, patches=(*(one for one in mesh.patches if one.name != "rest"), *cut))
    (one,) = turned(mesh).plan.boxes
    assert "end" not in one.boundary.fixed


def test_a_body_whose_skins_lie_above_each_other_is_refused(hybrid_wing):
    """A flap that turns about its span, on the wing: both skins are along the hinge."""
    fixed = ["flap_lower", "flap_base"]
    for panel in (0.2, 1.0, 5.0):
        given = {"motion": "root", "on": ["wing_upper", "wing_lower"], "panel": panel, "fixed": fixed, "force": True}
        with pytest.raises(sd.InputError, match=r"no height over the plane across the hinge: give a smaller panel"):
            sd.deflect(hybrid_wing.mesh, "flap_upper", hybrid_wing.hinge, 3.0, slide={"symmetry": "plane"}, **given)


def test_a_root_without_a_patch_is_one_sentence():
    with pytest.raises(sd.InputError, match=r"motion = root: give one patch of the tail|no patch"):
        sd.deflect(annulus_with_fin(), (), HINGE, 3.0, motion="root", on="round")
