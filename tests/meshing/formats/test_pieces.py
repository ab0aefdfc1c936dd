"""What a file holds is the same in pieces and as a whole, in every format that can be read in pieces."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.formats import rewriting, tables
from sdm_deflect.meshing.formats.registry import format_of, in_pieces, read
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.meshing.formats.alike import content, replace_data, zone_of
from tests.meshing.formats.examples import hybrid, with_gmsh
from tests.meshing.formats.gmsh_files import by_gmsh, gmsh_data

SUFFIXES = [".cgns", ".su2", ".msh", ".grid", ".b8.ugrid", ".lr4.ugrid", ".lb8l.ugrid"]
BINARY = [".cgns", ".msh", ".grid", ".b8.ugrid", ".lr4.ugrid"]


@pytest.fixture(autouse=True)
def few_at_a_time(monkeypatch):
    """Ranges of bytes that end within numbers, too."""
    monkeypatch.setattr(tables, "SMALL", 0)
    monkeypatch.setattr(rewriting, "RANGE", 37)


def written(mesh: Mesh, path: Path) -> Path:
    if path.suffix == ".msh":
        path.write_bytes(gmsh_data(mesh))
    else:
        format_of(path).write(mesh, path)
    return path


def check_same(path: Path) -> None:
    """The file in pieces has the points, cells, patches and zones of the whole."""
    mesh = read(path)
    with in_pieces(path) as found:
        assert found is not None
        pieces = found.pieces
        assert pieces.points == len(mesh.points)
        assert pieces.blocks == tuple((own.shape, len(own)) for own in mesh.cells)
        np.testing.assert_array_equal(pieces.coordinates(0, pieces.points), mesh.points)
        np.testing.assert_array_equal(pieces.coordinates(3, 8), mesh.points[3:8])
        order = np.random.default_rng(3).integers(0, pieces.points, 40)
        np.testing.assert_array_equal(pieces.places(order), mesh.points[order])
        for i, own in enumerate(mesh.cells):
            np.testing.assert_array_equal(pieces.cells_of(i, 0, len(own)).nodes, own.nodes)
            later = pieces.cells_of(i, len(own) // 2, len(own))
            np.testing.assert_array_equal(later.nodes, own.nodes[len(own) // 2 :])
        assert content(Mesh(mesh.points, (), found.patches, found.zones)) == {**content(mesh), "cells": {}}
        assert (found.name, pieces.source, found.notes) == (mesh.name, mesh.source, mesh.notes)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_points_cells_and_patches(suffix, tmp_path):
    check_same(written(hybrid(), tmp_path / f"mesh{suffix}"))


def moved(path: Path, out: Path) -> np.ndarray:
    """Rewrite a file in pieces with some nodes at other places, and return all of these."""
    points = read(path).points.copy()
    nodes = np.array([0, 2, 3, 5, 13])
    points[nodes[:-1]] += np.pi / 100.0
    points[13] += 0.0
    with in_pieces(path) as found:
        found.pieces.rewrite(nodes, points[nodes], out)
    return points


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_copy_with_other_coordinates(suffix, tmp_path):
    """The same bytes as rewriting the file as a whole."""
    path, out, other = (tmp_path / f"{name}{suffix}" for name in ("mesh", "pieces", "whole"))
    mesh = hybrid()
    mesh.points[13] = mesh.points[13] * [1.0, -0.0, 1.0]  # a zero keeps its sign
    written(mesh, path)
    points = moved(path, out)
    format_of(path).rewrite(path, points, other)
    assert out.read_bytes() == other.read_bytes()
    assert out.read_bytes() != path.read_bytes()


@pytest.mark.parametrize("suffix", BINARY)
def test_a_file_that_becomes_shorter(suffix, tmp_path):
    path = written(hybrid(), tmp_path / f"mesh{suffix}")
    with in_pieces(path) as found:
        path.write_bytes(path.read_bytes()[:40])
        for take in (lambda: found.pieces.coordinates(0, 14), lambda: found.pieces.places(np.array([13, 2]))):
            with pytest.raises(InputError, match="was changed or replaced while it was in use"):
                take()
        with pytest.raises(InputError, match="was changed or replaced while it was in use"):
            found.pieces.cells_of(0, 0, 1)


def is_in_pieces(path: Path) -> bool:
    with in_pieces(path) as found:
        return found is not None


def test_text_is_read_as_a_whole_by_ugrid_and_gmsh(tmp_path):
    for name in ("mesh.ugrid", "mesh.msh"):
        format_of(tmp_path / name).write(hybrid(), tmp_path / name)
        assert not is_in_pieces(tmp_path / name)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_a_file_by_gmsh_itself(version, tmp_path):
    with_gmsh(tmp_path / "text.msh")
    path = by_gmsh(tmp_path / "text.msh", tmp_path / "mesh.msh", version, 1)
    if version == 4.1:
        check_same(path)
    else:
        assert not is_in_pieces(path)


def test_nodes_of_gmsh_in_another_order(tmp_path):
    """Numbers of nodes that are not those of their places: the file is read as a whole."""
    path = tmp_path / "mesh.msh"
    path.write_bytes(gmsh_data(hybrid(), np.arange(14) + 2))
    assert not is_in_pieces(path)
    assert len(read(path).points) == 14


def test_faces_of_gmsh_in_two_groups_and_in_none(tmp_path):
    path = tmp_path / "mesh.msh"
    path.write_bytes(gmsh_data(hybrid(), groups={1: (1, 7), 2: ()}))
    assert {"floor", "surface_7", "entity_2"} < set(read(path).names)
    check_same(path)


@pytest.mark.parametrize("how", ["chunks", "mixed"])
def test_sections_of_cgns_that_are_no_tables(how, tmp_path):
    path = written(hybrid(), tmp_path / "mesh.cgns")
    with h5py.File(path, "r+") as file:
        node = zone_of(file)["cells tetra"]
        stored = node["ElementConnectivity/ data"][()]
        if how == "chunks":
            del node["ElementConnectivity/ data"]
            node["ElementConnectivity"].create_dataset(" data", data=stored, chunks=(4,))
        else:
            rows = np.column_stack([np.full(len(stored) // 4, 10), stored.reshape(-1, 4)])
            replace_data(node, np.array([20, 0], dtype=np.int32))
            replace_data(node["ElementConnectivity"], rows.ravel().astype(stored.dtype))
    assert not is_in_pieces(path)
    assert len(read(path).cells) == 4


def test_a_section_of_cgns_with_faces_and_then_cells(tmp_path):
    """All elements in one section, MIXED, those of the boundary first."""
    path = written(hybrid(), tmp_path / "mesh.cgns")
    with h5py.File(path, "r+") as file:
        zone = zone_of(file)
        node, tetra = zone["roof triangle"], zone["cells tetra/ElementConnectivity/ data"][:4]
        faces = node["ElementConnectivity/ data"][()].reshape(-1, 3)
        rows = [*(np.append(5, face) for face in faces), np.append(10, tetra)]
        replace_data(node, np.array([20, 0], dtype=np.int32))
        replace_data(node["ElementConnectivity"], np.concatenate(rows).astype(tetra.dtype))
        node["ElementRange/ data"][1] += 1
    assert not is_in_pieces(path)
    assert [len(own) for own in read(path).cells] == [1, 1, 4, 1, 1]


def test_faces_of_cgns_in_a_mixed_section(tmp_path):
    path = written(hybrid(), tmp_path / "mesh.cgns")
    with h5py.File(path, "r+") as file:
        node = zone_of(file)["roof triangle"]
        faces = node["ElementConnectivity/ data"][()]
        rows = np.column_stack([np.full(len(faces) // 3, 5), faces.reshape(-1, 3)])
        replace_data(node, np.array([20, 0], dtype=np.int32))
        replace_data(node["ElementConnectivity"], rows.ravel().astype(faces.dtype))
    check_same(path)


def test_nodes_of_cgns_without_a_sign_and_with_the_greatest_byte_first(tmp_path):
    for kind in ("<u4", ">u8", ">i4"):
        path = written(hybrid(), tmp_path / "mesh.cgns")
        with h5py.File(path, "r+") as file:
            node = zone_of(file)["cells tetra/ElementConnectivity"]
            replace_data(node, node[" data"][()].astype(kind))
        check_same(path)
