"""The aircraft's cases: their settings, what they ask of the engine, and the CAD that judges the result."""
