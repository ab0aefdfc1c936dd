"""Formats by name and suffix, and advice for files of unknown formats."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import hidden_folder
from sdm_deflect.base.states import states_of
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import FLUENT
from sdm_deflect.meshing.mesh.faces import corners_in_order
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk

from .format import Format
from .registration import REGISTERED, Registration

# Advice for other files that users may have, by suffix in lower case.
ADVICE = {
    ".cas": FLUENT,
    **dict.fromkeys((".med", ".unv", ".mesh"), "convert it with Gmsh: gmsh FILE -save -format msh41 -o mesh.msh"),
    ".meshb": "convert it with Gmsh, 4.12 or later: gmsh FILE -save -format msh41 -o mesh.msh",
    ".neu": "convert it with OpenFOAM, in a case: gambitToFoam FILE",
    ".vtk": "read it by PyVista, name the patches of its faces, and give the grid to sdm_deflect.deflect(grid, ...)",
    ".h5": "export it from the mesher as CGNS or SU2",
    ".stl": "it holds a surface or a geometry; a mesh with volume cells is needed",
}


class Formats(Mapping[str, Format]):
    """Formats by name; each is loaded when it is first needed."""

    def __getitem__(self, name: str) -> Format:
        return _loaded(REGISTERED[name])

    def __iter__(self) -> Iterator[str]:
        return iter(REGISTERED)

    def __len__(self) -> int:
        return len(REGISTERED)


@cache
def _loaded(entry: Registration) -> Format:
    known: Format = getattr(import_module(entry.module), entry.kind)()
    return known


FORMATS = Formats()


def read(path: str | Path, progress: Progress = silent) -> Mesh:
    """Read a mesh file, or an OpenFOAM case; the mesh bears its name.

    Raises MeshFileError if the format is unknown, or the file is missing, truncated or damaged.
    """
    given = Path(path)
    files = states_of(files_of(given))
    mesh = format_of(given).read(given, progress)
    patches, notes = corners_in_order(mesh.patches, mesh.points)
    file, notes = given.resolve(), [*mesh.notes, *notes]
    return replace(mesh, name=file.name, source=str(file), files=files, patches=patches, notes=tuple(notes))


@contextmanager
def in_pieces(path: Path, progress: Progress = silent) -> Iterator[MeshOnDisk | None]:
    """Yield a mesh with only its boundary in memory; None if its file must be read as a whole.

    Numbers that stand in the file as text are kept in a temporary folder until the context ends.

    MeshFileError as for `read`.
    """
    with hidden_folder() as scratch:
        files = states_of(files_of(path))
        mesh = format_of(path).layout(path, scratch, progress)
        yield mesh and replace(mesh, pieces=replace(mesh.pieces, files=files))  # type: ignore[type-var]


def files_of(path: Path) -> list[Path]:
    """Return every file that is read for a mesh; for a case those in the folders of its mesh and its parts' meshes."""
    return list(format_of(path).files(path))


def size_of(path: Path) -> int:
    """Return the size in bytes of a mesh file, or of the mesh in an OpenFOAM case."""
    return format_of(path).size(path)


def format_of(path: str | Path) -> Format:
    """Return the format of a file by its suffix; a folder, or a new name without suffix, is an OpenFOAM case.

    A digit after the point makes no suffix: ``alpha-12.5`` is a case. A file with an unknown suffix, such as
    ``wing.grid.def.1``, may be a grid of TAU; its content decides.

    Raises MeshFileError if no format has that suffix.
    """
    path = Path(path)
    if known := known_format(path):
        return known
    suffixes = sorted(suffix for entry in REGISTERED.values() for suffix in entry.suffixes)
    packed = path.suffix.lower() == ".gz"
    unpacked = path.with_suffix("") if packed else path
    usual = "" if packed else f"known are {', '.join(suffixes)}"
    hint = ADVICE.get(unpacked.suffix.lower(), usual).replace("FILE", unpacked.name)
    if packed:
        hint = f"unpack it first: gunzip {path.name}" + (f", then {hint}" if hint else "")
    raise MeshFileError(f"{path}: no mesh format has the suffix {path.suffix!r}; {hint}")


def known_format(path: Path) -> Format | None:
    """Return the format of a file as `format_of`; None if no format has its suffix."""
    if path.is_dir() or not (path.is_file() or path.suffix[1:2].isalpha()):
        return FORMATS["openfoam"]
    for name, entry in REGISTERED.items():
        if path.suffix and path.name.lower().endswith(entry.suffixes):
            return FORMATS[name]
    return tau if path.is_file() and (tau := FORMATS["tau"]).holds(path) else None


def ending(path: Path) -> str:
    """Return the suffix of a mesh file, of two words for some formats: ``.b8.ugrid``, ``.msh.h5``."""
    form = known_format(path)
    return form.ending(path) if form else path.suffix
