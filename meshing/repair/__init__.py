"""Repair of cells spoiled by a deflection: nodes move; connectivity, surfaces and far cells stay."""
