"""`python -m studies flow`: the flow on a deflected mesh beside that on meshes made anew around the deflected CAD."""
