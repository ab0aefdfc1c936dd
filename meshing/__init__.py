"""From named CAD to a CAD-exact tetrahedral mesh."""

if __name__ == "meshing":  # from the root of a clone: its classes would be others than those of the package
    raise ImportError("import sdm_deflect.meshing: this is a folder of that package")
