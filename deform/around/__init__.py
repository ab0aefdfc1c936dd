"""Modifiers of the paper's method, one in each file."""
