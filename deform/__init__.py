"""Mesh deformation by radial basis functions, point by point."""
