"""The aircraft's cases: settings, jobs for the engine, and validation against CAD."""
