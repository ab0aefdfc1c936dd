"""Files that appear whole or not at all, child processes, and the mesh cache."""
