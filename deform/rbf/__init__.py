"""Radial basis functions: kernels, compiled sums, fits, and the greedy choice of centres."""
