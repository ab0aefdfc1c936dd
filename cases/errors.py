"""What the command line answers with one line instead of a traceback."""

from sdm_deflect.deform.base.errors import InputError, LostError

EXTRAS = {
    "report": ("jinja2", "markupsafe", "matplotlib", "PIL"),
    "view": ("trame", "trame_client", "trame_vtk", "trame_vuetify", "aiohttp", "pyvista", "vtkmodules"),
    "aircraft": ("cadquery", "OCP", "gmsh", "meshio", "pymeshlab", "pytetwild", "rtree", "trimesh"),
    "cluster": ("cryptography", "dask", "distributed"),
}
"""Modules that an installation may lack, by the extra that brings them."""


def is_reported(error: Exception) -> bool:
    """True for errors whose message tells the user what is wrong; any other exception is a defect of ours."""
    if isinstance(error, InputError | LostError):
        return True
    from sdm_deflect.cases.run.output import OutputError
    from sdm_deflect.deform.rbf.interpolant import SolveError
    from sdm_deflect.geometry.errors import CadError
    from sdm_deflect.meshing.errors import MeshingError
    from sdm_deflect.meshing.formats.format import MeshFileError

    return isinstance(error, OutputError | SolveError | CadError | MeshingError | MeshFileError)


def missing(error: ModuleNotFoundError) -> str:
    """Return which extra brings a module that is not installed, as a sentence; empty if none does."""
    module = (error.name or "").partition(".")[0]
    extra = next((name for name, modules in EXTRAS.items() if module in modules), "")
    return extra and f"this needs {module}, which is not installed: pip install 'sdm-deflect[{extra}]'"
