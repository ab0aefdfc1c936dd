"""The formats we know, by name and by suffix, and what to do with files of others."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.pieces import MeshInPieces
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.format import Format, MeshFileError
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.gmsh_pieces import in_pieces as gmsh_in_pieces
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.openfoam import size_of as case_size
from sdm_deflect.meshing.formats.openfoam_pieces import in_pieces as openfoam_in_pieces
from sdm_deflect.meshing.formats.plot3d import Plot3d
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.formats.su2_pieces import in_pieces as su2_in_pieces
from sdm_deflect.meshing.formats.tau import Tau
from sdm_deflect.meshing.formats.ugrid import Ugrid
from sdm_deflect.meshing.formats.ugrid_file import ending as ugrid_ending
from sdm_deflect.meshing.formats.ugrid_pieces import in_pieces as ugrid_in_pieces
from sdm_deflect.meshing.formats.vtu import Vtu
from sdm_deflect.meshing.temporary import scratch_folder, settle_in

FLUENT = (
    "write it as .cas.h5 in Fluent, or convert it to an OpenFOAM case: fluentMeshToFoam (fluent3DMeshToFoam for "
    "hanging nodes)"
)
GMSH = "convert it with Gmsh: gmsh FILE -save -format msh41 -o mesh.msh"
VTK = 'convert it with PyVista: pyvista.read("FILE").cast_to_unstructured_grid().save("mesh.vtu")'
EXPORT = "export it from the mesher as CGNS or SU2"
SURFACE = "it holds a surface or a geometry; a mesh with volume cells is needed"
ADVICE = {
    ".cas": FLUENT, ".h5": EXPORT, ".neu": "convert it to an OpenFOAM case: gambitToFoam",
    ".ccm": "convert it to an OpenFOAM case: ccmToFoam", ".ccmg": "convert it to an OpenFOAM case: ccmToFoam",
    ".med": GMSH, ".unv": GMSH, ".bdf": GMSH, ".nas": GMSH, ".inp": EXPORT,
    ".vtk": VTK, ".pvtu": VTK, ".vtm": VTK, ".vtp": SURFACE, ".stl": SURFACE, ".obj": SURFACE, ".ply": SURFACE,
    ".step": SURFACE, ".stp": SURFACE, ".igs": SURFACE, ".iges": SURFACE, ".brep": SURFACE,
}  # fmt: skip
"""By suffix, in lower case."""
CGNS, TAU = Cgns(), Tau()
FORMATS: dict[str, Format] = {
    "su2": Su2(), "cgns": CGNS, "gmsh": Gmsh(), "ugrid": Ugrid(), "tau": TAU, "fluent": Fluent(),
    "plot3d": Plot3d(), "vtu": Vtu(), "openfoam": OpenFoam(),
}  # fmt: skip
"""Every format by its name; a format is added here and nowhere else."""
WRITTEN = tuple(name for name in FORMATS if name not in ("fluent", "plot3d"))
"""Formats in which meshes from elsewhere can be written; files of the others are only rewritten."""
IN_PIECES: dict[str, Callable[[Path, Path, Progress], MeshInPieces | None]] = {
    "cgns": lambda path, _, __: CGNS.in_pieces(path),
    "gmsh": lambda path, _, __: gmsh_in_pieces(path),
    "ugrid": lambda path, _, __: ugrid_in_pieces(path),
    "su2": su2_in_pieces,
    "openfoam": lambda path, _, __: openfoam_in_pieces(path),
}
"""By format, what returns a file's mesh in pieces, or None where it must be read as a whole; text goes to tables in an
empty folder."""
STORED = ("cgns", "gmsh", "ugrid", "openfoam")
"""Formats of these whose numbers stand in the file itself, where other processes can read them."""


def read(path: str | Path, progress: Progress = silent) -> Mesh:
    """Read a mesh file, or an OpenFOAM case; the mesh bears its name.

    Raises MeshFileError if the format is unknown, or the file is missing, truncated or damaged.
    """
    given = Path(path)
    settle_in(given.absolute().parent)
    mesh = format_of(given).read(given, progress)
    return replace(mesh, name=given.resolve().name, source=str(given.resolve()))


@contextmanager
def in_pieces(path: Path, progress: Progress = silent) -> Iterator[MeshInPieces | None]:
    """Give a mesh of which the boundary is read; None if its file must be read as a whole.

    Numbers that stand in the file as text are put into the system's folder for temporary files until the end.

    MeshFileError as for `read`.
    """
    settle_in(path.absolute().parent)
    form = format_of(path).name
    if form not in IN_PIECES:
        yield None
        return
    with scratch_folder() as scratch:
        yield IN_PIECES[form](path, scratch, progress)


def size_of(path: Path) -> int:
    """Return the bytes of a mesh file, or of the mesh in an OpenFOAM case."""
    return case_size(path) if format_of(path).name == "openfoam" else path.stat().st_size


def format_of(path: str | Path) -> Format:
    """Return the format of a file by its suffix; a folder, or a new name without suffix, is an OpenFOAM case.

    What follows a point and begins with a digit is no suffix: ``alpha-12.5`` is a case. A file whose suffix no format
    has (``wing.grid.def.1``) may hold a grid of TAU.

    Raises MeshFileError if no format has that suffix.
    """
    path = Path(path)
    if known := known_format(path):
        return known
    suffixes = sorted(suffix for known in FORMATS.values() for suffix in known.suffixes)
    packed = f"unpack it first: gunzip {path.name}" if path.suffix.lower() == ".gz" else ""
    hint = packed or ADVICE.get(path.suffix.lower(), f"known are {', '.join(suffixes)}").replace("FILE", path.name)
    raise MeshFileError(f"{path}: no mesh format has the suffix {path.suffix!r}; {hint}")


def known_format(path: Path) -> Format | None:
    """Return the format as `format_of` does; None if there is none."""
    if path.is_dir() or not (path.is_file() or path.suffix[1:2].isalpha()):
        return FORMATS["openfoam"]
    for known in FORMATS.values():
        if path.suffix and path.name.lower().endswith(known.suffixes):
            return known
    return TAU if path.is_file() and TAU.holds(path) else None


def ending(path: Path) -> str:
    """Return the suffix of a mesh file, with the word before it that belongs to it: ``.b8.ugrid``, ``.msh.h5``."""
    own = Path(path.stem).suffix + path.suffix
    return own if own.lower() in FORMATS["fluent"].suffixes else ugrid_ending(path)
