"""The table of formats. A format is loaded when it is first needed, so a command on one file loads one format."""

from typing import Any, NamedTuple, TypeVar

Kind = TypeVar("Kind", bound=type[Any])


class Registration(NamedTuple):
    """A format that may not be loaded yet: its module, its class there, and the class's `suffixes` and `written`."""

    module: str
    kind: str
    suffixes: tuple[str, ...]
    written: bool = True


def _ours(file: str, kind: str, *suffixes: str, written: bool = True) -> Registration:
    return Registration(f"{__package__}.{file}", kind, suffixes, written)


# Every format by its name.
REGISTERED = {
    "cgns": _ours("cgns", "Cgns", ".cgns"),
    "fluent": _ours("fluent", "Fluent", ".msh.h5", ".cas.h5", written=False),
    "gmsh": _ours("gmsh", "Gmsh", ".msh"),
    "openfoam": _ours("openfoam", "OpenFoam", ".foam"),
    "plot3d": _ours(
        "plot3d", "Plot3d", ".p3d", ".p3dfmt", ".p2d", ".p2dfmt", ".xyz", ".x", ".g", ".ufmt", written=False
    ),
    "su2": _ours("su2", "Su2", ".su2"),
    "tau": _ours("tau", "Tau", ".grid", ".taumesh", ".nc"),
    "ugrid": _ours("ugrid", "Ugrid", ".ugrid"),
    "vtu": _ours("vtu", "Vtu", ".vtu"),
}


def registered(kind: Kind) -> Kind:
    """Register a format's class from elsewhere by its `name`, `suffixes` and `written`."""
    REGISTERED[kind.name] = Registration(kind.__module__, kind.__name__, kind.suffixes, kind.written)
    return kind


def writable() -> tuple[str, ...]:
    """Return the formats in which meshes from elsewhere can be written."""
    return tuple(name for name, entry in REGISTERED.items() if entry.written)
