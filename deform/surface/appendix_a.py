"""Deformation of the surface mesh: the input of the volume deformation (paper appendix A).

All functions take and return arrays, with lengths in one unit; none knows a mesh.
"""

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, farthest, first_coincident
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import Kernel, Multiquadric, ThinPlateSpline
from sdm_deflect.meshing.mesh.axis import Cylinder

# The paper's shape parameter, in 1/m: the multiquadric is linear in r down to 0.1 mm.
LINEAR = Multiquadric(1e4)
DEFAULT_PANEL = ThinPlateSpline()
# Distance (m) below which two points are one.
SAME_POINT = 1e-9
# Largest number of sites on the edge of a strip: enough for its shape, solved in less than a second.
STRIP_SITES = 1500


def blend(
    nodes: FloatArray, fixed: FloatArray, moved: FloatArray, moved_by: FloatArray, kernel: Kernel = LINEAR
) -> FloatArray:
    """Return displacements (N, 3) blended between points that stay (hinge) and points that move (trailing edge).

    If the hinge edges stay and the whole trailing edge of a wedge rotates, the displacement is affine, and plane faces
    stay plane to rounding. Spanwise blending does not have this property: see `blend_strip`.

    Parameters
    ----------
    nodes : (N, 3) nodes to move.
    fixed, moved : (F, 3) and (M, 3) data sites; where they coincide, `moved` must not move.
    moved_by : (M, 3) displacements of `moved`.
    """
    sites = join([fixed_sites(fixed), DataSites(moved, moved_by)])
    return fit(kernel, sites.points, sites.values)(nodes)


def blend_strip(
    nodes: FloatArray, strip: NDArray[np.bool_], displacement: FloatArray, fixed: FloatArray, kernel: Kernel = LINEAR
) -> FloatArray:
    """Blend spanwise between fixed points and nodes of known displacement.

    The kernel is global: fitted to the trailing edge and the rib together it bends the whole aileron. So blend
    chordwise first, keep that displacement outside the strip, and let the strip alone connect it to the rib.

    Parameters
    ----------
    nodes : (N, 3) nodes of the surface.
    strip : (N,) whether a node is in the strip next to the rib.
    displacement : (N, 3) displacements by chordwise blending; they stay exactly the same outside the strip.
    fixed : (F, 3) points that stay: the hinge edges and the rib beside the strip.
    """
    if strip.all() or not strip.any():
        raise ValueError(f"{int(strip.sum())} of {len(strip)} nodes lie in the strip: some must, and some must not")
    beyond = np.flatnonzero(~strip)
    known = beyond[farthest(nodes[beyond], STRIP_SITES)]
    sites = join([fixed_sites(fixed), _away_from(fixed, nodes[known], displacement[known])])
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
    """Return displacements (N, k) that extend the root of a rotated tail until its root line lies on the fuselage.

    Parameters
    ----------
    nodes : (N, 3) nodes of the rotated tail.
    inside : (N,) whether a node is in the root region; others do not move.
    root, root_by : (M, 3) rotated nodes of the root line, and (M, k) their displacements to the fuselage: vectors (k =
        3), or lengths along given directions (k = 1), which keep planes plane that contain these directions.
    still : (F, 3) points that stay: sites on the region's face towards the tip.
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
    """Return displacements (N, 3) of a cylindrical panel that follows the root line and stays on the cylinder.

    Parameters
    ----------
    nodes : (N, 3) nodes of the panel.
    cylinder : The fuselage; interpolated nodes are projected radially onto it.
    root, root_by : (M, 3) nodes of the undeflected root line and their displacements on the fuselage.
    border : (B, 3) nodes of the panel's border: they stay.
    """
    sites = join([DataSites(root, root_by), fixed_sites(border)])
    moved = nodes + fit(kernel, sites.points, sites.values)(nodes)
    return cylinder.projected(moved) - nodes


def _away_from(fixed: FloatArray, points: FloatArray, moved_by: FloatArray) -> DataSites:
    """Return the sites that coincide with no fixed point: at the end of a strip the fixed points count."""
    first = first_coincident(np.vstack([fixed, points]), SAME_POINT)[len(fixed) :]
    keep = first >= len(fixed)
    return DataSites(points[keep], moved_by[keep])
