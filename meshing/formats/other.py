"""What to do with files of formats that are not read: which program converts them to one that is.

A file is read whole, boundary names included, or not at all; meshio's reader of Fluent's files, for one, loses cells.
"""

from pathlib import Path

FLUENT = "convert it to an OpenFOAM case: fluentMeshToFoam (fluent3DMeshToFoam for hanging nodes)"
GMSH = "convert it with Gmsh: gmsh FILE -save -format msh41 -o mesh.msh"
VTK = 'convert it with PyVista: pyvista.read("FILE").cast_to_unstructured_grid().save("mesh.vtu")'
EXPORT = "export it from the mesher as CGNS or SU2"
SURFACE = "it holds a surface or a geometry; a mesh with volume cells is needed"
ADVICE = {
    ".cas": FLUENT, ".h5": EXPORT, ".neu": "convert it to an OpenFOAM case: gambitToFoam",
    ".ccm": "convert it to an OpenFOAM case: ccmToFoam", ".ccmg": "convert it to an OpenFOAM case: ccmToFoam",
    ".med": GMSH, ".unv": GMSH, ".bdf": GMSH, ".nas": GMSH, ".inp": EXPORT, ".ugrid": EXPORT,
    ".vtk": VTK, ".pvtu": VTK, ".vtm": VTK, ".vtp": SURFACE, ".stl": SURFACE, ".obj": SURFACE, ".ply": SURFACE,
    ".step": SURFACE, ".stp": SURFACE, ".igs": SURFACE, ".iges": SURFACE, ".brep": SURFACE,
}  # fmt: skip
"""By suffix, in lower case."""


def advice(path: Path) -> str:
    """Return what to do with a file that no format reads; empty if that is not known."""
    if path.suffix.lower() == ".gz":
        return f"unpack it first: gunzip {path.name}"
    return ADVICE.get(path.suffix.lower(), "").replace("FILE", path.name)
