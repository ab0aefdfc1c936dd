"""New places of a surface's nodes (``--to``): files of all formats, series, and what is refused."""

import json

import meshio
import numpy as np
import pytest
import vtk
from vtk.util.numpy_support import numpy_to_vtk

from sdm_deflect import InputError, deflect, plan, read
from sdm_deflect.cases.settings.node_places import read_places
from sdm_deflect.meshing.formats.registry import format_of
from tests.deform.plates import plate
from tests.limits import limited
from tests.meshing.formats.wing import wing

RNG = np.random.default_rng(6)
SLIDE = ("--slide", "symmetry:plane", "--no-report", "--quiet")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A folder with a half wing, its mesh, the surface's nodes and their bent places."""
    folder = tmp_path_factory.mktemp("to")
    source = wing(cells=3).mesh
    format_of(folder / "wing.su2").write(source, folder / "wing.su2")
    mesh = read(folder / "wing.su2")
    nodes = mesh.on(*mesh.expand(["wing_*", "flap_*"], ""))
    return folder, mesh, nodes


def bent(mesh, nodes, size=0.05):
    places = mesh.points[nodes].copy()
    places[:, 2] += size * places[:, 1] ** 2
    return places


def positions(path, nodes, places):
    """SU2's list of surface positions."""
    np.savetxt(path, np.column_stack([nodes, places]), fmt=["%d", *["%.17g"] * places.shape[1]])
    return path


def by_vtk(path, nodes, places):
    """A .csv with the titles of ParaView, whose writer this is."""
    rows = vtk.vtkTable()
    for name, values in (("PointID", nodes), *((f"Points:{i}", places[:, i].copy()) for i in range(3))):
        column = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
        column.SetName(name)
        rows.AddColumn(column)
    writer = vtk.vtkDelimitedTextWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(rows)
    writer.Write()
    return path


def by_meshio(path, mesh, nodes, places):
    """A surface with triangles, its nodes in the mesh's order."""
    blocks = [block for name in mesh.expand(["wing_*", "flap_*"], "") for block in mesh.patch(name).faces]
    cells = [(block.shape, np.searchsorted(nodes, block.nodes)) for block in blocks]
    meshio.write(path, meshio.Mesh(places, cells))
    return path


def test_files_of_all_formats_say_the_same(case, sdm):
    folder, mesh, nodes = case
    places = bent(mesh, nodes)
    order = np.random.default_rng(4).permutation(len(nodes))
    titled = np.column_stack([places[order], nodes[order]])
    np.savetxt(folder / "any.csv", titled, delimiter=",", header="x,y,z,PointID", fmt="%.17g")
    np.savetxt(folder / "mesh.csv", places, delimiter=",", header="x,y,z", comments="", fmt="%.17g")
    np.savez(folder / "a.npz", points=places[order], nodes=nodes[order])
    files = [
        positions(folder / "surface_positions.dat", nodes[order], places[order]),
        folder / "any.csv",
        folder / "mesh.csv",
        folder / "a.npz",
        *(by_meshio(folder / f"surface.{suffix}", mesh, nodes, places) for suffix in ("vtu", "vtk", "obj")),
    ]
    written = []
    for file in files:
        out = folder / f"{file.stem}-{file.suffix[1:]}.su2"
        assert (
            sdm("deflect", folder / "wing.su2", "--surface", "wing_*,flap_*", "--to", file, *SLIDE, "--out", out)[0]
            == 0
        )
        written.append(out.read_bytes())
    assert np.array_equal(read(folder / "surface_positions-dat.su2").points[nodes], places)
    assert all(content == written[0] for content in written)
    for file in (by_vtk(folder / "paraview.csv", nodes, places), by_meshio(folder / "s.ply", mesh, nodes, places)):
        given = read_places(file)
        digits = 1e-5 if file.suffix == ".csv" else 1e-15  # the writer's
        np.testing.assert_allclose(given.places, places, atol=digits)


def test_a_series_has_the_bytes_of_single_runs_in_the_same_box(case, sdm, tmp_path):
    folder, mesh, nodes = case
    sizes = 0.02 * np.arange(1, 4)
    files = [positions(tmp_path / f"{i}.dat", nodes, bent(mesh, nodes, size)) for i, size in enumerate(sizes)]
    source, surface = folder / "wing.su2", ("--surface", "wing_*,flap_*", "--largest", "0.1", *SLIDE)
    assert sdm("deflect", source, *surface, "--to", *files, "--out", tmp_path / "all.su2")[0] == 0
    for i, file in enumerate(files):
        assert sdm("deflect", source, *surface, "--to", file, "--out", tmp_path / f"one{i}.su2")[0] == 0
        assert (tmp_path / f"one{i}.su2").read_bytes() == (tmp_path / f"all_+{i + 1}.su2").read_bytes()
    assert (
        sdm("deflect", source, "--surface", "wing_*,flap_*", *SLIDE, "--to", *files, "--out", tmp_path / "b.su2")[0]
        == 0
    )
    bent_most = read(tmp_path / "b_+3.su2").points[nodes]
    assert np.array_equal(bent_most, bent(mesh, nodes, sizes[-1]))  # without largest the box holds all of them


def test_a_report_of_a_series_can_be_run_again(case, sdm, tmp_path):
    folder, mesh, nodes = case
    files = [positions(tmp_path / f"{i}.dat", nodes, bent(mesh, nodes, size)) for i, size in enumerate((0.02, 0.05))]
    surface = ("--surface", "wing_*,flap_*", "--slide", "symmetry:plane", "--quiet")
    assert sdm("deflect", folder / "wing.su2", *surface, "--to", *files, "--out", tmp_path / "out.su2")[0] == 0
    settings = tmp_path / "out_+2-report" / "settings.toml"
    again = ("--config", settings, "--no-report", "--quiet", "--out", tmp_path / "again.su2")
    assert sdm("deflect", folder / "wing.su2", *again)[0] == 0
    assert (tmp_path / "again.su2").read_bytes() == (tmp_path / "out_+2.su2").read_bytes()


def test_a_mesh_read_in_pieces_takes_the_same_places(case, sdm, tmp_path, monkeypatch):
    folder, mesh, nodes = case
    file = positions(tmp_path / "a.dat", nodes, bent(mesh, nodes))
    words = ("deflect", folder / "wing.su2", "--surface", "wing_*,flap_*", "--to", file, *SLIDE, "--out")
    assert sdm(*words, tmp_path / "whole.su2")[0] == 0
    limited(monkeypatch, file=0)
    assert sdm(*words, tmp_path / "pieces.su2")[0] == 0
    assert (tmp_path / "whole.su2").read_bytes() == (tmp_path / "pieces.su2").read_bytes()


def test_arrays_of_python(case):
    _, mesh, nodes = case
    places = bent(mesh, nodes)
    options = {"slide": "symmetry:plane"}
    result = deflect(mesh, ["wing_*", "flap_*"], to=places, **options)
    assert np.array_equal(result.points[nodes], places)
    half = deflect(mesh, ["wing_*", "flap_*"], None, 0.5, to=places, **options).points[nodes]
    np.testing.assert_allclose(half, 0.5 * (mesh.points[nodes] + places), atol=1e-15)
    motion = plan(mesh, ["wing_*", "flap_*"], to=places, range=(-1.0, 1.0), **options)
    np.testing.assert_allclose(motion.at(0.5)[nodes], half, atol=1e-15)


def test_a_plane_mesh_takes_two_coordinates(tmp_path):
    mesh = plate(32, "triangle")
    nodes = mesh.on("hole")
    places = mesh.points[nodes][:, :2] + 0.05 * np.sin(mesh.points[nodes][:, :2])
    file = positions(tmp_path / "surface_positions.dat", nodes, places)
    for to in (file, [str(file)], places):
        result = deflect(mesh, "hole", to=to, fixed=["bottom", "rest"])
        assert np.array_equal(result.points[nodes][:, :2], places)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda n, p, x: (n, 1000.0 * p), "times 0.001 its places would be near"),
        (lambda n, p, x: (n + 1, p), r"surface\.dat: \d+ of \d+ nodes of .* are not listed, such as node \d+ at"),
        (
            lambda n, p, x: (n, p[RNG.permutation(len(p))]),
            r"times as long\. Are its rows in the order of the mesh's nodes",
        ),
        (lambda n, p, x: (n, p - x[n]), "times as long. Are these displacements"),
        (lambda n, p, x: (n[:-2], p[:-2]), r"2 of \d+ nodes of .* are not listed"),
        (lambda n, p, x: (np.append(n, n[0]), np.vstack([p, p[0]])), "a node is given twice"),
        (lambda n, p, x: (np.append(n, 10**7), np.vstack([p, p[0]])), "1 listed nodes, such as 10000000, are on no"),
        (lambda n, p, x: (np.append(n, -1), np.vstack([p, p[0]])), "numbers of nodes must be whole, from 0"),
        (lambda n, p, x: (n, np.where(p == p.max(), np.nan, p)), "a coordinate is not finite"),
        (lambda n, p, x: (n, p[:, :2]), "it lacks z, and wing.su2 is a mesh in space"),
        (lambda n, p, x: (n, np.column_stack([p, p])), "7 columns; a line has the node's number, then x, y and z"),
        (lambda n, p, x: (np.arange(len(x)), x + 0.1), "listed nodes that are not on .* would move by up to"),
    ],
)
def test_places_that_are_none(case, change, said, tmp_path):
    _, mesh, nodes = case
    given = change(nodes, bent(mesh, nodes), mesh.points)
    with pytest.raises(InputError, match=said):
        deflect(mesh, ["wing_*", "flap_*"], to=positions(tmp_path / "surface.dat", *given), slide="symmetry:plane")


def test_listed_nodes_elsewhere_may_stay(case, tmp_path):
    _, mesh, nodes = case
    points = mesh.points.copy()
    points[nodes] = bent(mesh, nodes)
    file = positions(tmp_path / "all.dat", np.arange(len(points)), points)
    result = deflect(mesh, ["wing_*", "flap_*"], to=file, slide="symmetry:plane")
    assert np.array_equal(result.points[nodes], points[nodes])


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.stl", "", "holds triangles without the order of the nodes: write a .ply or a .vtu"),
        ("a.vtp", "", "a .vtp cannot be read: save the surface as .vtu or .ply"),
        ("a.txt", "", "no list of places is read from .txt; known are .dat, .csv"),
        ("a.dat", "NMARK= 1\n", "no list of places: could not convert"),
        ("a.dat", "", "no list of places: loadtxt: input contained no data"),
        ("a.csv", "1,2,3\n", "the first line has numbers; add a line of titles above it, such as PointID,x,y,z"),
        ("a.csv", "dx,dy,dz\n1,2,3\n", "titles must be x,y,z, in a plane mesh x,y; they are dx,dy,dz"),
        ("a.vtu", "<xml>", "it is damaged, or something else than its suffix says"),
        ("a.ply", "ply\nformat", "it is damaged, or something else than its suffix says"),
        ("a.npz", "PK", "no archive of arrays"),
    ],
)
def test_files_that_are_none(name, content, said, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=said):
        read_places(tmp_path / name)
    with pytest.raises(InputError, match="there is no such file"):
        read_places(tmp_path / "none.dat")


def test_words_beside_to(case, sdm, tmp_path):
    folder, mesh, nodes = case
    first = positions(tmp_path / "1.dat", nodes, bent(mesh, nodes))
    second = positions(tmp_path / "2.dat", nodes, bent(mesh, nodes, 0.02))
    for words, said in (
        ((first, "--hinge", "0,0,0", "0,1,0"), "hinge: `to` says where all nodes of wing_*, flap_* go"),
        ((first, "--angle", "3"), "angle: `to` says where"),
        ((first, "--motion", "blended"), "motion: `to` says where"),
        ((first, "--largest", "0.001"), "largest = 0.001: the surface moves by up to"),
        ((first, second, "--range", "0:1"), "several files are a series of one surface, without range and amount"),
        ((first, second, "--angles", "0,1"), "several files are a series, which `sdm deflect` alone takes"),
        ((first, second, "--plan", tmp_path / "p.npz"), "a plan holds one shape; give one file in --to"),
        (("--dry-run",), "--to: name a file with the new places"),
    ):
        out = ("--out", tmp_path / "out.su2")
        code, _, error = sdm("deflect", folder / "wing.su2", "--surface", "wing_*,flap_*", *SLIDE, *out, "--to", *words)
        assert code == 2
        assert said in error
    assert not list(tmp_path.glob("out*"))
    code, _, error = sdm(
        "deflect", folder / "wing.su2", "--surface", "flap_*", *SLIDE, "--largest", "1", "--angle", "3"
    )
    assert code == 2
    assert "only new places of a surface's nodes (to) have a use for it" in error


def test_settings_name_files_beside_them(case, sdm, tmp_path):
    folder, mesh, nodes = case
    (tmp_path / "in").mkdir()
    positions(tmp_path / "in" / "a.dat", nodes, bent(mesh, nodes))
    (tmp_path / "in" / "to.toml").write_text(
        'slide = { symmetry = "plane" }\n[[surface]]\npatches = ["wing_*", "flap_*"]\nto = ["a.dat"]\nlargest = 0.2\n'
    )
    words = ("deflect", folder / "wing.su2", "--config", tmp_path / "in" / "to.toml", "--json", "--quiet", "--dry-run")
    code, out, _ = sdm(*words)
    assert code == 0
    (far,) = json.loads(out)["farthest"].values()
    largest = (bent(mesh, nodes) - mesh.points[nodes])[:, 2].max()
    assert far["move"] == pytest.approx([0.0, 0.0, largest], abs=1e-12)
