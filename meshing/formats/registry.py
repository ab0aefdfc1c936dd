"""The formats we know, by name and by suffix, and what to do with files of others."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.deform.mesh.unchanged import states_of
from sdm_deflect.meshing.files.temporary import scratch_folder
from sdm_deflect.meshing.formats.format import FLUENT, Format, MeshFileError

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


class Entry(NamedTuple):
    """A format that is not loaded yet: its module here, its class there, and its suffixes."""

    module: str
    kind: str
    suffixes: tuple[str, ...]


ENTRIES = {
    "su2": Entry("su2", "Su2", (".su2",)),
    "cgns": Entry("cgns", "Cgns", (".cgns",)),
    "gmsh": Entry("gmsh", "Gmsh", (".msh",)),
    "ugrid": Entry("ugrid", "Ugrid", (".ugrid",)),
    "tau": Entry("tau", "Tau", (".grid", ".taumesh", ".nc")),
    "fluent": Entry("fluent", "Fluent", (".msh.h5", ".cas.h5")),
    "plot3d": Entry("plot3d", "Plot3d", (".p3d", ".p3dfmt", ".p2d", ".p2dfmt", ".xyz", ".x", ".g", ".ufmt")),
    "vtu": Entry("vtu", "Vtu", (".vtu",)),
    "openfoam": Entry("openfoam", "OpenFoam", (".foam",)),
}
"""Every format by its name; a format is added here and nowhere else."""


def _module(name: str) -> Any:
    """Load a module of this folder: a command on one file needs but that of its format."""
    return import_module(f"{__package__}.{name}")


@cache
def _loaded(name: str) -> Format:
    known: Format = getattr(_module(ENTRIES[name].module), ENTRIES[name].kind)()
    return known


class Formats(Mapping[str, Format]):
    """Formats by their names, each loaded when it is first asked for."""

    def __getitem__(self, name: str) -> Format:
        return _loaded(name)

    def __iter__(self) -> Iterator[str]:
        return iter(ENTRIES)

    def __len__(self) -> int:
        return len(ENTRIES)


FORMATS = Formats()
WRITTEN = tuple(name for name in FORMATS if name not in ("fluent", "plot3d"))
"""Formats in which meshes from elsewhere can be written; files of the others are only rewritten."""
IN_PIECES: dict[str, Callable[[Path, Path, Progress], MeshInPieces | None]] = {
    "cgns": lambda path, _, __: _module("cgns").Cgns().in_pieces(path),
    "gmsh": lambda path, _, __: _module("gmsh_pieces").in_pieces(path),
    "ugrid": lambda path, _, __: _module("ugrid_pieces").in_pieces(path),
    "su2": lambda path, scratch, progress: _module("su2_pieces").in_pieces(path, scratch, progress),
    "openfoam": lambda path, _, __: _module("openfoam_pieces").in_pieces(path),
}
"""By format, what returns a file's mesh in pieces, or None where it must be read as a whole; text goes to tables in an
empty folder."""
BESIDE: dict[str, Callable[[Path], Iterable[Path]]] = {
    "ugrid": lambda path: (path, _module("ugrid").mapbc(path)),
    "tau": lambda path: (path, *_module("tau").mappings(path)),
    "plot3d": lambda path: (path, *_module("plot3d_map").maps(path)),
    "openfoam": lambda path: _module("openfoam").files_of(path),
}
"""By format, what returns all files that are read for a mesh, where it is more than one."""
STORED = ("cgns", "gmsh", "ugrid", "openfoam")
"""Formats of these whose numbers stand in the file itself, where other processes can read them."""


def read(path: str | Path, progress: Progress = silent) -> Mesh:
    """Read a mesh file, or an OpenFOAM case; the mesh bears its name.

    Raises MeshFileError if the format is unknown, or the file is missing, truncated or damaged.
    """
    given = Path(path)
    files = states_of(files_of(given))
    mesh = format_of(given).read(given, progress)
    return replace(mesh, name=given.resolve().name, source=str(given.resolve()), files=files)


@contextmanager
def in_pieces(path: Path, progress: Progress = silent) -> Iterator[MeshInPieces | None]:
    """Give a mesh of which the boundary is read; None if its file must be read as a whole.

    Numbers that stand in the file as text are put into the system's folder for temporary files until the end.

    MeshFileError as for `read`.
    """
    form = format_of(path).name
    if form not in IN_PIECES:
        yield None
        return
    with scratch_folder() as scratch:
        files = states_of(files_of(path))
        found = IN_PIECES[form](path, scratch, progress)
        yield found and replace(found, pieces=replace(found.pieces, files=files))  # type: ignore[type-var]


def files_of(path: Path) -> list[Path]:
    """Return every file that is read for a mesh; of a case those in the folders of its mesh and of its parts'."""
    form = format_of(path).name
    return list(BESIDE[form](path)) if form in BESIDE else [path]


def size_of(path: Path) -> int:
    """Return the bytes of a mesh file, or of the mesh in an OpenFOAM case."""
    return int(_module("openfoam").size_of(path) if format_of(path).name == "openfoam" else path.stat().st_size)


def format_of(path: str | Path) -> Format:
    """Return the format of a file by its suffix; a folder, or a new name without suffix, is an OpenFOAM case.

    What follows a point and begins with a digit is no suffix: ``alpha-12.5`` is a case. A file whose suffix no format
    has (``wing.grid.def.1``) may hold a grid of TAU.

    Raises MeshFileError if no format has that suffix.
    """
    path = Path(path)
    if known := known_format(path):
        return known
    suffixes = sorted(suffix for entry in ENTRIES.values() for suffix in entry.suffixes)
    packed = path.suffix.lower() == ".gz"
    own = path.with_suffix("") if packed else path
    usual = "" if packed else f"known are {', '.join(suffixes)}"
    hint = ADVICE.get(own.suffix.lower(), usual).replace("FILE", own.name)
    if packed:
        hint = f"unpack it first: gunzip {path.name}" + (f", then {hint}" if hint else "")
    raise MeshFileError(f"{path}: no mesh format has the suffix {path.suffix!r}; {hint}")


def known_format(path: Path) -> Format | None:
    """Return the format as `format_of` does; None if there is none."""
    if path.is_dir() or not (path.is_file() or path.suffix[1:2].isalpha()):
        return FORMATS["openfoam"]
    for name, entry in ENTRIES.items():
        if path.suffix and path.name.lower().endswith(entry.suffixes):
            return FORMATS[name]
    return FORMATS["tau"] if path.is_file() and _module("tau").Tau().holds(path) else None


def ending(path: Path) -> str:
    """Return the suffix of a mesh file, with the word before it that belongs to it: ``.b8.ugrid``, ``.msh.h5``."""
    own = Path(path.stem).suffix + path.suffix
    if own.lower() in ENTRIES["fluent"].suffixes:
        return own
    return str(_module("ugrid_file").ending(path)) if path.suffix.lower() in ENTRIES["ugrid"].suffixes else path.suffix
