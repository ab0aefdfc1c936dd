"""`sdm quality` says the same of a mesh in every format."""

import gzip
import json
import re

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.cases.run.inspection import file_figures, inspect
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS, read
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import MEASURES, mean_ratio
from tests.meshing.formats.examples import grid, hybrid, polyhedral

SHAPES = (("tetrahedra", 4), ("hexahedra", 1), ("prisms", 1), ("pyramids", 1))


def extent_of(mesh, name):
    points = mesh.points[mesh.patch(name).nodes]
    return points.min(axis=0), points.max(axis=0)


@pytest.mark.parametrize("name", [name for name in writable() if name != "openfoam"])
def test_every_format_gives_counts_patches_and_quality(name, tmp_path):
    mesh, path = hybrid(), tmp_path / f"mesh{FORMATS[name].suffixes[0]}"
    FORMATS[name].write(mesh, path)
    text = inspect(path)
    assert text.startswith(f"{path}: 14 points, 7 cells\n")
    for shape, count in SHAPES:
        assert re.search(rf"^{count} {shape} .* 0$", text, re.MULTILINE)
    assert re.search(rf" mean ratio +{mean_ratio(mesh.points, mesh.cells[2].nodes).min():.3f} ", text)
    jacobian = grid(mesh).cell_quality("scaled_jacobian")["scaled_jacobian"]
    for cell in (0, 1, 6):
        assert re.search(rf" scaled Jacobian +{jacobian[cell]:.3f} ", text)
    pairs = zip(*extent_of(mesh, "floor"), strict=True)
    along = [" \N{HORIZONTAL ELLIPSIS} ".join(dict.fromkeys(f"{x:.4g}" for x in pair)) for pair in pairs]
    (row,) = re.findall("^floor .*", text, re.MULTILINE)
    assert re.split("  +", row) == ["floor", "3", *along]
    assert re.search("^patch +faces +x +y +z$", text, re.MULTILINE)


def test_the_same_as_data(tmp_path):
    FORMATS["su2"].write(hybrid(), tmp_path / "mesh.su2")
    found = json.loads(json.dumps(file_figures(tmp_path / "mesh.su2")))
    assert (found["points"], found["cells"], found["left_handed"]) == (14, 7, False)
    assert found["patches"]["floor"] == 3
    assert found["extents"]["floor"] == [end.tolist() for end in extent_of(hybrid(), "floor")]
    assert {one["shape"]: (one["cells"], one["measure"]) for one in found["quality"]} == {
        shape: (4 if shape == "tetra" else 1, MEASURES[shape]) for shape in ("tetra", "hexahedron", "wedge", "pyramid")
    }
    for one in found["quality"]:
        assert {"min", "p01", "mean", "below_0_2", "below_0_4", "inverted"} <= one.keys()
        assert re.search(f" {one['measure']} +{one['min']:.3f} +{one['p01']:.3f} ", inspect(tmp_path / "mesh.su2"))


def test_a_file_most_of_whose_cells_are_inverted_is_refused(tmp_path):
    mesh = hybrid()
    FORMATS["vtu"].write(mesh.with_points(mesh.points * [1.0, 1.0, 0.0]), tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match=r"mesh.vtu: more than half of the cells \(7 of 7\) are inverted or flat"):
        file_figures(tmp_path / "mesh.vtu")


@pytest.mark.parametrize("name", ["a.cas", "a.CAS", "a.msh", "a.cas.gz", "a.msh.gz", "a.su2.gz"])
def test_older_files_of_fluent_and_packed_files_say_how_to_convert_them(name, tmp_path):
    text = b'(0 "grid")\n(2 3)\n(10 (0 1 4 1 3))\n'
    (tmp_path / name).write_bytes(gzip.compress(text) if name.endswith("gz") else text)
    with pytest.raises(MeshFileError) as said:
        file_figures(tmp_path / name)
    assert ("fluentMeshToFoam" in str(said.value)) == (name in ("a.cas", "a.CAS", "a.msh", "a.cas.gz"))
    assert (f"unpack it first: gunzip {name}" in str(said.value)) == name.endswith("gz")
    with pytest.raises(MeshFileError, match=re.escape(str(said.value))):
        read(tmp_path / name)


def test_zones_are_listed(tmp_path):
    Cgns().write(hybrid(2), tmp_path / "mesh.cgns")
    text = inspect(tmp_path / "mesh.cgns")
    assert "zones (points): block 1 14, block 2 14" in text
    assert re.search(r"^8 tetrahedra .* 0$", text, re.MULTILINE)


def test_inverted_cells_of_every_shape_are_counted(tmp_path):
    mesh = hybrid(5)
    points = mesh.points.copy()
    points[:14, 2] = -points[:14, 2]
    flat = Mesh(points, tuple(gathered(mesh)), ())
    FORMATS["su2"].write(flat, tmp_path / "mesh.su2")
    text = inspect(tmp_path / "mesh.su2")
    for shape, count in SHAPES:
        assert re.search(rf"^{5 * count} {shape} .* {count}$", text, re.MULTILINE)


def gathered(mesh):
    """One block of each shape."""
    for shape in ("tetra", "hexahedron", "wedge", "pyramid"):
        yield Cells(shape, np.concatenate([block.nodes for block in mesh.cells if block.shape == shape]))


def test_cells_of_faces_are_judged_by_their_types(tmp_path):
    Cgns().write(polyhedral(hybrid()), tmp_path / "mesh.cgns")
    Cgns().write(hybrid(), tmp_path / "types.cgns")
    first, second = (set(inspect(tmp_path / name).splitlines()) for name in ("mesh.cgns", "types.cgns"))
    judged = {line for line in second if "scaled Jacobian" in line or "mean ratio" in line}
    assert len(judged) == 4
    assert judged <= first


def test_other_files_are_refused_in_a_sentence(tmp_path):
    for name, message in (
        ("surface.stl", "it holds a surface"),
        ("mesh.vtk", "read it by PyVista, name the patches"),
        ("mesh.off", "known are "),
    ):
        (tmp_path / name).touch()
        with pytest.raises(MeshFileError, match=f"no mesh format has the suffix.*{message}"):
            inspect(tmp_path / name)
    with pytest.raises(InputError, match="not a file"):
        inspect(tmp_path / "none")
