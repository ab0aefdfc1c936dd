"""What the paper reads off its quality histograms, judged on our meshes."""

import numpy as np

from cases.run import Run
from cases.study.paper import QualityStatement
from cases.study.trend import Finding
from meshing.quality import mean_ratio

VISIBLE = 1.05
"""A histogram is as before if the number of cells grew by less than this factor: less is not visible."""


def said(theirs: QualityStatement) -> str:
    """Return the paper's statement as a sentence."""
    if theirs.finding == "none":
        return f"At {theirs.angle:+g}° the deformed mesh has no cell below {theirs.below:g}."
    return f"At {theirs.angle:+g}° no deterioration is visible below {theirs.below:g}."


def judged(theirs: QualityStatement, run: Run) -> Finding:
    """Count the cells below the mean ratio that the paper names, before and after."""
    before, after = (mean_ratio(mesh.points, mesh.tets) for mesh in (run.mesh, run.deflected))
    counts = [int(np.count_nonzero(quality < theirs.below)) for quality in (before, after)]
    holds = counts[1] == 0 if theirs.finding == "none" else counts[1] <= VISIBLE * counts[0]
    return Finding(
        holds,
        f"{counts[0]} of {len(before)} cells below {theirs.below:g} before, {counts[1]} after; "
        f"smallest {before.min():.3f} before, {after.min():.3f} after",
    )
