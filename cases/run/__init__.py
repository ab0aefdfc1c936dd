"""A job carried out on a mesh or a file, and the files it leaves."""
