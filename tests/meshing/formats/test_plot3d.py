"""PLOT3D: every variant by its length alone, blocks that meet move as one, names from neutral map files."""

import numpy as np
import pytest

from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.plot3d import Plot3d
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.mesh.faces import FACES as CORNERS
from sdm_deflect.meshing.mesh.quality import inverted_of
from tests.cases import foam
from tests.extras import Library
from tests.meshing.formats.alike import rows
from tests.meshing.formats.examples import grid
from tests.meshing.formats.plot3d_files import BINARY, SIDES, VARIANTS, box, cut, ring, stored, written

pv = Library("pyvista")


def precision(variant: str) -> str:
    return "f4" if "f4" in variant else "f8"


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_is_told_by_counts_and_length(variant, counted, tmp_path):
    block = box()
    mesh = read(written(tmp_path / "wing.v2.xyz", [block], variant, counted))
    expected = block.transpose(2, 1, 0, 3).reshape(-1, 3).astype(precision(variant))
    np.testing.assert_array_equal(mesh.points, expected)
    assert [(b.shape, len(b)) for b in mesh.cells] == [("hexahedron", 24)]
    assert mesh.cells[0].nodes[0].tolist() == [0, 1, 6, 5, 20, 21, 26, 25]
    assert set(mesh.names) == SIDES
    assert grid(mesh).compute_cell_sizes()["Volume"].min() > 0.0


@pytest.mark.parametrize("flip", [False, True])
def test_patches_face_outwards_whatever_hand_a_block_has(flip, tmp_path):
    block = box()[::-1] if flip else box()
    mesh = read(written(tmp_path / "a.p3d", [block], "textb"))
    assert grid(mesh).compute_cell_sizes()["Volume"].min() > 0.0
    outer = {tuple(np.roll(row, -int(np.argmin(row)))) for row in _faces_of_cells(mesh)}
    for patch in mesh.patches:
        for row in rows(patch.faces[0]):
            assert tuple(np.roll(row, -int(np.argmin(row)))) in outer


def _faces_of_cells(mesh):
    for nodes in mesh.cells[0].nodes:
        yield from (nodes[list(face)] for face in CORNERS["hexahedron"])


@pytest.mark.parametrize(
    ("style", "old", "new"),
    [("%r", "0.5", "0.1"), ("%.6f", "0.500000", "0.1"), ("%15.7E", "5.0000000E-01", "1.23456789e-17")],
)
def test_in_text_only_words_of_moved_coordinates_change(style, old, new, tmp_path):
    source, out = tmp_path / "a.p3d", tmp_path / "b.p3d"
    written(source, [box((3, 2, 2), 0.0)], "textb", style=style)
    source.write_text("  " + source.read_text().replace("\n", "\r\n\t"))
    assert old in source.read_text()
    points = read(source).points.copy()
    points[1, 0] = float(new)
    Plot3d().rewrite(source, points, out)
    np.testing.assert_array_equal(read(out).points, points)
    assert out.read_bytes() == source.read_bytes().replace(old.encode(), new.encode(), 1)


def test_fortran_s_exponents_and_separators(tmp_path):
    source, out = tmp_path / "a.p3d", tmp_path / "b.p3d"
    written(source, [box()], "text", style="%.15E")
    text = source.read_text().replace("E", "D").replace(" ", ", ")
    source.write_text(text)
    points = read(source).points
    np.testing.assert_allclose(points, box().transpose(2, 1, 0, 3).reshape(-1, 3), rtol=1e-14)
    Plot3d().rewrite(source, points + 1.0, out)
    np.testing.assert_array_equal(read(out).points, points + 1.0)
    assert "E" not in out.read_text()


def test_a_point_of_several_blocks_is_one_and_is_written_to_all(tmp_path):
    source, out = tmp_path / "a.p3d", tmp_path / "b.p3d"
    parts = [piece for half in cut(box((7, 5, 4)), 0, 3) for piece in cut(half, 1, 2)]
    written(source, parts, ">f8r")
    mesh = read(source)
    assert len(mesh.points) == 7 * 5 * 4
    assert [(zone.name, zone.blocks) for zone in mesh.zones] == [
        ("block1", ("block1", "block2", "block3", "block4"))
    ]  # fmt: skip
    assert sum(len(patch) for patch in mesh.patches) == 2 * (6 * 4 + 6 * 3 + 4 * 3)
    moved = mesh.points * np.pi
    Plot3d().rewrite(source, moved, out)
    np.testing.assert_array_equal(read(out).points, moved)
    assert len({point.tobytes() for point in stored(out)}) == 7 * 5 * 4


def test_a_block_meets_itself(tmp_path):
    mesh = read(written(tmp_path / "a.xyz", [ring()]))
    assert len(mesh.points) == 16 * 4 * 3
    assert set(mesh.names) == SIDES - {"block1/imin", "block1/imax"}
    faces = np.sort(np.concatenate([f.nodes for p in mesh.patches for f in p.faces]), axis=1)
    assert len(np.unique(faces, axis=0)) == len(faces)


def test_part_of_a_face_may_meet_another_block(tmp_path):
    left, right = cut(box((5, 5, 4)), 0, 2)
    mesh = read(written(tmp_path / "a.xyz", [left, right[:, :3]]))
    count = {patch.name: len(patch) for patch in mesh.patches}
    assert count["block1/imax"] == 2 * 3
    assert "block2/imin" not in count
    assert len(mesh.zones) == 1


def test_blocks_that_do_not_meet_are_zones(tmp_path):
    mesh = read(written(tmp_path / "a.xyz", [box(), box() + 0.3]))
    assert [(zone.name, zone.start, zone.stop) for zone in mesh.zones] == [("block1", 0, 60), ("block2", 60, 120)]


@pytest.mark.parametrize("variant", [v for v in BINARY if v[:1] == "<"] + [">f8", ">f4rb", "text"])
def test_vtk_reads_the_same_points(variant, tmp_path):
    from vtkmodules.vtkIOParallel import vtkMultiBlockPLOT3DReader

    path = written(tmp_path / "a.xyz", cut(box(), 1, 1), variant, style="%.17e")
    Plot3d().rewrite(path, read(path).points * [1.0, 2.0, 3.0], tmp_path / "b.xyz")
    for name in ("a.xyz", "b.xyz"):
        reader = vtkMultiBlockPLOT3DReader()
        reader.SetFileName(str(tmp_path / name))
        if variant == "text":
            reader.BinaryFileOff()
            reader.MultiGridOn()
        else:
            reader.AutoDetectFormatOn()
        reader.Update()
        found = np.concatenate([np.asarray(block.points) for block in pv.wrap(reader.GetOutput())])
        np.testing.assert_allclose(found, stored(tmp_path / name), rtol=1e-6, atol=1e-7)


def test_plot3d_to_foam_makes_the_same_mesh(tmp_path):
    path = written(tmp_path / "a.p3d", cut(box(), 0, 2), "textb", style="%.16e")
    OpenFoam().write(read(path), tmp_path / "case")
    for folder in ("points", "faces", "owner", "neighbour", "boundary"):
        (tmp_path / "case/constant/polyMesh" / folder).unlink()
    foam.run("plot3dToFoam", tmp_path / "case", str(path.resolve()))
    made = read(tmp_path / "case")
    assert sorted(map(tuple, np.round(made.points, 9).tolist())) == sorted(
        map(tuple, np.round(read(path).points, 9).tolist())
    )
    assert len(made.cells[0]) == 24


@pytest.mark.parametrize("layers", [False, True])
@pytest.mark.parametrize("variant", VARIANTS)
def test_plane_grids(variant, layers, tmp_path):
    """Of two coordinates, or of three with one layer of points."""
    flat = [piece[:, :, :1] for piece in cut(box((5, 4, 2), 0.0)[::-1], 0, 2)]
    for piece in flat:
        piece[..., 2] = 0.25 if layers else 0.0
    source, out = tmp_path / "a.p3d", tmp_path / "b.p3d"
    written(source, flat, variant, axes=3 if layers else 2)
    mesh = read(source)
    assert mesh.plane
    assert [(block.shape, len(block)) for block in mesh.cells] == [("quad", 12)]
    assert len(mesh.points) == 20
    assert {p.name: len(p) for p in mesh.patches} == {
        "block1/imin": 3, "block1/jmin": 2, "block1/jmax": 2, "block2/imax": 3, "block2/jmin": 2, "block2/jmax": 2,
    }  # fmt: skip
    assert set(mesh.points[:, 2]) == {0.25 if layers else 0.0}
    assert not inverted_of(mesh.points, mesh.cells[0]).any()
    left = {tuple(pair) for row in mesh.cells[0].nodes for pair in zip(row, np.roll(row, -1), strict=True)}
    assert {tuple(row) for patch in mesh.patches for row in patch.faces[0].nodes} <= left
    moved = mesh.points.copy()
    moved[7, :2] += 0.1
    Plot3d().rewrite(source, moved, out)
    np.testing.assert_array_equal(read(out).points, moved.astype(precision(variant)))


def test_singular_lines_make_prisms(tmp_path):
    block = ring()
    block[:, 0, :, :2] = 0.0
    mesh = read(written(tmp_path / "a.p3d", [block]))
    assert {b.shape: len(b) for b in mesh.cells} == {"hexahedron": 64, "wedge": 32}
    assert "block1/jmin" not in mesh.names
    for cells in mesh.cells:
        assert not inverted_of(mesh.points, cells).any()
    moved = mesh.points * 1.5
    Plot3d().rewrite(tmp_path / "a.p3d", moved, tmp_path / "b.p3d")
    np.testing.assert_array_equal(read(tmp_path / "b.p3d").points, moved)
