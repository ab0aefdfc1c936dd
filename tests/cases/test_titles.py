"""Columns of tables are found by their titles: in tracks, tables of displacements, amounts and sensitivities."""

import itertools
import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

from sdm_deflect import InputError, deflect, read
from sdm_deflect import plan as make_plan
from sdm_deflect.cases.settings.job_settings import settings_of
from sdm_deflect.cases.settings.jobs import swept
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.surface.tracks import Track
from sdm_deflect.meshing.formats.cgns_hdf5 import HdfNode, create
from sdm_deflect.meshing.formats.cgns_read import base_of
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.axis import Axis
from tests.cases.test_gradient import exact, folder, objective, refused, to_table  # noqa: F401
from tests.deform.blocks import block_with_body, joined, two_bodies
from tests.deform.plates import plate

RNG = np.random.default_rng(8)
HINGE = Axis.through(np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0]))


SIDE = np.linspace(-1.0, 1.0, 21)


def write(path, titles, columns):
    """A table whose columns are given by name."""
    rows = np.column_stack([columns[name] for name in titles.values()])
    text = [",".join(titles), *(",".join(f"{value:.17g}" for value in row) for row in rows)]
    path.write_text("\n".join(text) + "\n")
    return path


def spelled(names, spell):
    return {spell(name): name for name in names}


SPELLINGS = {
    "ours": str,
    "upper": str.upper,
    "paraview": lambda name: f"{'displacement' if 'd' in name else 'Points'}:{'xyz'.index(name[-1])}",
    "paraview_": lambda name: f"{'displacement' if 'd' in name else 'Points'}_{'xyz'.index(name[-1])}",
    "cgns": lambda name: f"{'displacement' if 'd' in name else 'Coordinate'}{name[-1].upper()}",
    "quoted": lambda name: f'"{name}"',
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_table_in_any_order_of_titles(spelling, tmp_path):
    names = ("x", "y", "z", "dx", "dy", "dz")
    columns = dict(zip(names, RNG.normal(size=(6, 9)), strict=True)) | {"id": np.arange(9.0)}
    expected = np.array([columns[name] for name in names]).T
    for order in (names, names[::-1], ("dx", "z", "dy", "y", "dz", "x"), ("id", *names)):
        titles = {("Point ID" if name == "id" else SPELLINGS[spelling](name)): name for name in order}
        table = Table.read(write(tmp_path / "t.csv", titles, columns))
        np.testing.assert_array_equal(np.hstack([table.points, table.vectors]), expected)
    titles = spelled(("dy", "y", "dx", "x"), SPELLINGS[spelling])
    flat = Table.read(write(tmp_path / "flat.csv", titles, columns))
    assert flat.plane
    np.testing.assert_array_equal(flat.vectors[:, :2], expected[:, 3:5])
    assert not flat.vectors[:, 2].any()


def test_a_track_in_any_order_of_titles(tmp_path):
    names = ("parameter", "angle", "dx", "dy", "dz", "dx2", "dy2", "dz2")
    columns = dict(zip(names, np.vstack([np.zeros(8), RNG.normal(size=(3, 8))]).T, strict=True))
    columns["parameter"] = np.array([0.0, 0.2, 0.7, 1.0])
    expected = np.array([columns[name] for name in names]).T
    for order in itertools.islice(itertools.permutations(names), 0, 40320, 997):
        track = Track.read(write(tmp_path / "t.csv", {name: name for name in order}, columns), HINGE)
        np.testing.assert_array_equal(track.rows, expected)
        assert track.smooth
    cpacs = ("angle", "parameter", "dx", "dy", "dz")
    for title in ("controlParameter", "CONTROLPARAMETER", "control_parameter"):
        titles = {(title if name == "parameter" else name): name for name in cpacs}
        track = Track.read(write(tmp_path / "t.csv", titles, columns), HINGE)
        assert not track.smooth
        np.testing.assert_array_equal(track.rows, np.hstack([expected[:, :5], expected[:, 2:5]]))
    for text, said in (
        (
            "0,0,0,0,0\n1,5,0,0,0\n",
            "the first line has numbers; add a line of titles above it, such as parameter,angle",
        ),
        ("parameter,angle,dx,dz\n0,0,0,0\n1,5,0,0\n", "titles must be parameter,angle,dx,dy,dz"),
        ("parameter;angle;dx;dy\n0;0;0;0\n1;5;0;0\n", "track"),
        ("parameter,angle,dx,dy,dz\n0,0,0,0,0\n#0.5,9,0,0,0\n1,5,0,0,0\n", "no track"),
        ("parameter,angle,dx,dy,dx,dy\n0,0,0,0,0,0\n1,5,0,0,0,0\n", "the titles dx and dx mean the same"),
        ("parameter,angle,dx,dy,dz,dx2,dy2\n0,0,0,0,0,0,0\n1,5,0,0,0,0,0\n", "titles must be"),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(InputError, match=said):
            Track.read(tmp_path / "bad.csv", HINGE)


def test_a_table_without_z_is_for_plane_meshes(tmp_path):
    block = block_with_body(8)
    (tmp_path / "track.csv").write_text("dx,dy,angle,parameter\n0,0,0,0\n0.01,0,3,1\n")
    (tmp_path / "table.csv").write_text("dx,dy,x,y\n" + "".join(f"0.01,0,{x},{y}\n" for x in SIDE for y in SIDE))
    given = {"hinge": [[0, -0.6, 0], [0, 0.6, 0]], "track": str(tmp_path / "track.csv"), "amount": 1}
    with pytest.raises(InputError, match="track: it lacks dz, and mesh is a mesh in space: parameter,angle,dx,dy,dz"):
        deflect(block, [{"patches": "body"} | given])
    with pytest.raises(InputError, match="table: it lacks z and dz, and mesh is a mesh in space: x,y,z,dx,dy,dz"):
        deflect(block, "body", None, 1.0, table=str(tmp_path / "table.csv"))
    moved = deflect(plate(), "hole", None, 1.0, table=str(tmp_path / "table.csv"), margin=0.4)
    nodes = moved.plan.mesh.on("hole")
    np.testing.assert_allclose(moved.displacement[nodes], [[0.01, 0.0, 0.0]] * len(nodes), atol=1e-12)


def test_amounts_in_any_order_of_titles(tmp_path):
    surfaces = [
        {"patches": "Left", "hinge": [[-1.25, -1, 0], [-1.25, 1, 0]]},
        {"patches": "right", "hinge": [[1.25, -1, 0], [1.25, 1, 0]]},
    ]
    settings = settings_of(surfaces, None, None, {})
    for titles, rows in (
        ("Left,right", "1,2"),
        ("right,Left", "2,1"),
        ("RIGHT, left", "2,1"),
        ('"right","Left"', "2,1"),
    ):
        (tmp_path / "a.csv").write_text(f"{titles}\n{rows}\n3,4\n")
        assert swept(settings, str(tmp_path / "a.csv"))[1][0] == (1.0, 2.0)
    for text, said in (
        ("1,2\n3,4\n", "the first line has numbers; add a line of titles above it, such as Left,right"),
        ("left,tail\n3,4\n", "one column for each surface, titled Left,right"),
        ("left,LEFT\n3,4\n", "the titles left and LEFT mean the same"),
    ):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(InputError, match=said):
            swept(settings, str(tmp_path / "a.csv"))


PARAVIEW = ("Points:0", "Points:1", "Points:2")


@pytest.mark.parametrize("names", [PARAVIEW, ("Points_0", "Points_1", "Points_2"), ("X", "Y", "Z")])
@pytest.mark.parametrize("number", ["Point ID", "PointID", "point_id"])
def test_sensitivities_of_paraview_in_another_order(names, number, folder, exact, sdm, tmp_path):  # noqa: F811
    points, slopes, whole, _ = exact
    order = np.random.default_rng(9).permutation(len(points))
    path = to_table(folder / "paraview.csv", points, slopes, order, names)
    text = path.read_text().replace("PointID", number)
    for i, axis in enumerate("xyz"):
        text = text.replace(f"Sensitivity_{axis}", f"Sensitivity:{i}")
    path.write_text(text)
    code, out, err = sdm("gradient", path, "--plan", folder / "p.npz", "--at", "left=6,right=-3", "--json")
    assert code == 0, err
    found = json.loads(out)["gradient"]
    np.testing.assert_allclose([found["left"], found["right"]], whole, rtol=1e-12)
    shuffled = [text.split("\n")[0], *sorted(text.split("\n")[1:-1])]  # other rows, without their numbers
    rows = [line.split(",") for line in shuffled]
    path.write_text("\n".join(",".join(row[1:]) for row in rows) + "\n")
    assert "from where the plan brings it" in refused(sdm, path, folder)


def test_what_is_missing_of_sensitivities_is_an_error(folder, exact, sdm):  # noqa: F811
    points, slopes, *_ = exact
    table = to_table(folder / "s.csv", points, slopes).read_text().split("\n")
    moved = np.flatnonzero((points != two_bodies().points).any(axis=1))

    def said(lines, *words, **given):
        (folder / "bad.csv").write_text("\n".join(lines) + "\n")
        return refused(sdm, folder / "bad.csv", folder, *words, **given)

    cut = moved[len(moved) // 2]
    missing = np.count_nonzero(moved >= cut)
    assert f"has {cut} of {len(points)} nodes; {missing} that move are missing" in said(table[: cut + 1])
    assert f"has 0 of {len(points)} nodes" in said(table[:1])
    two = [",".join(line.split(",")[:-1]) for line in table if line]
    assert "in space Sensitivity_z" in said(two)
    assert "a node is not one of the mesh" in said([table[0], table[1].replace("0,", "5.7,", 1), *table[2:]])
    assert "the line of titles cannot be read" in said([table[0].replace('"x"', '"x'), *table[1:]])
    assert "the line of titles is too long" in said(["x" * 200_000, *table[1:]])
    assert "the first line has numbers; add a line of titles above it" in said(table[1:])
    assert "no table of sensitivities" in said([*table[:3], f"#{table[3]}", *table[4:]])
    assert "beyond 1e+300" in said(
        [table[0], *[",".join([*line.split(",")[:-1], "1.7e308"]) for line in table[1:] if line]]
    )
    assert "a device or a pipe is no file to read" in refused(sdm, "/dev/zero", folder)
    assert "--at left=6,left=5: a surface is named twice" in refused(sdm, folder / "s.csv", folder, at="left=6,left=5")
    assert "--at left=1_0: must be a number" in refused(sdm, folder / "s.csv", folder, at="left=1_0")


def two_zones(home, name, slopes=None, order=(0, 1)):
    """Two blocks with a body, in zones A and B, in this order; and sensitivities at the vertices of each zone."""
    one = block_with_body(8)
    blocks = (one, one.with_points(one.points + np.array([9.0, 0.0, 0.0])))
    mesh = joined(*(blocks[i] for i in order))
    zones = tuple(replace(zone, name="AB"[i]) for zone, i in zip(mesh.zones, order, strict=True))
    mesh = replace(mesh, zones=zones)
    FORMATS["cgns"].write(mesh, home / name)
    with h5py.File(home / name, "r+") as file:
        for own, i in zip(base_of(HdfNode(file)).zones.values() if slopes is not None else (), order, strict=False):
            solution, size = create(own.group, "Adjoint", "FlowSolution_t"), len(one.points)
            for axis, values in zip("XYZ", slopes[i * size : (i + 1) * size].T, strict=True):
                create(solution, f"Sensitivity{axis}", "DataArray_t", values)
    return home / name


def test_zones_of_sensitivities_are_matched_by_name(tmp_path, sdm):
    """Zones in another order gave a derivative of 0."""
    path = two_zones(tmp_path, "two.cgns")
    mesh = read(path)
    plan = make_plan(mesh, "body", hinge=[[0, -0.6, 0], [0, 0.6, 0]], range=(-8, 5))
    plan.save(tmp_path / "p.npz")
    slopes = objective(plan.at(3))[1]
    words = ["--plan", tmp_path / "p.npz", "--at", "3", "--mesh", path, "--json"]
    for order in ((0, 1), (1, 0)):
        code, out, err = sdm("gradient", two_zones(tmp_path, f"s{order[0]}.cgns", slopes, order), *words)
        assert code == 0, err
        assert [*json.loads(out)["gradient"].values()] == pytest.approx(plan.vjp(3, slopes), rel=1e-12)
    FORMATS["cgns"].write(block_with_body(8), tmp_path / "lone.cgns")
    code, _, err = sdm("gradient", tmp_path / "lone.cgns", *words)
    assert (code, "those of the mesh are A, B" in err) == (2, True)
