"""Deflect aircraft control surfaces in CFD meshes by radial basis functions, and prove that the result is right."""
