"""Gmsh files of both versions in text and binary: Gmsh itself writes them, and reads what we write."""

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.extras import Library
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.gmsh_files import VARIANTS, by_gmsh

gmsh = Library("gmsh")
meshio = Library("meshio")


@pytest.fixture(scope="module")
def variants(tmp_path_factory):
    """The hybrid mesh, written by Gmsh in each version."""
    folder = tmp_path_factory.mktemp("gmsh")
    Gmsh().write(hybrid(), folder / "ours.msh")
    return {key: by_gmsh(folder / "ours.msh", folder / f"{key[0]}-{key[1]}.msh", *key) for key in VARIANTS}


@pytest.mark.parametrize("key", VARIANTS)
def test_what_gmsh_wrote_is_the_mesh_it_read(variants, key):
    found, expected = Gmsh().read(variants[key]), hybrid()
    for kind in ("cells", "patches"):
        assert _places(found, kind) == _places(expected, kind)  # Gmsh numbers nodes anew and rounds to 16 digits


def test_meshio_reads_the_same_counts_by_name(tmp_path):
    mesh = hybrid()
    assert Gmsh().write(mesh, tmp_path / "mesh.msh") == ()
    other = meshio.read(tmp_path / "mesh.msh")
    tags = np.concatenate(other.cell_data["gmsh:physical"])
    assert {patch.name: len(patch) for patch in mesh.patches} == {
        name: np.count_nonzero(tags == tag) for name, (tag, dimension) in other.field_data.items() if dimension == 2
    }
    assert [name for name, (_, dimension) in other.field_data.items() if dimension == 3] == ["volume"]


def test_groups_without_a_name_and_faces_without_a_group_have_names(tmp_path):
    Gmsh().write(hybrid(), tmp_path / "mesh.msh")
    text = (
        (tmp_path / "mesh.msh")
        .read_text()
        .replace('2 2 "inlet"\n', "")
        .replace("$PhysicalNames\n7", "$PhysicalNames\n6")
    )
    text = text.replace(" 2 3 3 ", " 2 0 3 ")
    (tmp_path / "mesh.msh").write_text(text)
    names = [patch.name for patch in Gmsh().read(tmp_path / "mesh.msh").patches]
    assert names == ["floor", "surface_2", "left wall", "right wall", "roof", "entity_3"]


def test_an_entity_in_two_groups_is_in_both_patches(tmp_path):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1, 2], name="sides")
        gmsh.model.addPhysicalGroup(2, [1, 3, 4, 5, 6], name="all but one")
        gmsh.model.addPhysicalGroup(3, [1], name="box")
        gmsh.option.setNumber("Mesh.SaveParametric", 1)
        gmsh.model.mesh.generate(3)
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / f"{binary}.msh"))
    finally:
        gmsh.finalize()
    for binary in (0, 1):
        mesh = Gmsh().read(tmp_path / f"{binary}.msh")
        assert len(np.intersect1d(mesh.on("sides"), mesh.on("all but one"))) > 4
        assert len(mesh.patch("all but one")) > 2 * len(mesh.patch("sides"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("2.2 0 8", "4 0 8", "version 4"),
        ("$MeshFormat", "(0 fluent", "Fluent"),
        ("\n1 -3.", "\n1 nan -3.", "not finite|numbers"),
        ("\n2 ", "\n1 ", "number of another"),
        (" 14\n$EndElements", " 99\n$EndElements", "1 wedge elements name points that are not among the 14"),
        ("\n1 3 2", "\n1 10 2", "type 10 are not linear"),
        ("$Elements\n", "$Elements\n1", "announces"),
    ],
)
def test_damage_is_named(old, new, said, tmp_path):
    path = tmp_path / "mesh.msh"
    Gmsh().write(hybrid(), path)
    text = path.read_text()
    assert old.split("-3.")[0] in text or old in text
    if "nan" in new:
        start = text.index("$Nodes\n")
        line = text.index("\n1 ", start)
        text = text[: line + 3] + "nan" + text[text.index(" ", line + 3) :]
    elif old.startswith("\n2"):
        start = text.index("$Nodes\n")
        text = text[:start] + text[start:].replace("\n2 ", "\n1 ", 1)
    elif "99" in new:
        head, _, tail = text.partition("\n$EndElements")
        text = head.rsplit(" ", 1)[0] + " 99\n$EndElements" + tail
    else:
        text = text.replace(old, new, 1)
    path.write_text(text)
    with pytest.raises(MeshFileError, match=rf"mesh\.msh: .*({said})"):
        Gmsh().read(path)


def test_second_order_elements_are_refused(variants, tmp_path):
    path = by_gmsh(variants[4.1, 0], tmp_path / "curved.msh", 4.1, 0, order=2)
    with pytest.raises(MeshFileError, match=r"curved\.msh: .* not linear"):
        Gmsh().read(path)


def test_pentagons_cannot_be_written(tmp_path):
    pentagon = Patch("wall", (Polygons(np.arange(5), np.array([0, 5])),))
    mesh = Mesh(hybrid().points[:5], (Cells("tetra", np.array([[0, 1, 2, 3]])),), (pentagon,))
    with pytest.raises(MeshFileError, match=r"out\.msh: patch wall: 1 faces have more than four corners"):
        Gmsh().write(mesh, tmp_path / "out.msh")
    assert not list(tmp_path.iterdir())


def _places(mesh, kind):
    """Coordinates of the corners, in their order, of each cell by shape or of each face by patch."""
    points = np.round(mesh.points, 12)
    return {name: sorted(points[list(row)].tolist() for row in rows) for name, rows in content(mesh)[kind].items()}


HEADER = "$MeshFormat\n{} 0 8\n$EndMeshFormat\n"


@pytest.mark.parametrize(("content", "said"), [
    (HEADER.format("4.1") + "$PartitionedEntities\n0\n$EndPartitionedEntities\n", "saves it in one part"),
    ("$NOD\n0\n$ENDNOD\n", "is of Gmsh's version 1, which is not read"),
    (HEADER.format("2.2") + "$ParametricNodes\n0\n$EndParametricNodes\n", "section .ParametricNodes is not read"),
])  # fmt: skip
def test_what_gmsh_can_convert_is_refused_with_its_command(tmp_path, content, said):
    (tmp_path / "a.msh").write_text(content)
    with pytest.raises(MeshFileError, match=said) as error:
        Gmsh().read(tmp_path / "a.msh")
    assert "`gmsh FILE -save -format msh22 -o NEW.msh`" in str(error.value)
    assert str(error.value).count("a.msh") == 1
