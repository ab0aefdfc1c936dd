"""From named CAD to a CAD-exact tetrahedral mesh; `generation` is the way in."""
