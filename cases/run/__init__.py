"""Jobs carried out on meshes and files, and the files that they write."""
