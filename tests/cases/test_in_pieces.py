"""A mesh file read in pieces is deflected as one read whole: the same bytes, the same figures."""

import json
import sys

import numpy as np
import pytest

from sdm_deflect.cases import cli, deflect_file
from sdm_deflect.deform.mesh import Cells, Mesh, Patch
from sdm_deflect.deform.volume import excerpt
from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.formats.shapes import mirrored
from tests.meshing.formats.wing import wing

SUFFIXES = (".cgns", ".lb8.ugrid", ".r4.ugrid", ".b8l.ugrid")
FLAP = [
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended",
    "--hinge", "0.7,0.3,0", "0.7,0.7,0",
]  # fmt: skip
PLATE = ["--surface", "right", "--fixed", "left,wall", "--hinge", "1.25,-1,0", "1.25,1,0"]


@pytest.fixture(scope="module")
def small():
    return wing(cells=3).mesh


def shuffled(mesh: Mesh) -> Mesh:
    """The same with nodes and cells of each block in random order: neighbours in a file are far from one another."""
    rng = np.random.default_rng(7)
    order = rng.permutation(len(mesh.points))
    number = np.argsort(order)
    cells = tuple(Cells(own.shape, number[rng.permutation(own.nodes)]) for own in mesh.cells)
    patches = tuple(Patch(p.name, tuple(Cells(f.shape, number[f.nodes]) for f in p.faces)) for p in mesh.patches)
    return Mesh(mesh.points[order], cells, patches)


def left_handed(mesh: Mesh) -> Mesh:
    """The same with the nodes of the first and the last block in the order of the mirror image."""
    first, *others, last = (Cells(own.shape, mirrored(own.shape, own.nodes)) for own in mesh.cells)
    return Mesh(mesh.points, (first, *mesh.cells[1:-1], last), mesh.patches) if others else mesh


def written(mesh, path):
    format_of(path).write(mesh, path)
    return path


@pytest.fixture
def called(monkeypatch, capsys):
    """Run a command; return its code, what it printed, and how many meshes were read in pieces."""
    taken = []
    monkeypatch.setattr(deflect_file, "excerpt", lambda *all_: taken.append(1) or excerpt.excerpt(*all_))

    def call(large, *words):
        taken.clear()
        monkeypatch.setattr(deflect_file, "LARGE", large)
        monkeypatch.setattr(sys, "argv", ["sdm", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr(), len(taken)

    return call


def figures(found, name=""):
    """What was found, by its place, without times and files, and how many of the nodes that stay were looked at."""
    if not isinstance(found, list | dict):
        return {name: found}
    items = found if isinstance(found, dict) else {str(i): own for i, own in enumerate(found)}
    left_out = {"timings", "files", "reports", *(("over", "where") if items.get("name") == "outside_moved" else ())}
    kept = [(key, own) for key, own in items.items() if key not in left_out and "seconds" not in key]
    return {place: value for key, own in kept for place, value in figures(own, f"{name}/{key}").items()}


@pytest.fixture
def alike(called, monkeypatch, tmp_path):
    """Deflect a file whole and in many pieces; return the figures, which are the same, as all bytes written are."""

    def compare(source, *words, points=1000, cells=700, code=0):
        ended, found = [], []
        for name, large in (("whole", 1 << 60), ("pieces", 0)):
            if not large:
                monkeypatch.setattr(excerpt, "POINTS", points)
                monkeypatch.setattr(excerpt, "CELLS", cells)
            folder = tmp_path / name
            folder.mkdir()
            out = folder / f"turned{source.name.removeprefix(source.name.partition('.')[0])}"
            own, text, complaint, taken = called(
                large, "deflect", source, *words, "--json", "--quiet", "--out", out, "--no-report"
            )
            assert own == code, complaint
            assert taken == (not large)
            ended.append(figures(json.loads(text)))
            found.append({path.name: path.read_bytes() for path in folder.iterdir()})
        assert ended[0].items() ^ ended[1].items() == set()
        assert found[0] == found[1]
        return ended[0]

    return compare


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("change", [lambda mesh: mesh, shuffled, left_handed])
def test_a_flap_in_cells_of_four_shapes(suffix, change, small, alike, tmp_path):
    found = alike(written(change(small), tmp_path / f"wing{suffix}"), *FLAP, "--angle", "8")
    assert found["/passed"]
    assert found["/mesh/cells"] == sum(len(own) for own in small.cells)
