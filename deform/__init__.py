"""Mesh deformation by radial basis functions, point by point."""

if __name__ == "deform":  # from the root of a clone: its classes would be others than those of the package
    raise ImportError("import sdm_deflect.deform: this is a folder of that package")
