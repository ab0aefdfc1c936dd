"""Flow solvers: cases that start as they are, the forces that they report, and how they are run."""
