"""Surface mesh deformation: the input of the volume deformation (paper appendix A).

All functions take and return displacements of nodes in metres; none knows a mesh.
"""

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, farthest, first_coincident
from sdm_deflect.deform.mesh.axis import Cylinder
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import Kernel, Multiquadric, ThinPlateSpline
from sdm_deflect.deform.rbf.problem import DataSites, joined, pinned

LINEAR = Multiquadric(1e4)  # the paper's: linear in r down to 0.1 mm
DEFAULT_PANEL = ThinPlateSpline()
SAME_POINT = 1e-9  # m
STRIP_SITES = 1500  # enough for the edge of a strip; a direct solve takes a fraction of a second


def blend(
    nodes: FloatArray, fixed: FloatArray, moved: FloatArray, moved_by: FloatArray, kernel: Kernel = LINEAR
) -> FloatArray:
    """Return displacements (N, 3) blended between points that stay and points that move: hinge and trailing edge.

    With the hinge edges fixed and the whole trailing edge of a wedge rotated, the displacement is an affine
    field and planar faces stay planar to rounding. Not so with spanwise blending: see `blend_strip`.

    Parameters
    ----------
    nodes : (N, 3) where the displacement is wanted.
    fixed, moved : (F, 3) and (M, 3) data sites; points of `moved` that coincide with fixed ones must not move.
    moved_by : (M, 3) displacements of `moved`.
    """
    sites = joined([pinned(fixed), DataSites(moved, moved_by)])
    return fit(kernel, sites.points, sites.values)(nodes)


def blend_strip(
    nodes: FloatArray, strip: NDArray[np.bool_], displacement: FloatArray, fixed: FloatArray, kernel: Kernel = LINEAR
) -> FloatArray:
    """Blend spanwise between fixed points and nodes that already know their displacement.

    The kernel is global: fitted to trailing edge and rib at once it bends the whole aileron out of plane. So
    blend chordwise first, keep that displacement beyond the strip, and let the strip alone connect it to the
    rib.

    Parameters
    ----------
    nodes : (N, 3) nodes of the surface.
    strip : (N,) True for nodes of the strip next to the rib.
    displacement : (N, 3) displacements by chordwise blending; kept, bit for bit, where `strip` is False.
    fixed : (F, 3) points that stay: hinge edges and rib, as far as they bound the strip.
    """
    if strip.all() or not strip.any():
        raise ValueError(f"{int(strip.sum())} of {len(strip)} nodes lie in the strip: some must, and some must not")
    beyond = np.flatnonzero(~strip)
    known = beyond[farthest(nodes[beyond], STRIP_SITES)]
    sites = joined([pinned(fixed), _away_from(fixed, nodes[known], displacement[known])])
    out = np.array(displacement)
    out[strip] = fit(kernel, sites.points, sites.values)(nodes[strip])
    return out


def elongate(
    nodes: FloatArray,
    inside: NDArray[np.bool_],
    root: FloatArray,
    root_by: FloatArray,
    still: FloatArray,
    kernel: Kernel = LINEAR,
) -> FloatArray:
    """Return the ways (N, k) that stretch the root of a rotated tail until its root line lies on the fuselage.

    Parameters
    ----------
    nodes : (N, 3) nodes of the rotated tail.
    inside : (N,) True for nodes of the root region; the others do not move.
    root, root_by : (M, 3) rotated nodes of the root line, and (M, k) their ways to the fuselage: displacements (k = 3),
        or lengths along given directions (k = 1), which keep planes that contain these directions planar.
    still : (F, 3) points that do not move: sites on the region's face towards the tip.
    """
    columns = root_by.shape[1]
    stretch = fit(kernel, np.vstack([root, still]), np.vstack([root_by, np.zeros((len(still), columns))]))
    out = np.zeros((len(nodes), columns))
    out[inside] = stretch(nodes[inside])
    return out


def slide_panel(
    nodes: FloatArray,
    cylinder: Cylinder,
    root: FloatArray,
    root_by: FloatArray,
    border: FloatArray,
    kernel: Kernel = DEFAULT_PANEL,
) -> FloatArray:
    """Return displacements (N, 3) of a cylindrical panel's nodes, which follow the root line and stay on it.

    Parameters
    ----------
    nodes : (N, 3) nodes of the panel.
    cylinder : The fuselage: interpolated nodes bulge and are projected radially back onto it.
    root, root_by : (M, 3) nodes of the undeflected root line and their displacements on the fuselage.
    border : (B, 3) nodes of the panel's border: they stay.
    """
    sites = joined([DataSites(root, root_by), pinned(border)])
    moved = nodes + fit(kernel, sites.points, sites.values)(nodes)
    return cylinder.projected(moved) - nodes


def _away_from(fixed: FloatArray, points: FloatArray, moved_by: FloatArray) -> DataSites:
    """Return the sites that do not coincide with fixed points: at the end of a strip the fixed ones win."""
    first = first_coincident(np.vstack([fixed, points]), SAME_POINT)[len(fixed) :]
    keep = first >= len(fixed)
    return DataSites(points[keep], moved_by[keep])
