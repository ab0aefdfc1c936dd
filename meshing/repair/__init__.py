"""Cells that a deflection has spoiled are mended by moving nodes: connectivity, surfaces and far cells stay."""
