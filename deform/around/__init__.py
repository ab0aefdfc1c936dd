"""Modifiers to the paper's method, one in each file."""
