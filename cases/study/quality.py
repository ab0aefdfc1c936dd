"""What the paper reads off its quality histograms, judged on our meshes."""


from sdm_deflect.cases.run import Run
from sdm_deflect.cases.study.paper import QualityStatement
from sdm_deflect.cases.study.trend import Finding
from sdm_deflect.meshing.quality import mean_ratio

VISIBLE = 3e-4
"""A histogram is as before if at most this share of all cells is new below the limit: a hundredth of the height of its
highest bars, which hold some 3 % of the cells each. Less is not visible."""


def said(theirs: QualityStatement) -> str:
    """Return the paper's statement as a sentence."""
    if theirs.finding == "none":
        return f"At {theirs.angle:+g}° the deformed mesh has no cell below {theirs.below:g}."
    return f"At {theirs.angle:+g}° no deterioration is visible below {theirs.below:g}."


def judged(theirs: QualityStatement, run: Run) -> Finding:
    """Count the cells below the mean ratio that the paper names, before and after."""
    before, after = (mean_ratio(mesh.points, mesh.tets) for mesh in (run.mesh, run.deflected))
    region = run.deflections[0].turn.region
    near = run.mesh.touching(region.inside)
    old, new = before < theirs.below, after < theirs.below
    holds = not new.any() if theirs.finding == "none" else new.sum() - old.sum() <= VISIBLE * len(new)
    return Finding(
        bool(holds),
        f"{old.sum()} of {len(old)} cells below {theirs.below:g} before, {new.sum()} after; of the {near.sum()} cells "
        f"that touch the hexahedron, {old[near].sum()} before, {new[near].sum()} after, the smallest "
        f"{before[near].min():.3f} before, {after[near].min():.3f} after",
    )
