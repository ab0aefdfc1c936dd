"""Motions of a surface's nodes, and the formulas of the paper's appendix A."""
