"""`python -m studies flow`: the flow on a deflected mesh beside that on new meshes around the deflected CAD."""
