"""The Standard Dynamic Model as parametric CAD: the only package that knows CadQuery."""

if __name__ == "geometry":  # from the root of a clone: its classes would be others than those of the package
    raise ImportError("import sdm_deflect.geometry: this is a folder of that package")
