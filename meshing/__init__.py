"""From named CAD to a CAD-exact tetrahedral mesh."""
