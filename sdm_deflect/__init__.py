"""Deflect aircraft control surfaces in CFD meshes by radial basis functions, and prove that the result is right.

Names are imported when they are first used: `import sdm_deflect` itself loads no other library.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if not Path(__file__).with_name("deform").is_dir():  # a clone without symbolic links, as git makes it on Windows
    __path__.append(str(Path(__file__).parents[1]))

if TYPE_CHECKING:
    from sdm_deflect.base.errors import InputError
    from sdm_deflect.cases.api import Result, deflect, plan, read, surface_map, sweep
    from sdm_deflect.deform.box.hexahedron import Hexahedron
    from sdm_deflect.deform.checks import Check
    from sdm_deflect.deform.mesh_motion import MeshMotion
    from sdm_deflect.deform.surface.blended import Blended
    from sdm_deflect.deform.surface.motions import Rotation
    from sdm_deflect.deform.surface.surface import Listed, OnPatches, TrailingEdge
    from sdm_deflect.deform.surface.tables import Table
    from sdm_deflect.deform.surface_map import SurfaceMap
    from sdm_deflect.meshing.mesh.cells import Cells, Patch
    from sdm_deflect.meshing.mesh.mesh import Mesh
    from sdm_deflect.meshing.mesh.quality import Quality

    __version__: str

__all__ = [
    "Blended",
    "Cells",
    "Check",
    "Hexahedron",
    "InputError",
    "Listed",
    "Mesh",
    "MeshMotion",
    "OnPatches",
    "Patch",
    "Quality",
    "Result",
    "Rotation",
    "SurfaceMap",
    "Table",
    "TrailingEdge",
    "__version__",
    "deflect",
    "plan",
    "read",
    "surface_map",
    "sweep",
]

_MODULES = {
    "cases.api": ("Result", "deflect", "plan", "read", "surface_map", "sweep"),
    "deform.checks": ("Check",),
    "base.errors": ("InputError",),
    "meshing.mesh.mesh": ("Cells", "Mesh", "Patch"),
    "meshing.mesh.quality": ("Quality",),
    "deform.surface.blended": ("Blended",),
    "deform.surface.motions": ("Rotation",),
    "deform.surface.tables": ("Table",),
    "deform.surface.surface": ("Listed", "OnPatches", "TrailingEdge"),
    "deform.box.hexahedron": ("Hexahedron",),
    "deform.mesh_motion": ("MeshMotion",),
    "deform.surface_map": ("SurfaceMap",),
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("sdm-deflect")
    if name == "openmdao":  # an extra: its module inherits from OpenMDAO's component
        return import_module(f"{__name__}.openmdao")
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
