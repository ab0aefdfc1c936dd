"""The paper's test cases, end to end: geometry, mesh, deformation, validation, report."""
