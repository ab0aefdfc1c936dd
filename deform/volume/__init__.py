"""The volume around a moving surface: box, sites, steps, deflections."""
