"""A mesh of any cells with patches: faces, edges, quality."""
