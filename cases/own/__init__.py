"""Deflect any marked surface of a mesh of one's own."""
