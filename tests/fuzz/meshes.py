"""Small meshes in every format and encoding that is read."""

import gzip
import shutil
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from sdm_deflect.meshing.formats import openfoam_files as foam
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.ugrid_file import ENCODINGS
from sdm_deflect.meshing.formats.zones import with_pairs
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body
from tests.fuzz.inputs import Input, of_path
from tests.meshing.formats.adf_files import in_adf
from tests.meshing.formats.blocks import in_a_layer, two_blocks, write_blocks
from tests.meshing.formats.examples import hybrid, polyhedral, with_gmsh
from tests.meshing.formats.fluent_files import LAYOUTS, plane_mesh
from tests.meshing.formats.fluent_files import written as fluent_written
from tests.meshing.formats.netcdf_files import KINDS, written
from tests.meshing.formats.periodic_files import box as periodic_box
from tests.meshing.formats.periodic_files import ring_of_blocks, write_periodic
from tests.meshing.formats.periodic_files import square as periodic_square
from tests.meshing.formats.plot3d_files import VARIANTS, box, cut, head, ring, whole_face
from tests.meshing.formats.plot3d_files import written as plot3d_written

HARMLESS = str.maketrans("<>", "lb")
ARCH = "LSB;label=32;scalar=64"


def block() -> Mesh:
    """26 hexahedra around a cube, the patch that moves first."""
    mesh = block_with_body(3)
    sides = Patch("far", tuple(faces for patch in mesh.patches[1:] for faces in patch.faces))
    return Mesh(mesh.points, mesh.cells, (mesh.patches[0], sides))


def tetrahedra() -> Mesh:
    """One patch, two cells."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=np.float64)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    return Mesh(points, (Cells("tetra", cells),), (Patch("wall", (Cells("triangle", faces),)),))


def mixture(zones: int = 1) -> Mesh:
    """A cell of each shape and two patches."""
    mesh = hybrid(zones)
    walls = Patch("walls", tuple(faces for patch in mesh.patches[1:] for faces in patch.faces))
    return Mesh(mesh.points, mesh.cells, (mesh.patches[0], walls) if zones == 1 else (), mesh.zones)


def plane() -> Mesh:
    """Two quads and two triangles around a corner, the patch that moves first."""
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(3)], dtype=np.float64)
    quads, triangles = np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), np.array([[3, 4, 7], [3, 7, 6]])
    wall, rest = np.array([[5, 4], [4, 7]]), np.array([[0, 1], [1, 2], [2, 5], [7, 6], [6, 3], [3, 0]])
    patches = (Patch("body", (Cells("line", wall),)), Patch("far", (Cells("line", rest),)))
    return Mesh(points[:8], (Cells("quad", quads), Cells("triangle", triangles)), patches)


def paired(turn: float = 0.0) -> Mesh:
    """Eight hexahedra between two sides that are images of one another, by a translation or a rotation about x."""
    x, y, z = np.meshgrid(np.arange(3.0), 1.0 + np.arange(3.0), np.arange(3.0), indexing="ij")
    if turn:
        y, z = y * np.cos(turn * z), y * np.sin(turn * z)
    number = np.arange(27).reshape(3, 3, 3)
    corners = [number[i : i + 2, j : j + 2, k : k + 2].ravel() for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    cells = np.array(corners)[:, [0, 4, 6, 2, 1, 5, 7, 3]]
    left, right = (
        np.array([number[i : i + 2, j : j + 2, k].ravel()[[0, 2, 3, 1]] for i in (0, 1) for j in (0, 1)])
        for k in (0, 2)
    )
    patches = (Patch("left", (Cells("quad", left[:, ::-1]),)), Patch("right", (Cells("quad", right),)))
    mesh = Mesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), (Cells("hexahedron", cells),), patches)
    return with_pairs(mesh, [("sides", np.stack([number[:, :, 0].ravel(), number[:, :, 2].ravel()], axis=1))])


def of_format(name: str, folder: Path) -> Iterator[Input]:
    """Yield meshes as we write them."""
    flat = [("flat", plane())] if name in ("su2", "cgns", "gmsh", "vtu") else []
    pairs = [("pair", paired()), ("turn", paired(0.3))] if name in ("cgns", "gmsh") else []
    for title, mesh in (*flat, *pairs, ("body", block()), ("mixture", mixture()), ("tet", tetrahedra())):
        path = folder / (title + (FORMATS[name].suffixes[0] if name != "openfoam" else ""))
        FORMATS[name].write(mesh, path)
        yield of_path(path)


def su2(folder: Path) -> Iterator[Input]:
    """SU2, with comments and several zones."""
    for one in of_format("su2", folder):
        yield one
    text = one.files["tet.su2"].decode()
    yield Input({"tet.su2": b"% a comment\n" + text.replace("\n", "  \r\n").encode()})
    yield Input({"tet.su2": ("NZONE= 2\nIZONE= 1\n" + text + "IZONE= 2\n" + text).encode()})


def cgns(folder: Path) -> Iterator[Input]:
    """CGNS: sections of a shape, mixed ones, polyhedra, zones; as the examples of other programs are made."""
    yield from of_format("cgns", folder)
    for title, mesh in (
        ("polyhedra", polyhedral(mixture())),
        ("zones", mixture(2)),
        ("cells", polyhedral(tetrahedra())),
    ):
        FORMATS["cgns"].write(mesh, folder / f"{title}.cgns")
        yield of_path(folder / f"{title}.cgns")
    yield from listless(folder)
    yield from mixed(folder)
    yield from stored_otherwise(folder)
    yield from in_blocks(folder)


def in_blocks(folder: Path) -> Iterator[Input]:
    """Two structured zones with an interface, and plane ones, of one layer, too; the same and other files in ADF."""
    write_blocks(folder / "two.cgns", two_blocks())
    write_blocks(folder / "plane.cgns", [block.flat() for block in two_blocks()], dimension=2)
    write_blocks(folder / "layer.cgns", [block.flat() for block in two_blocks()], dimension=2)
    in_a_layer(folder / "layer.cgns", 1, "CoordinateZ")
    write_blocks(folder / "lists.cgns", two_blocks(), connect=False)
    with h5py.File(folder / "lists.cgns", "r+") as file:
        group = create(file["Base#1/left"], "ZoneGridConnectivity", "ZoneGridConnectivity_t")
        meets = create(group, "meets", "GridConnectivity_t", "right")
        create(meets, "GridConnectivityType", "GridConnectivityType_t", "Abutting1to1")
        for name, i in (("PointList", 4), ("PointListDonor", 1)):
            points = [(i, j, k) for j in (1, 2, 3) for k in range(1, 6)]
            create(meets, name, "IndexArray_t", np.array(points, dtype=np.int32))
    for name in ("two", "plane", "layer", "lists"):
        yield of_path(folder / f"{name}.cgns")
    for name, order, binary in (("two", "<", 0), ("tet", ">", 0), ("polyhedra", "<", 0), ("two", ">", 1)):
        path = folder / f"{name}-adf{binary}.cgns"
        path.write_bytes(in_adf(folder / f"{name}.cgns", order, pieces=2, binary=bool(binary)))
        yield of_path(path)


def listless(folder: Path) -> Iterator[Input]:
    """Periodic sides whose images are found by the motion alone; blocks in a ring that does not close."""
    shutil.copyfile(folder / "turn.cgns", folder / "motion.cgns")
    with h5py.File(folder / "motion.cgns", "r+") as file:
        for node in file["Base/Zone/ZoneGridConnectivity"].values():
            if isinstance(node, h5py.Group):
                del node["PointListDonor"]
    write_blocks(folder / "ring.cgns", ring_of_blocks())
    for name in ("motion", "ring"):
        yield of_path(folder / f"{name}.cgns")


def mixed(folder: Path) -> Iterator[Input]:
    """A section of mixed elements, with and without offsets."""
    for offsets in (True, False):
        path = folder / f"mixed{offsets:d}.cgns"
        FORMATS["cgns"].write(tetrahedra(), path)
        with h5py.File(path, "r+") as file:
            section = next(node for name, node in file["Base"]["Zone"].items() if name.startswith("cells"))
            section[" data"][...] = [20, 0]
            nodes = section["ElementConnectivity"][" data"][()].reshape(-1, 4)
            rows = np.column_stack([np.full(len(nodes), 10), nodes]).astype(nodes.dtype)
            del section["ElementConnectivity"][" data"]
            section["ElementConnectivity"].create_dataset(" data", data=rows.ravel())
            if offsets:
                file.copy(section["ElementConnectivity"], section, "ElementStartOffset")
                section["ElementStartOffset"].attrs["name"] = np.bytes_("ElementStartOffset")
                del section["ElementStartOffset"][" data"]
                section["ElementStartOffset"].create_dataset(" data", data=np.array([0, 5, 10], nodes.dtype))
        yield of_path(path)


def stored_otherwise(folder: Path) -> Iterator[Input]:
    """Coordinates that are packed; a boundary given by its points."""
    path = folder / "packed.cgns"
    FORMATS["cgns"].write(tetrahedra(), path)
    with h5py.File(path, "r+") as file:
        axis = file["Base/Zone/GridCoordinates/CoordinateX"]
        values = axis[" data"][()]
        del axis[" data"]
        axis.create_dataset(" data", data=values, chunks=True, compression="gzip")
    yield of_path(path)
    path = folder / "points.cgns"
    FORMATS["cgns"].write(tetrahedra(), path)
    with h5py.File(path, "r+") as file:
        condition = next(iter(file["Base/Zone/ZoneBC"].values()))
        del condition["GridLocation"]
        condition["PointRange"][" data"][...] = [[1], [5]]
    yield of_path(path)


def gmsh(folder: Path) -> Iterator[Input]:
    """Versions 2.2 and 4.1, text and binary, ours and Gmsh's."""
    import gmsh as library

    yield from of_format("gmsh", folder)
    for shape in (periodic_box, periodic_square):
        yield from map(of_path, write_periodic(folder, shape).values())
    with_gmsh(folder / "box.msh")
    library.initialize(interruptible=False)
    try:
        library.option.setNumber("General.Terminal", 0)
        library.merge(str(folder / "box.msh"))
        for title, source in (("gmsh", ""), ("turn", "turn.msh")):
            if source:
                library.clear()
                library.merge(str(folder / source))
            for version, binary in ((2.2, 0), (2.2, 1), (4.1, 0), (4.1, 1)):
                library.option.setNumber("Mesh.MshFileVersion", version)
                library.option.setNumber("Mesh.Binary", binary)
                path = folder / f"{title}{10 * version:.0f}{binary}.msh"
                library.write(str(path))
                yield of_path(path)
    finally:
        library.finalize()


def ugrid(folder: Path) -> Iterator[Input]:
    """UGRID: text and every binary encoding, with and without names of the surfaces."""
    for one in of_format("ugrid", folder):
        text = (folder / one.main.replace(".ugrid", ".mapbc")).read_bytes()
        yield Input({**one.files, one.main.replace(".ugrid", ".mapbc"): text})
    for encoding in ENCODINGS:
        path = folder / f"mix.{encoding}.ugrid"
        FORMATS["ugrid"].write(mixture(), path)
        yield of_path(path)


def tau(folder: Path) -> Iterator[Input]:
    """Grids of TAU in every kind of netCDF, with and without a boundary mapping."""
    yield from of_format("tau", folder)
    mapping = b" Markers: 1, 2  # both\n Type: viscous wall\n Name: wing\n block end\n"
    for kind in KINDS:
        one = of_path(written(mixture(), folder / f"{kind}.grid", kind))
        yield Input({**one.files, f"{kind}.bmap": mapping})


def fluent(folder: Path) -> Iterator[Input]:
    """Fluent's files, as its solver and as its mesher store them, plain and packed."""
    for layout in LAYOUTS:
        solids = ("body", block()), ("tet", tetrahedra()), ("cells", polyhedral(mixture()))
        for title, mesh in (*solids, ("pair", paired()), ("turn", paired(0.3))):
            yield of_path(fluent_written(mesh, folder / f"{title}_{layout}.cas.h5", layout))
        yield of_path(fluent_written(plane_mesh(), folder / f"plane_{layout}.cas.h5", layout))
        packed = folder / f"packed_{layout}.msh.h5"
        yield of_path(fluent_written(mixture(), packed, layout, "f4", compression="gzip", chunks=True))


def plot3d(folder: Path) -> Iterator[Input]:
    """PLOT3D in every variant, one block and several, with and without a map."""
    for variant in VARIANTS:
        yield of_path(
            plot3d_written(folder / f"box_{variant.translate(HARMLESS)}.p3d", [box((3, 3, 2))], variant, False)
        )
        flat = folder / f"flat_{variant.translate(HARMLESS)}.x"
        yield of_path(plot3d_written(flat, cut(box((5, 3, 1), 0.0), 0, 2), variant, axes=2))
        blocks = [*cut(box((5, 3, 3)), 0, 2), ring((5, 3, 2))]
        one = of_path(plot3d_written(folder / f"cut_{variant.translate(HARMLESS)}.xyz", blocks, variant))
        lines = [f"wall {whole_face(blocks[1], 2, 'jmin')} # flap", "one_to_one 1 4 1 3 1 3 2 3 1 3 1 3 FALSE", ""]
        yield Input({**one.files, one.main.replace(".xyz", ".nmf"): (head(blocks) + "\n".join(lines)).encode()})


def openfoam(folder: Path) -> Iterator[Input]:
    """A case in text, packed, and in binary."""
    for one in of_format("openfoam", folder):
        slim = Input({name: data for name, data in one.files.items() if "polyMesh" in name})
        yield slim
        yield Input({name: foam_text(name, data) for name, data in slim.files.items()})
        yield Input({f"{name}.gz": gzip.compress(data, 1, mtime=0) for name, data in slim.files.items()})


def foam_text(name: str, data: bytes) -> bytes:
    """Return a file of OpenFOAM with its list in text."""
    kind = name.rpartition("/")[2]
    if kind == "boundary":
        return data
    header = foam.HEADER.search(data)
    assert header
    file = foam.FoamFile(data, header.end(), {"format": "binary", "class": "faceCompactList", "arch": ARCH}, len(data))
    head = data[: header.end()].replace(b"binary", b"ascii").replace(b"faceCompactList", b"faceList")
    if kind == "points":
        rows = [f"({' '.join(map(repr, row))})" for row in foam.vectors(file).values.tolist()]
    elif kind == "faces":
        faces = foam.faces(file)
        parts = np.split(faces.nodes, faces.offsets[1:-1])
        rows = [f"{len(part)}({' '.join(map(str, part.tolist()))})" for part in parts]
    else:
        rows = list(map(str, foam.labels(file).tolist()))
    return head + "\n{}\n(\n{}\n)\n".format(len(rows), "\n".join(rows)).encode()


def vtu(folder: Path) -> Iterator[Input]:
    """What we write; polyhedra."""
    yield from of_format("vtu", folder)
    FORMATS["vtu"].write(polyhedral(tetrahedra()), folder / "polyhedra.vtu")
    yield of_path(folder / "polyhedra.vtu")


WORDS: dict[str, tuple[bytes, ...]] = {
    "su2": (b"NDIME= 3\n", b"NDIME= 2\n", b"NPOIN= 5\n", b"NPOIN=\n", b"NELEM= 2\n", b"NELEM= 0\n", b"NMARK= 1\n",
            b"MARKER_TAG= wall\n", b"MARKER_ELEMS= 6\n", b"NZONE= 2\n", b"IZONE= 2\n", b"NCHUNK= 1\n",
            b"SEND_RECV= 1\n",
            b"12 0 1 2 3 4 5 6 7\n", b"10 ", b"13 ", b"14 ", b"5 ", b"9 ", b"3 0 1\n", b"NPERIODIC= 1\n",
            b"NMARK= 0\n"),
    "gmsh": (b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", b"4.1 1 8\n", b"$Nodes\n", b"$EndNodes\n", b"$Elements\n",
             b"$EndElements\n", b"$PhysicalNames\n", b"$Entities\n", b"$Periodic\n", b"$NodeData\n", b"$Comments\n",
             b"$PartitionedEntities\n", b"$ParametricNodes\n", b"0 0 0 0\n", b"1 0 0 0\n", b'2 7 "wing"\n',
             b"4 2 1 1 ", b"2 2 1\n9\n", b"Affine 1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1\n"),
    "ugrid": (b"5 6 0 2 0 0 0\n", b"0 0 0 0 0 0 0\n", b"1 4000 wall\n", b"-1", b"99999999999", b"nan", b"0.5",
              b"\0\0\0\x1c", b"\x1c\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\x05"),
    "tau": (b"CDF\1", b"CDF\2", b"CDF\5", b"\0\0\0\x0a", b"\0\0\0\x0b", b"\0\0\0\x0c", b"\x7f\xff\xff\xff",
            b"\xff\xff\xff\xff", b"points_xc", b"points_of_prisms", b"no_of_elements", b"boundarymarker_of_surfaces",
            b"marker_1", b"\0\0\0\6", b"Markers: 1", b"Name: ", b"block end", b"#"),
    "openfoam": (b"FoamFile{", b"FoamFile{" * 500, b"format binary;", b"arch \"LSB;label=64;scalar=32\";", b"label=128",
                 b"scalar=8", b"900000000{0}", b"5{0}", b"{{{{", b"}", b"(", b")", b"((((", b"/*", b"*/", b"//", b'"',
                 b"#include \"/etc/passwd\"", b"4(0 1 2 3)", b"type patch;", b"nFaces", b"startFace",
                 b"class faceList;",
                 b"class faceCompactList;", b"MSB", b"$internal;", b"inGroups 1(wall);"),
    "vtu": (b'NumberOfPoints="99999999999"', b'NumberOfCells="-5"', b'NumberOfComponents="4000000000"', b"<Piece>",
            b"</Piece>", b"<DataArray/>", b"<AppendedData encoding=\"raw\">_", b"</VTKFile>",
            b"<!DOCTYPE a [<!ENTITY b \"c\">]>",
            b'format="appended" offset="-1"', b'offset="99999999999"', b'type="Float32"', b'type="String"',
            b'format="ascii"',
            b'byte_order="BigEndian"', b'header_type="UInt64"', b'header_type="Int8"',
            b'compressor="vtkLZ4DataCompressor"',
            b'compressor="vtkLZMADataCompressor"', b'compressor=""', b"&#x0;", b"&amp;", b"<![CDATA[", b"42 42 42",
            b'Name="connectivity"', b'Name="offsets"', b'Name="types"', b'Name="faces"', b'Name="patch"',
            b"<Piece" * 200),
    "cgns": (b"\x89HDF\r\n\x1a\n", b"LK", b"MT", b"TREE", b"SNOD", b"HEAP", b"GCOL", b"OHDR", b"FRHP", b"BTHD",
             b"NoDe", b"TaiL", b"SNTb", b"DaTa", b"DCtb", b"dEnD", b"FFFFFFFFFFFF", b"000000000000", b"Structured",
             b"GridConnectivity1to1_t", b"R4", b"C1", b"Periodic_t", b"BCSymmetryPlane", b"Abutting"),
    "fluent": (b"\x89HDF\r\n\x1a\n", b"TREE", b"SNOD", b"HEAP", b"OHDR", b"minId", b"nnodes", b"c0", b"zoneType"),
    "plot3d": (b"2\n3 3 2\n", b"1 ", b"-1 ", b"99999999999", b"nan", b"3*0.5", b"1.0D+00", b"\0\0\0\1", b"\1\0\0\0",
               b"\xff\xff\xff\x7f", b"one_to_one 1 4 1 3 1 3 2 3 1 3 1 3 TRUE\n", b"patched", b"collapsed", b"# wing"),
}  # fmt: skip
