"""PLOT3D: every variant by its length alone, blocks that meet move as one, names from neutral map files."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

import sdm_deflect as sdm
from sdm_deflect.cases.inspection import inspect
from sdm_deflect.cases.mesh_files import Targets
from sdm_deflect.deform.faces import FACES as CORNERS
from sdm_deflect.deform.quality import inverted_of
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.plot3d import Plot3d
from sdm_deflect.meshing.formats.plot3d_file import Plot3dFile
from sdm_deflect.meshing.formats.registry import format_of, read
from sdm_deflect.meshing.formats.su2 import Su2
from tests.cases import foam
from tests.meshing.formats.alike import rows
from tests.meshing.formats.blocks import FLAP, HINGE, Block, wing_blocks, write_blocks
from tests.meshing.formats.examples import grid
from tests.meshing.formats.plot3d_files import (
    BINARY,
    BODY,
    FACES,
    VARIANTS,
    box,
    cut,
    head,
    ring,
    whole_face,
    with_body,
    written,
)
from tests.meshing.formats.test_hostile import complaint

SIDES = {f"block1/{axis}{end}" for axis in "ijk" for end in ("min", "max")}


def stored(path: Path) -> np.ndarray:
    """Coordinates of all points of a file, block after block."""
    with path.open("rb") as file:
        return Plot3dFile.opened(file, lambda _: None).points()


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


@pytest.mark.parametrize("variant", BINARY)
def test_only_bytes_of_moved_coordinates_change(variant, tmp_path):
    source, out = tmp_path / "a.p3d", tmp_path / "b.p3d"
    written(source, cut(box(), 0, 2), variant)
    mesh = read(source)
    points = mesh.points.copy()
    points[7, 1] += 0.1
    Plot3d().rewrite(source, points, out)
    before, after = (np.frombuffer(path.read_bytes(), np.uint8) for path in (source, out))
    assert len(before) == len(after)
    changed = np.flatnonzero(before != after)
    assert 0 < np.ptp(changed) + 1 <= int(precision(variant)[1])
    np.testing.assert_array_equal(read(out).points, points.astype(precision(variant)))
    Plot3d().rewrite(source, mesh.points, tmp_path / "same.p3d")
    assert (tmp_path / "same.p3d").read_bytes() == source.read_bytes()


@pytest.mark.parametrize(
    ("style", "old", "new"),
    [("%r", "0.5", "0.1"), ("%.6f", "0.500000", "     0.1"), ("%15.7E", "5.0000000E-01", "1.23456789E-17"),
     ("%.3e", "5.000e-01", "  1.5e+02"), ("%.17E", "5.00000000000000000E-01", "                1.5E+02")],
)  # fmt: skip
def test_in_text_only_words_of_moved_coordinates_change_and_keep_their_style(style, old, new, tmp_path):
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


def test_what_a_grid_holds_is_told(tmp_path):
    text = inspect(written(tmp_path / "a.xyz", cut(box(), 0, 2), "<f4rb"))
    assert "60 points, 24 cells" in text
    assert "2 zones of the file fit together: block1, block2" in text
    assert "24 hexahedra, 0 inverted" in text
    assert "block1/imin 6" in text


def test_blocks_that_do_not_meet_are_zones(tmp_path):
    mesh = read(written(tmp_path / "a.xyz", [box(), box() + 0.3]))
    assert [(zone.name, zone.start, zone.stop) for zone in mesh.zones] == [("block1", 0, 60), ("block2", 60, 120)]


@pytest.fixture
def body(tmp_path):
    """26 blocks around a cube with a map that names the cube, and the same mesh in SU2."""
    blocks = with_body(6)
    lines = [f"wall {whole_face(blocks[int(b[5:]) - 1], int(b[5:]), face)} # body" for b, face in BODY]
    path = written(tmp_path / "mesh.p3d", blocks, "<f8r")
    (tmp_path / "mesh.nmf").write_text(head(blocks) + "\n".join(lines) + "\n")
    return path


def test_a_deflection_is_that_of_the_same_mesh_in_su2_and_interfaces_stay_the_same_bits(body, tmp_path):
    mesh = read(body)
    assert len(mesh.patch("body")) == 24
    Su2().write(mesh, tmp_path / "mesh.su2")
    moved = []
    for name in ("mesh.p3d", "mesh.su2"):
        result = sdm.deflect(tmp_path / name, "body", hinge=[(0, -1, 0), (0, 1, 0)], angle=5.0, fixed="block*")
        result.save(tmp_path / f"mesh-moved{Path(name).suffix}")
        moved.append(read(tmp_path / f"mesh-moved{Path(name).suffix}"))
    assert np.abs(moved[0].points - mesh.points).max() > 0.01
    np.testing.assert_array_equal(moved[0].points, moved[1].points)
    assert moved[0].names == mesh.names  # by the map of mesh.p3d
    places = {point.tobytes() for point in stored(tmp_path / "mesh-moved.p3d")}
    assert len(places) == len(mesh.points)


def line_of(number: int, block: Block, condition: tuple) -> str:
    """A boundary condition as a line of a map: points, or faces, first to last along each axis from 1."""
    _, family, _, begin, end, where = condition
    by_faces, size = (where or "Vertex") != "Vertex", block.places.shape
    flat = [a for a in range(3) if begin[a] == end[a]]
    whole = [a for a in flat if all(end[d] - begin[d] + 1 + by_faces == size[d] for d in range(3) if d != a)]
    axis = "IJK".index(where[0]) if by_faces and where[0] in "IJK" else (whole or flat)[-1]
    face = "ijk"[axis] + ("min" if begin[axis] == 1 else "max")
    ends = [end[a] + by_faces for a in range(3)]
    ranges = [f"{begin[a]} {ends[a]}" for a in ((axis + 1) % 3, (axis + 2) % 3)]
    return f"wall {number} {FACES[face]} {' '.join(ranges)} # {family or condition[0]}"


def test_a_wing_in_nine_blocks_deflects_as_in_cgns(tmp_path):
    blocks = wing_blocks(4)
    write_blocks(tmp_path / "wing.cgns", blocks)
    source = written(tmp_path / "wing.xyz", [block.points for block in blocks], ">f8r")
    lines = [line_of(i, block, own) for i, block in enumerate(blocks, 1) for own in block.conditions]
    (tmp_path / "wing.nmf").write_text("\n".join([head([block.points for block in blocks]), *lines, ""]))
    mesh, same = read(source), read(tmp_path / "wing.cgns")
    np.testing.assert_array_equal(mesh.points, same.points)
    assert {p.name: len(p) for p in mesh.patches} == {p.name: len(p) for p in same.patches}
    hinge = [[HINGE, FLAP[0], 0.0], [HINGE, FLAP[1], 0.0]]
    slide = {"root": "plane", "end": "plane"}
    results = [
        sdm.deflect(path, "flap", hinge, -20.0, motion="blended", fixed="wing", slide=slide)
        for path in (source, tmp_path / "wing.cgns")
    ]
    assert results[0].passed
    np.testing.assert_allclose(results[0].points, results[1].points, rtol=0.0, atol=1e-12)
    results[0].save(tmp_path / "wing-turned.xyz")
    before, after = stored(source), stored(tmp_path / "wing-turned.xyz")
    assert np.abs(after - before).max() > 0.05
    _, place = np.unique(before, axis=0, return_inverse=True)
    _, first = np.unique(place, return_index=True)
    assert len(first) < len(before)
    np.testing.assert_array_equal(after, after[first][place.ravel()])


def test_a_map_names_patches_and_the_rest_are_sides(tmp_path):
    first, second = cut(box((5, 4, 3)), 0, 2)
    path = written(tmp_path / "wing.v2.p3d", [first, second])
    (tmp_path / "wing.nmf").write_text(
        head([first, second]) + "'viscous_solid ' 1 5 1 2 1 3  TRUE\n viscous_solid 2 5 1 3 1 3 ! flap\n"
        '"farfield riem" 1 3 4 1 3 1\nfarfield_riem 2 4 1 4 1 3\nunprocessed 2 6 1 3 1 3\n'
        "ONE_TO_ONE 1 4 1 4 1 3  2 3 1 4 1 3 FALSE # a comment\n# the end\n"
    )
    mesh = read(path)
    assert {patch.name: len(patch) for patch in mesh.patches} == {
        "viscous_solid": 2, "flap": 4, "farfield riem": 6, "farfield_riem": 6, "block1/jmin": 2, "block1/jmax": 4,
        "block1/kmin": 6, "block1/kmax": 6, "block2/jmax": 4, "block2/kmin": 6, "block2/kmax": 6,
    }  # fmt: skip
    assert len(mesh.zones) == 1
    (tmp_path / "wing.v2.nmf").write_text(head([first, second]) + "wall 1 5 1 3 1 3\nwall 2 5 1 3 1 3\n")
    assert len(read(path).patch("wall")) == 8


def test_walls_without_thickness_stay_apart(tmp_path):
    left, right = cut(box((5, 5, 3)), 0, 2)
    path = written(tmp_path / "a.p3d", [left, right])
    (tmp_path / "a.nmf").write_text(head([left, right]) + "wall 1 4 1 3 1 3 # left\nwall 2 3 1 3 1 3 # right\n")
    mesh = read(path)
    assert (len(mesh.patch("left")), len(mesh.patch("right"))) == (4, 4)
    assert len(mesh.points) == 5 * 5 * 3 + 2 * 3  # two lines of points beside the one at the edge
    assert len(mesh.zones) == 1


def test_faces_that_the_map_pairs_may_be_a_little_apart_and_keep_their_bits_at_rest(tmp_path):
    left, right = cut(box(), 0, 2)
    source = written(tmp_path / "a.p3d", [left, right * (1.0 + 1e-9)])
    assert len(read(source).zones) == 2
    (tmp_path / "a.nmf").write_text(head([left, right]) + "one-to-one 2 3 4 1 1 3 1 4 4 1 1 3 false\n")
    mesh = read(source)
    assert len(mesh.points) == 60
    assert not {"block1/imax", "block2/imin"} & set(mesh.names)
    points = mesh.points.copy()
    points[3] += 0.25
    Plot3d().rewrite(source, points, tmp_path / "a-moved.p3d")
    before, after = stored(source), stored(tmp_path / "a-moved.p3d")
    at = np.flatnonzero((before != after).any(axis=1))
    assert len(np.unique(after[at], axis=0)) == 1
    np.testing.assert_allclose(after[at], before[at] + 0.25, rtol=1e-8)


def test_interfaces_that_are_periodic_or_patched(tmp_path):
    left, right = cut(box((5, 5, 3), 0.0), 0, 2)
    source = written(tmp_path / "a.p3d", [left, right[:, ::2]])
    text = head([left, right[:, ::2]]) + "one_to_one 1 3 1 5 1 3 2 4 1 3 1 3 FALSE\n"
    (tmp_path / "a.nmf").write_text(text + "PATCHED 1 4 1 5 1 3 2 3 1 3 1 3\n")
    mesh = read(source)
    assert [zone.blocks for zone in mesh.zones] == [("block1", "block2")]
    assert {"block1/imin", "block2/imax"} <= set(mesh.names)
    assert not {"block1/imax", "block2/imin"} & set(mesh.names)


def test_faces_that_the_map_calls_collapsed_are_no_patches(tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(head([box()]) + "pole_dir2 1 5 1 3 1 5\n")
    assert set(read(path).names) == SIDES - {"block1/jmin"}


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("wall 2 1 1 5 1 4", "there is no face 1 of block 2; there are 6 of 1 blocks"),
        ("wall 1 7 1 5 1 4", "there is no face 7 of block 1"),
        ("wall 1 1 1 6 1 4", "face 1 of block 1 has points 1 to 5, but not 1 to 6"),
        ("wall 1 1 0 5 1 4", "has points 1 to 5, but not 0 to 5"), ("wall 1 1 5 5 1 4", "but not 5 to 5"),
        ("wall 1 1 1 5", "'wall 1 1 1 5' is no type with the block"), ("5 1 1 5 1 4 4", "is no type with the block"),
        ("wall 1 1 1 5 1 4 7", "is no type with the block"), ("wall one 1 1 5 1 4", "is no type"),
        ("one_to_one 1 1 1 5 1 4", "one_to_one has 1 faces; interfaces have two"),
        ("wall 1 1 1 5 1 4 1 2 1 5 1 4", "wall has 2 faces"),
    ],
)  # fmt: skip
def test_wrong_lines_of_a_map(lines, said, tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(head([box()]) + "# nothing\n" + lines)
    assert re.search(rf"a\.nmf: line 8: .*{re.escape(said)}", complaint(Plot3d(), path))


@pytest.mark.parametrize(
    "text", ["", "#", "2\n1 5 4 3\n2 5 4 3\n", "1\n1 5 4 4\n", "wall 1 1 1 5 1 4", "\0\0", "1" * 9999]
)
def test_a_map_of_another_grid(text, tmp_path):
    path = written(tmp_path / "a.p3d", [box()])
    (tmp_path / "a.nmf").write_text(text)
    assert re.search(r"a\.nmf: should begin with 1 1 5 4 3, the number and the sizes", complaint(Plot3d(), path))


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


@pytest.mark.parametrize("variant", VARIANTS)
def test_truncated_files(variant, tmp_path):
    path = written(tmp_path / "a.p3d", [box()], variant)
    data = path.read_bytes().rstrip()
    for length in (0, 1, 4, 12, 20, 200, len(data) // 2, len(data) - 4 - 8 * (variant == "text")):
        path.write_bytes(data[:length].rpartition(b" ")[0] if variant.startswith("text") else data[:length])
        assert "fits no sizes of blocks that its first numbers tell" in complaint(Plot3d(), path), length
    path.write_bytes(data + b" 1.0 " * 3)
    assert "fits no sizes of blocks" in complaint(Plot3d(), path)


@pytest.mark.parametrize("at", [0, 8, 12, 28, 32, -4])
def test_markers_of_records(at, tmp_path):
    path = written(tmp_path / "a.p3d", [box()], "<f8r")
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 64
    path.write_bytes(bytes(data))
    assert "fits no sizes of blocks" in complaint(Plot3d(), path)


@pytest.mark.parametrize("value", [-1, 0, 2**31 - 1, -(2**31), 10**6])
@pytest.mark.parametrize("word", range(4))
@pytest.mark.parametrize("variant", ["<f8", ">f4b", "text"])
def test_counts_that_the_file_cannot_hold(variant, word, value, tmp_path):
    path = written(tmp_path / "a.p3d", [box()], variant)
    if variant == "text":
        words = path.read_text().split()
        words[word] = str(value)
        path.write_text(" ".join(words))
    else:
        data = path.read_bytes()
        path.write_bytes(data[: 4 * word] + struct.pack(f"{variant[0]}i", value) + data[4 * word + 4 :])
    assert "fits no sizes of blocks" in complaint(Plot3d(), path)


def test_what_could_be_two_things_is_refused(tmp_path):
    """One block of 2 x 2 x 4 points, or two plane ones of 2 x 4 and 3 x 5: 51 numbers either way."""
    (tmp_path / "a.xyz").write_text(" ".join(["2", "2", "4", "3", "5", *["0.5"] * 46]))
    assert "it could be each of these: 2 blocks of 2 dimensions (text); one block of 3 dimensions (text)" in complaint(
        Plot3d(), tmp_path / "a.xyz"
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"2 2 2 3*0.5 " + b"1 " * 21, "numbers are repeated by counts such as 3*0.5"),
        (b"2 2 2 wing " + b"1 " * 23, "'wing' is not a number"),
        (b"1\n3 1 2\n" + b"1.5 " * 18, "block 1 of 3 x 1 x 2 points has no cells"),
        (b"1\n2 2 1\n" + b"1.5 " * 8 + b"1 2 3 4", "all points must have one z, but they lie between 1 and 4"),
        (b"2 2 2 " + b"nan " + b"1 " * 23, "1 points are not finite"),
        (b"", "fits no sizes"), (b"\0" * 4000, "fits no sizes"),
    ],
)  # fmt: skip
def test_other_contents(content, said, tmp_path):
    (tmp_path / "a.p3d").write_bytes(content)
    assert said in complaint(Plot3d(), tmp_path / "a.p3d")


def test_single_precision_stays_and_has_its_range(tmp_path):
    source = written(tmp_path / "a.p3d", [box()], ">f4")
    with pytest.raises(MeshFileError, match=r"too large for numbers of 4 bytes"):
        Plot3d().rewrite(source, read(source).points * 1e39, tmp_path / "b.p3d")
    with pytest.raises(MeshFileError, match="the file has 60 points"):
        Plot3d().rewrite(source, np.zeros((61, 3)), tmp_path / "b.p3d")
    assert not (tmp_path / "b.p3d").exists()


def test_a_mesh_from_elsewhere_is_refused_and_other_formats_take_the_blocks(tmp_path):
    with pytest.raises(MeshFileError, match=r"b\.p3d: only a mesh of this format can be written in it"):
        Targets.of(tmp_path / "a.su2", tmp_path / "b.p3d", (3.0,))
    path = written(tmp_path / "a.x", cut(box(), 0, 2))
    with pytest.raises(MeshFileError, match=r"b\.g: only a mesh of this format"):
        Plot3d().write(read(path), tmp_path / "b.g")
    assert Targets.of(path, None, (3.0,)).mesh(3.0).name == "a-deflected.x"
    format_of("c.cgns").write(read(path), tmp_path / "c.cgns")
    assert sum(map(len, read(tmp_path / "c.cgns").patches)) == sum(map(len, read(path).patches))


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


def test_a_plane_grid_with_a_map_turns_about_a_point(tmp_path):
    whole = 2.0 * box((13, 13, 2), 0.0)[:, :, :1] - 1.0
    blocks = [whole[a : a + 5, b : b + 5] for b in (0, 4, 8) for a in (0, 4, 8) if (a, b) != (4, 4)]
    sides = [(2, "jmax"), (4, "imax"), (5, "imin"), (7, "jmin")]
    lines = [f"wall {whole_face(blocks[i - 1], i, face)} # body" for i, face in sides]
    lines += [f"symmetry {whole_face(blocks[0], 1, 'kmin')}", ""]
    source = written(tmp_path / "a.xyz", blocks, "<f8r", axes=2)
    (tmp_path / "a.nmf").write_text(head(blocks) + "\n".join(lines))
    mesh = read(source)
    assert mesh.plane
    assert len(mesh.patch("body")) == 16
    result = sdm.deflect(source, "body", hinge=[(0, 0)], angle=10.0, fixed="block*")
    assert result.save(tmp_path / "b.xyz") == ()
    assert np.abs(stored(tmp_path / "b.xyz") - stored(source)).max() > 0.01
    assert len({point.tobytes() for point in stored(tmp_path / "b.xyz")}) == len(mesh.points)


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
