"""What the nodes of a moving surface do: motions, and the formulas of the paper's appendix A."""
