"""Displacements of a surface from a table of points."""

import gzip
import re

import numpy as np
import pytest

from sdm_deflect.base.arrays import farthest
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface import tables
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.surface import Listed, Surface
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.jobs import WING, turn

rng = np.random.default_rng(11)


def cloud(points):
    """A surface without faces."""
    return Surface.of(Mesh(points, (), (Patch("all", (), np.arange(len(points))),)), ("all",))


def bending(p):
    return 0.02 * np.column_stack([0.0 * p[:, 0], 0.0 * p[:, 0], p[:, 1]])


def test_a_table_of_an_affine_field_is_reproduced(hybrid_wing, tmp_path):
    """Bending given at points of another mesh, read from either kind of file."""
    mesh = hybrid_wing.mesh
    places = rng.uniform([0, 0, -0.1], [1, 1, 0.1], (60, 3))
    np.savez(tmp_path / "table.npz", points=places, vectors=bending(places))
    np.savetxt(tmp_path / "table.csv", np.hstack([places, bending(places)]), delimiter=",", header="x,y,z,dx,dy,dz")
    for name in ("table.npz", "table.csv"):
        result = turn(mesh, WING, angle=1.0, motion=Table.read(tmp_path / name), slide={"symmetry": "plane"})
        nodes = mesh.on("wing_upper", "flap_lower")
        np.testing.assert_allclose(result.points[nodes] - mesh.points[nodes], bending(mesh.points[nodes]), atol=1e-9)
        assert result.inverted == 0


def test_a_share_of_a_table_is_that_share_of_its_vectors():
    surface, table = cloud(rng.random((30, 3))), Table(rng.random((9, 3)), rng.random((9, 3)))
    law = table.law(surface)
    np.testing.assert_allclose(law.displacement(-0.25), -0.25 * law.displacement(1.0), atol=1e-15)
    assert not law.displacement(0.0).any()
    assert Moving(("wing",), table, 200.0).motion.unit == "of the table"


def test_a_table_reproduces_its_own_points_even_if_it_names_some_twice():
    places = rng.random((20, 3))
    vectors = np.sin(4.0 * places)
    twice = Table(np.vstack([places, places[:5]]), np.vstack([vectors, vectors[:5]]))
    np.testing.assert_allclose(twice.law(cloud(places)).displacement(1.0), vectors, atol=1e-10)


def test_every_point_of_a_long_table_counts(monkeypatch):
    """Only 3,000 points counted for nodes that are none of them."""
    monkeypatch.setattr(tables, "MOST", 60)
    rng = np.random.default_rng(5)
    places, nodes = rng.random((4000, 3)), rng.random((500, 3))
    law = Table(places, np.sin(6.0 * places)).law(cloud(np.vstack([places, nodes])))
    error = np.abs(law.displacement(1.0) - np.sin(6.0 * np.vstack([places, nodes]))).max(axis=1)
    few = farthest(places, 60)
    thinned = Table(places[few], np.sin(6.0 * places[few])).law(cloud(nodes)).displacement(1.0)
    assert not error[:4000].any()
    assert error[4000:].max() < 0.2 * np.abs(thinned - np.sin(6.0 * nodes)).max()


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("x,y\n1,2\n", "titles must be x,y,z,dx,dy,dz, in a plane mesh x,y,dx,dy; rotations of a beam add"),
        ("0,0,0,1,1,1\n" * 5, "the first line has numbers; add a line of titles above it, such as x,y,z,dx,dy,dz"),
        ("X,y,z,dx,dy,dz,Points:0\n" + "0,0,0,1,1,1,1\n" * 5, "the titles X and Points:0 mean the same"),
        ("x,y,z,dx,dy,dz\n" + "0,0,0,1,1,1,1\n" * 5, "6 titles stand above 7 columns"),
        ("x,y,z,dx,dy,dz\n0,0,0,1,1,1\n#0,0,0,1,1,1\n" * 5, "no table of points"),
        ('x,"y,z,dx,dy,dz\n' + "0,0,0,1,1,1\n" * 5, "the line of titles cannot be read"),
        ("x" * 70_000 + ",y,z,dx,dy,dz\n" + "0,0,0,1,1,1\n" * 5, "the line of titles is too long"),
        ("x,y,z,dx,dy,dz\n0,0,0,1,1,1\n", "it needs at least 4"),
        ("x,y,z,dx,dy,dz\n0,0,zero,1,1,1\n", "no table of points"),
    ],
)
def test_a_table_that_is_none(content, match, tmp_path):
    (tmp_path / "bad.csv").write_text(content)
    with pytest.raises(InputError, match=match):
        Table.read(tmp_path / "bad.csv")


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_a_point_of_two_displacements_is_named(suffix, tmp_path):
    places = rng.random((6, 3))
    vectors = places.copy()
    places[4], path = places[1], tmp_path / f"table{suffix}"
    if suffix == ".npz":
        np.savez(path, points=places, vectors=vectors)
    else:
        np.savetxt(path, np.hstack([vectors, places[:, ::-1]]), delimiter=",", header="dx,dy,dz,z,y,x", fmt="%.17g")
    table = Table.read(path)
    with pytest.raises(InputError, match=re.escape(f"the point {places[1].tolist()} is given twice, with")):
        table.law(cloud(places))


@pytest.mark.parametrize("content", [b"", b"x,y,z,dx,dy,dz\n", b"\xff\xfe\x00", b"x\n1,2,3,4,5,1e999\n" * 5, b"\n" * 9])
@pytest.mark.parametrize("name", ["table.csv", "table.npz", "nodes.txt"])
def test_small_files_that_hold_nothing_of_use_are_refused_in_one_line(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: ") as caught:
        (Listed if name == "nodes.txt" else Table).read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_table_is_not_unpacked_and_not_fetched(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with gzip.open("table.csv.gz", "wt") as packed:
        packed.write("x,y,z,dx,dy,dz\n" + "0,0,1,0,0,0\n" * 9)
    for name in ("table.csv.gz", "http://localhost/table.csv"):
        with pytest.raises(InputError, match="no table of points"):
            Table.read(name)


def test_axis_of_a_table_may_be_given():
    axis = Axis.through(np.zeros(3), np.ones(3))
    assert Table(rng.random((5, 3)), rng.random((5, 3)), axis).axis is axis


@pytest.mark.parametrize("digits", [3, 4, 5, 6, 7, 12])
@pytest.mark.parametrize("wide", [0.0, 1.0])
def test_points_that_are_rounded_off_a_line_or_a_plane_have_no_slope_across_it(digits, wide):
    """A file of six digits moved nodes beside a sloping line by 1,300, where its largest displacement was .2."""
    rng = np.random.default_rng(4)
    across, along = wide * rng.random(40), 2.0 * rng.random(40)
    points = np.column_stack([0.4 + 0.3 * along + across, along, 0.01 + 0.05 * along + 0.03 * across])
    vectors = np.column_stack([np.zeros((40, 2)), 0.05 * points[:, 1] ** 2])
    nodes = rng.uniform([0.0, 0.0, -0.05], [1.2, 2.0, 0.05], (300, 3))
    given = Table(points.round(digits), vectors.round(digits)).law(cloud(nodes)).displacement(1.0)
    exact = Table(points, vectors).law(cloud(nodes)).displacement(1.0)
    assert np.abs(given - exact).max() < 2.0 * 10.0**-digits * (20.0 if digits == 3 else 10.0)
