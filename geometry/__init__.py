"""The Standard Dynamic Model as parametric CAD: the only package that knows CadQuery."""
