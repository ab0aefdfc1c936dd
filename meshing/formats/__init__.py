"""Mesh files of the formats that CFD people have: SU2, CGNS, Gmsh, TAU, VTK, OpenFOAM and what meshio adds."""
