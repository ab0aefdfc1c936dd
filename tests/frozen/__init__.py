"""Meshes and deflected points kept from the version before the engine was one."""
