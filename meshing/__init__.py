"""Meshes: generation from CAD, mesh files of all formats, checks and measures, repair. No motion."""

if __name__ == "meshing":  # from the root of a clone: its classes would be others than those of the package
    raise ImportError("import sdm_deflect.meshing: this is a folder of that package")
