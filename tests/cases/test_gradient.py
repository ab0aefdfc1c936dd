"""`sdm gradient` and `sdm export` of a plan: for adjoints, and for solvers that move the mesh."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

from sdm_deflect import MeshMotion
from sdm_deflect.cases.run import gradient as module
from sdm_deflect.meshing.formats.cgns_hdf5 import HdfNode, create
from sdm_deflect.meshing.formats.cgns_read import base_of
from sdm_deflect.meshing.formats.openfoam import OpenFoam, header
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from sdm_deflect.meshing.formats.registry import FORMATS
from tests import calls
from tests.deform.blocks import two_bodies
from tests.deform.test_mesh_motion import AROUND_BOTH

AT = {"left": 6.0, "right": -3.0}
SETTINGS = f"""
box = {AROUND_BOTH}
[[surface]]
patches = "left"
hinge = [[-1.25, -1, 0], [-1.25, 1, 0]]
range = [-6, 8]
[[surface]]
patches = "right"
hinge = [[1.25, -1, 0], [1.25, 1, 0]]
range = [-5, 5]
"""
RAYS = np.random.default_rng(5).normal(size=(2, 3))


def objective(points):
    """A function of all points, and its exact derivative (N, 3) by them."""
    phases = points @ RAYS.T
    return np.sin(phases[:, 0]).sum() + (phases[:, 1] ** 2).sum(), np.column_stack(
        [np.cos(phases[:, 0]), 2 * phases[:, 1]]
    ) @ RAYS


def to_table(path, points, slopes, order=None, names=("x", "y", "z"), digits=".17g"):
    """A table such as SU2 writes."""
    order = np.arange(len(points)) if order is None else order
    titles = ["PointID", *names, "Adjoint_Density", "Sensitivity_x", "Sensitivity_y", "Sensitivity_z"]
    rows = np.column_stack([points[:, : len(names)], np.zeros(len(points)), slopes])[order]
    lines = [",".join([str(node), *(format(x, digits) for x in row)]) for node, row in zip(order, rows, strict=True)]
    path.write_text("\n".join([",".join(f'"{title}"' for title in titles), *lines, ""]))
    return path


def to_field(path, slopes, binary):
    """A point field such as OpenFOAM writes."""
    path.parent.mkdir(exist_ok=True)
    form, count = ("binary", b"%d\n(" % len(slopes)) if binary else ("ascii", b"%d\n(\n" % len(slopes))
    text = "\n".join("({:.17g} {:.17g} {:.17g})".format(*row) for row in slopes).encode()
    head = header("pointVectorField", path.name, "1", form) + "dimensions [0 0 0 0 0 0 0];\n\n"
    with path.open("wb") as file:
        file.write(head.encode() + b"internalField nonuniform List<vector> \n" + count)
        file.write(
            (slopes.tobytes() if binary else text + b"\n")
            + b")\n;\n\nboundaryField\n{\n    left { type calculated; }\n}\n"
        )
    return path


def to_cgns(path, mesh, slopes):
    """A mesh with a solution at its vertices."""
    FORMATS["cgns"].write(mesh, path)
    with h5py.File(path, "r+") as file:
        (zone,) = base_of(HdfNode(file)).zones.values()
        solution = create(zone.group, "Adjoint", "FlowSolution_t")
        for axis, values in zip("XYZ", slopes.T, strict=True):
            create(solution, f"Sensitivity{axis}", "DataArray_t", values)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two bodies as a case and in SU2."""
    folder = tmp_path_factory.mktemp("gradient")
    FORMATS["su2"].write(two_bodies(), folder / "bodies.su2")
    OpenFoam().write(two_bodies(), folder / "bodies")
    (folder / "job.toml").write_text(SETTINGS)
    return folder


@pytest.fixture(scope="module")
def exact(folder):
    """The mesh at amounts, the objective's derivatives by its coordinates, and those by amounts."""
    words = ["--config", folder / "job.toml", "--plan", folder / "p.npz", "--no-mesh"]
    assert calls.sdm("deflect", folder / "bodies.su2", *words) == 0
    points = two_bodies().points
    modes = MeshMotion.load(folder / "p.npz").on(points)
    slopes = objective(modes.at(tuple(AT.values())))[1]
    steps = np.eye(2) * 1e-3
    near = [[objective(modes.at(tuple(np.add(list(AT.values()), s * step))))[0] for s in (1, -1)] for step in steps]
    rates = np.array([(up - down) / 2e-3 for up, down in near])
    return modes.at(tuple(AT.values())), slopes, modes.vjp(tuple(AT.values()), slopes), rates


def asked(sdm, path, folder, *words):
    at = ",".join(f"{name}={amount}" for name, amount in AT.items())
    code, out, err = sdm("gradient", path, "--plan", folder / "p.npz", "--at", at, "--json", *words)
    assert code == 0, err
    found = json.loads(out)
    return np.array([found["gradient"][name] for name in AT]), found["nodes"]


def test_tables_by_titles_in_any_order_give_the_derivative(folder, exact, sdm, monkeypatch):
    points, slopes, whole, rates = exact
    assert whole == pytest.approx(rates, rel=1e-5)
    order = np.random.default_rng(6).permutation(len(points))
    path = to_table(folder / "volume_sens.csv", points, slopes, order)
    found, count = asked(sdm, path, folder)
    assert count == len(points)
    assert np.abs(found - whole).max() < 1e-12 * np.abs(whole).max()
    monkeypatch.setattr(module, "POINTS_AT_A_TIME", 97)
    streamed, _ = asked(sdm, path, folder)
    assert np.abs(streamed - whole).max() < 1e-12 * np.abs(whole).max()


def test_every_kind_of_file_gives_the_same(folder, exact, sdm):
    _, slopes, whole, _ = exact
    np.savez(folder / "adjoint.npz", sensitivity=slopes)
    case = ["--mesh", folder / "bodies"]
    files = {
        folder / "adjoint.npz": [],
        to_cgns(folder / "adjoint.cgns", two_bodies(), slopes): [],
        to_field(folder / "bodies" / "1" / "binary", slopes, True): case,
        to_field(folder / "bodies" / "1" / "text", slopes, False): case,
    }
    for path, words in files.items():
        assert np.abs(asked(sdm, path, folder, *words)[0] - whole).max() < 1e-12 * np.abs(whole).max(), path


def test_a_part_of_the_nodes_counts_as_it_is(folder, exact, sdm):
    points, slopes, whole, _ = exact
    moved = np.flatnonzero((points != two_bodies().points).any(axis=1))
    found, count = asked(sdm, to_table(folder / "part.csv", points, slopes, moved, digits=".12e"), folder)
    assert (found, count) == (pytest.approx(whole, rel=1e-10), len(moved))


def refused(sdm, path, folder, *words, at="left=6,right=-3"):
    code, _, err = sdm("gradient", path, "--plan", folder / "p.npz", "--at", at, *words)
    assert code == 2
    return " ".join(err.split())


def test_what_does_not_fit_is_refused(folder, exact, sdm):
    points, slopes, *_ = exact
    table = to_table(folder / "right.csv", points, slopes)
    assert "from where the plan brings it: amounts, or the order of nodes, differ" in refused(
        sdm, table, folder, at="left=5,right=-3"
    )
    assert "left = 9 deg is outside its range -6:8" in refused(sdm, table, folder, at="left=9")
    assert "--at left: must be a number" in refused(sdm, table, folder, at="left")
    other = to_table(folder / "other.csv", np.vstack([points, points]), np.vstack([slopes, slopes]))
    assert f"not one of the mesh, 0 to {len(points) - 1}" in refused(sdm, other, folder)
    other.write_text('"PointID","x","y","Sensitivity_x"\n0,0,0,1\n')
    assert "there must be Sensitivity_x, Sensitivity_y" in refused(sdm, other, folder)
    other.write_text('"PointID","Sensitivity_x","Sensitivity_y"\n0,0\n')
    assert "in space Sensitivity_z; there is PointID" in refused(sdm, other, folder)
    np.savez(folder / "few.npz", sensitivity=slopes[1:])
    assert f"must have sensitivities ({len(points)}, 3)" in refused(sdm, folder / "few.npz", folder)
    np.savez(folder / "few.npz", sensitivity=np.full(slopes.shape, "1"))
    assert f"must have sensitivities ({len(points)}, 3)" in refused(sdm, folder / "few.npz", folder)
    np.savez(folder / "few.npz", other=slopes)
    assert "has no array sensitivity, but other" in refused(sdm, folder / "few.npz", folder)
    twice = to_table(folder / "twice.csv", points, slopes, [3, 7, 3])
    assert "node 3 has two rows" in refused(sdm, twice, folder)
    assert "must be a pointVectorField" in refused(sdm, folder / "bodies" / "constant/polyMesh/points", folder)
    assert "No such file" in refused(sdm, folder / "none.csv", folder)
    (folder / "elsewhere").mkdir()
    (folder / "p.npz").rename(folder / "elsewhere" / "p.npz")
    assert "bodies.su2 is not there: name the undeflected mesh of the plan in --mesh" in refused(
        sdm, table, folder / "elsewhere"
    )
    (folder / "elsewhere" / "p.npz").rename(folder / "p.npz")


def test_a_plan_becomes_fields_of_the_case_of_its_mesh(folder, exact, sdm):
    case = folder / "bodies"
    code, out, _ = sdm("export", folder / "p.npz", "--format", "openfoam", "--out", case)
    names = ["0/X0", "0/left.S", "0/left.V", "0/right.S", "0/right.V", "constant/sdmMotion", "constant/dynamicMeshDict"]
    assert (code, out.split()) == (0, [str(case / name) for name in names])
    points = open_foam(case / "0", "X0")
    begin = points.data.index(b"List<vector>") + len(b"List<vector>")
    assert np.array_equal(vectors(replace(points, start=begin)).values, two_bodies().points)
    for words, fault in (
        (["--format", "su2", "--out", case], "give --format openfoam, and the case in --out"),
        (["--format", "openfoam"], "give --format openfoam, and the case in --out"),
        (["--format", "openfoam", "--out", folder / "none"], "none"),
    ):
        code, _, err = sdm("export", folder / "p.npz", *words)
        assert (code, fault in " ".join(err.split())) == (2, True), err
    shifted = replace(two_bodies(), points=two_bodies().points + 0.1)
    OpenFoam().write(shifted, folder / "shifted")
    code, _, err = sdm("export", folder / "p.npz", "--format", "openfoam", "--out", folder / "shifted")
    assert code == 2
    assert "is of another mesh" in " ".join(err.split())
    assert not (folder / "shifted" / "0").exists()
