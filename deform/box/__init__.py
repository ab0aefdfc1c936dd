"""The confining hexahedron: given or chosen, and the sites on its faces (section 3)."""
