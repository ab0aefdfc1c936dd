"""Readers and writers of mesh files: SU2, CGNS, Gmsh, TAU, VTK, OpenFOAM and what meshio adds."""
