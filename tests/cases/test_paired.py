"""Cases whose patches bind nodes: cyclic by translation and by rotation, one cell thick as a plane and as a wedge."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.registry import read
from studies.flow.openfoam import write_settings
from studies.flow.setup import Setup
from tests.cases import foam
from tests.deform import paired

SIDES = ("side0", "side1")
TURNS = "transform rotational; rotationAxis (1 0 0); rotationCentre (0 0 0);"
HINGES = {
    "cyclic": ["0.7,0,0", "0.7,0.4,0"],
    "empty": ["0.7,0,0", "0.7,0.1,0"],
    "sector": ["0.5,0,1.1", "0.5,0,1.5"],
    "known": ["0.5,0,1.1", "0.5,0,1.5"],
    "wedge": ["0.6,0.55,0", "0.6,0.55,0.1"],
}


def made(name, folder):
    case = folder / name
    if name == "cyclic":
        return paired.written(paired.airfoil(), case, dict.fromkeys(SIDES, "cyclic"), [SIDES])
    if name == "empty":
        return paired.written(paired.airfoil(1, 0.1), case, dict.fromkeys(SIDES, "empty"))
    if name == "wedge":
        return paired.written(paired.wedge(), case, {"front": "wedge", "back": "wedge"})
    types = {"left": "cyclic", "right": "cyclic", "inlet": "patch", "outlet": "patch"}
    return paired.written(paired.sector(), case, types, [("left", "right")], TURNS if name == "known" else "")


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paired")
    return {name: made(name, folder) for name in HINGES}


@pytest.fixture
def deflect(sdm):
    def call(case, *words, hinge=None):
        name = case.name
        annulus = ["blade", "--fixed", "hub", "--fixed", "casing"]
        still = {"sector": annulus, "known": annulus, "wedge": ["ring"]}.get(name, ["wing"])
        job = ["--surface", "flap", "--fixed", *still, "--motion", "blended", "--no-report", "-qv"]
        return sdm("deflect", case, *job, "--hinge", *(hinge or HINGES[name]), *words)

    return call


def apart(mesh, points):
    """The largest distance of a node from its partner's image, over the largest coordinate."""
    gaps = [pair.image(points[pair.nodes[:, 0]]) - points[pair.nodes[:, 1]] for pair in mesh.periodic]
    return max(float(np.linalg.norm(gap, axis=1).max()) for gap in gaps) / np.abs(points).max()


@pytest.mark.parametrize("name", HINGES)
def test_nodes_stay_images_and_openfoam_takes_the_mesh(name, cases, deflect, tmp_path):
    case, out = cases[name], tmp_path / "out"
    code, said, error = deflect(case, "--angle", 12, "--out", out)
    assert code == 0, error + said
    assert ("plane_" if name in ("empty", "wedge") else "periodic_") in said
    before, after = read(case), read(out)
    moved = np.abs(after.points - before.points).max(axis=1) > 0.0
    assert len(before.periodic) == 1
    assert moved[before.periodic[0].nodes].all(axis=1).sum() > 100
    assert apart(before, after.points) < 1e-15
    assert "Mesh OK" in foam.run("checkMesh", out)
    write_settings(out, Setup(iterations=10))
    assert "Time = 10\n" in foam.run("rhoCentralFoam", out)
    if name == "empty":
        front, back = before.periodic[0].nodes.T
        assert np.array_equal(after.points[:, 1], before.points[:, 1])
        assert np.array_equal(after.points[front][:, [0, 2]], after.points[back][:, [0, 2]])
