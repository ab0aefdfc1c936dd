"""An all-moving tail whose root stays on a body: a cylinder as in appendix A, or a skin of any shape.

A panel of the body follows the root.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, farthest
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.hexahedron import Hexahedron, box
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join
from sdm_deflect.deform.rbf.interpolant import Interpolant, fit
from sdm_deflect.deform.rbf.kernels import Multiquadric, ThinPlateSpline
from sdm_deflect.meshing.mesh.axis import Axis, Cylinder
from sdm_deflect.meshing.mesh.edges import area_vectors, polygons_of, unit
from sdm_deflect.meshing.mesh.mesh import REGION, Mesh
from sdm_deflect.meshing.mesh.sliding import CylinderWall

from .appendix_a import elongate, slide_panel
from .motions import Functions, Hinged, Powers, Smooth
from .surface import Surface

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.selection import Part

# Reach of the panel beyond the root, and depth of the lengthened part of a tail, in chords of the root.
CHORDS = 0.5
# Share of the largest singular value of a tail's normals, below which its planes have one direction in common.
PARALLEL = 1e-4
# Cosine between a normal and the hinge, above which a face is the tail's tip.
ACROSS = 0.7
# Least cosine between the mean normal at the root and that of a face: for the skin's spline, and for the panel.
SKIN, PANEL = 0.5, 0.7
# Largest number of nodes of a skin in its spline; larger sets are thinned.
MOST_SITES = 3000
# Number of powers of the angle for displacements up to 15 degrees; they miss by 0.014 of the usual tolerance.
POWERS = 6
# Angle in degrees at which these powers are 1.
SCALE = 15.0


@dataclass(frozen=True, slots=True, eq=False)
class Root(Hinged):
    """Rotation of a tail whose root slides on the skin of a body.

    The panel, all faces of the skin near the root, becomes a patch of its own and follows the root.

    Attributes
    ----------
    hinge : the axis of rotation.
    tail : name or wildcard of the tail's patch.
    on : names or wildcards of the body's patches.
    shape : ``"skin"`` for a body of any shape, ``"cylinder"`` for a circular one as in appendix A.
    depth : length of the part of the tail that is lengthened; 0 for half a chord of the root.
    width : distance from the root up to which the panel reaches, in chords of the root.
    """

    hinge: Axis
    tail: str
    on: tuple[str, ...]
    shape: str = "skin"
    depth: float = 0.0
    width: float = CHORDS

    @property
    def panels(self) -> str:
        """Wildcard of the panels' names."""
        return f"*{REGION}{self.tail}"

    def cut(self, mesh: Mesh) -> Mesh:
        """Return the mesh with the panel of each of the body's patches as a patch ``BODY~TAIL``.

        Raises InputError if tail and body share no node, or if the panel is a whole patch.
        """
        from sdm_deflect.meshing.mesh.selection import with_parts

        names = mesh.expand(self.on, "on")
        root = np.intersect1d(mesh.on(*mesh.expand([self.tail], "the surface")), mesh.on(*names))
        if not len(root):
            raise InputError(f"{mesh.name}: {self.tail} shares no node with {', '.join(names)}, on which it turns")
        panels = dict(zip(names, self._around(mesh, names, root, self.width, PANEL), strict=True))
        if whole := [name for name, panel in panels.items() if len(panel) == len(mesh.patch(name))]:
            raise InputError(f"{mesh.name}: all of {whole[0]} is near {self.tail}: join it with the patches around it")
        cut = with_parts(mesh, {name: [panel] for name, panel in panels.items() if len(panel)})
        of = {panel.name: name for name, panel in panels.items()}
        return replace(
            cut, patches=tuple(replace(patch, part_of=of.get(patch.name, patch.part_of)) for patch in cut.patches)
        )

    def _around(
        self, mesh: Mesh, names: Sequence[str], root: IntArray, chords: float, cosine: float
    ) -> "Iterator[Part]":
        """Yield the faces of patches within some chords of the root, turned little from the mean normal at it."""
        from sdm_deflect.meshing.mesh.selection import Part

        ends, faces = mesh.points[root], polygons_of(mesh.faces_of(names))
        low, high, reach = ends.min(axis=0), ends.max(axis=0), chords * np.ptp(ends, axis=0).max()
        at_root = np.logical_or.reduceat(np.isin(faces.nodes, root), faces.offsets[:-1])
        normal = area_vectors(mesh.points, faces)[at_root].sum(axis=0)
        for name in names:
            part = Part.of(mesh, mesh.patch(name))
            vectors, near = area_vectors(mesh.points, part.faces), np.abs(part.centres - 0.5 * (low + high))
            turned = vectors @ normal > cosine * np.linalg.norm(vectors, axis=1) * np.linalg.norm(normal)
            inside = (near <= 0.5 * (high - low) + reach).all(axis=1)
            yield part.some(np.flatnonzero(inside & turned), f"{name}{self.panels[1:]}")

    def law(self, surface: Surface) -> "RootLaw | SkinLaw":
        """Find the shape of the body, and the nodes of tail, root line, panel and the panel's border."""
        mesh, panels = surface.mesh, tuple(name for name in surface.patches if name.endswith(self.panels[1:]))
        tail, panel, border = _parts(surface, panels)
        root, body = surface.nodes[tail & panel], (*panels, *mesh.expand(self.on, "on"))
        skin = [part.faces.nodes for part in self._around(mesh, body, root, 2.0 * self.width, SKIN)]
        sites = mesh.points[distinct(np.concatenate(skin))]
        if not len(sites):
            raise InputError(
                f"{mesh.name}: motion = root: of {', '.join(self.on)} no skin around the root of {self.tail} looks its "
                "way: the tail must stand on the body"
            )
        depth = self.depth or CHORDS * float(np.ptp(mesh.points[root], axis=0).max())
        if self.shape == "cylinder":
            room = box(surface.points.min(axis=0) - depth, surface.points.max(axis=0) + depth)
            cylinder, apex = CylinderWall.fitted(sites).cylinder, self._apex(surface, panels)
            return RootOnCylinder(self.hinge, cylinder, apex, panels, room, depth).law(surface)
        sites = sites[farthest(sites, MOST_SITES)] if len(sites) > MOST_SITES else sites
        stations = (sites - self.hinge.point) @ self.hinge.direction
        height = _spline(sites - np.outer(stations, self.hinge.direction), stations[:, None])
        return SkinLaw(self.hinge, depth, surface.points, tail, panel, panel & ~tail & border, height)

    def _apex(self, surface: Surface, panels: Sequence[str]) -> FloatArray:
        """Return the point (3,) nearest to the planes of the tail's faces, without those across the hinge.

        Planes that are all parallel to one line meet far away on it.
        """
        faces = polygons_of(surface.mesh.faces_of([name for name in surface.patches if name not in panels]))
        normals = unit(area_vectors(surface.mesh.points, faces))
        side = np.abs(normals @ self.hinge.direction) < ACROSS
        middle = surface.points.mean(axis=0)
        heights = np.sum(normals * (surface.mesh.points[faces.nodes[faces.offsets[:-1]]] - middle), axis=1)
        _, strength, directions = np.linalg.svd(normals[side], full_matrices=False)
        if strength[-1] < PARALLEL * strength[0]:
            return np.asarray(middle + directions[-1] * np.ptp(surface.points, axis=0).max() / PARALLEL)
        return np.asarray(middle + np.linalg.lstsq(normals[side], heights[side])[0])


def _spline(feet: FloatArray, values: FloatArray) -> Interpolant:
    """Return the thin plate spline through values (K, k) at points (K, 3) of the plane across the hinge."""
    try:
        return fit(ThinPlateSpline(), feet, values)
    except ValueError:
        raise InputError(
            "motion = root: the skin near the root is no height over the plane across the hinge: give a smaller panel, "
            "or fewer patches in `on`"
        ) from None


def _parts(surface: Surface, panels: Sequence[str]) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Return which nodes (K,) are on the tail, on its panels, and on patches other than panels."""
    tail = surface.on([name for name in surface.patches if name not in panels])
    return tail, surface.on(panels), surface.on([name for name in surface.mesh.names if name not in panels])


@dataclass(frozen=True, slots=True, eq=False)
class SkinLaw(Smooth):
    """The motion of points (K, 3) on a skin: masks (K,) of the tail, its panel, and the panel's nodes that stay.

    The skin is a height along the hinge over the plane across it, a thin plate spline through the body's nodes. A
    node of the tail turns, and moves along the hinge by the change of height below it. That fades over `depth`. A node
    of the panel moves in the plane by a spline between the root line and the border, and then back to the skin.
    """

    hinge: Axis
    depth: float
    points: FloatArray = field(repr=False)
    tail: BoolArray = field(repr=False)
    panel: BoolArray = field(repr=False)
    stays: BoolArray = field(repr=False)
    skin: Interpolant = field(repr=False)

    @property
    def exact(self) -> BoolArray:
        """Nodes (K,) of the tail."""
        return self.tail

    @property
    def beyond_root(self) -> BoolArray:
        """Nodes (K,) of the tail beyond the part that is lengthened."""
        return self.tail & (np.abs(self._above(self.points)) >= self.depth)

    @property
    def functions(self) -> Functions:
        """Powers of the angle, as for `RootLaw`."""
        return Powers(POWERS, SCALE)

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3)."""
        out, turn = np.zeros_like(self.points), self.hinge.displacement(self.points, amount)
        tail, turned = self.points[self.tail], turn[self.tail]
        share = np.clip(1.0 - np.abs(self._above(tail)) / self.depth, 0.0, 1.0)[:, None]
        out[self.tail] = turned + share**2 * (3.0 - 2.0 * share) * self._onto(tail, turned)
        root, follow = self.tail & self.panel, self.panel & ~self.tail & ~self.stays
        moved = DataSites(self._flat(self.points[root]), turn[root])
        sites = join([moved, fixed_sites(self._flat(self.points[self.stays]))])
        flat = _spline(sites.points, sites.values)(self._flat(self.points[follow]))
        out[follow] = flat + self._onto(self.points[follow], flat)
        return out

    def _flat(self, points: FloatArray) -> FloatArray:
        """Return the feet of points (N, 3) in the plane through the hinge's point across it."""
        return np.asarray(points - np.outer((points - self.hinge.point) @ self.hinge.direction, self.hinge.direction))

    def _above(self, points: FloatArray) -> FloatArray:
        """Return the distance (N,) of points (N, 3) from the skin along the hinge."""
        return np.asarray((points - self.hinge.point) @ self.hinge.direction - self.skin(self._flat(points))[:, 0])

    def _onto(self, points: FloatArray, flat: FloatArray) -> FloatArray:
        """Return the change (N, 3) of the skin's height below points (N, 3) that move across the hinge by `flat`."""
        feet = self._flat(points)
        return np.asarray((self.skin(feet + flat) - self.skin(feet)) * self.hinge.direction)


@dataclass(frozen=True, slots=True, eq=False)
class RootOnCylinder(Hinged):
    """Rotation of a tail whose root line slides on a cylinder, with the panel around the root.

    All planes of the tail meet in the apex of its trapezoid. A node that slides along its ray to the rotated apex stays
    in its planes. So the root line slides along rays until it meets the cylinder, and a multiquadric of the sliding
    distance extends the root region. (The paper interpolates the displacement vector, which leaves the planes
    slightly.) The panel follows by thin plate splines between root line and border, projected radially onto the
    cylinder.

    Attributes
    ----------
    hinge : the axis of rotation.
    cylinder : the body.
    apex : (3,) point where the tail's planes meet.
    panel : patches of the body that follow; the other patches of the surface rotate.
    within : hexahedron outside which panel nodes stay; so do nodes that would leave it.
    depth : length of the extended root region, outboard of the root line.
    epsilon : shape parameter of the multiquadric, 1/length.
    """

    hinge: Axis
    cylinder: Cylinder
    apex: FloatArray
    panel: tuple[str, ...]
    within: Hexahedron = field(repr=False)
    depth: float
    epsilon: float = 1e4

    def law(self, surface: Surface) -> "RootLaw":
        """Find the nodes of tail, root line, panel and the panel's border."""
        tail, panel, border = _parts(surface, self.panel)
        stays = panel & ~tail & (border | ~self.within.contains(surface.points))
        if not (tail & panel).any():
            raise InputError(f"{surface.label}: the surface and its panel share no node")
        return RootLaw(self, surface.points, tail, panel, stays)


@dataclass(frozen=True, slots=True, eq=False)
class RootLaw:
    """The motion of points (K, 3): masks (K,) of the tail, its panel, and the panel's nodes that stay.

    The root region and the nodes that stay are chosen for each amount, unless `chosen_at` fixes them.
    """

    motion: RootOnCylinder
    points: FloatArray = field(repr=False)
    tail: BoolArray = field(repr=False)
    panel: BoolArray = field(repr=False)
    stays: BoolArray = field(repr=False)
    chosen_at: float | None = None

    @property
    def exact(self) -> BoolArray:
        """Nodes (K,) of the tail."""
        return self.tail

    @property
    def beyond_root(self) -> BoolArray:
        """Nodes (K,) of the tail outboard of the extended region."""
        beyond = self.tail.copy()
        beyond[self.tail] = ~self._region(0.0).inside
        return beyond

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3).

        Raises InputError if the tail turns so far that a ray of its root misses the cylinder.
        """
        chosen_at = amount if self.chosen_at is None else self.chosen_at
        region = self._region(chosen_at)
        return self._displacement(amount, region, self._staying(chosen_at, region))

    @property
    def functions(self) -> Functions:
        """Powers of the angle: the root slides, so sine and cosine are not enough."""
        return Powers(POWERS, SCALE)

    def frozen_at(self, amount: float) -> "RootLaw":
        """Return the law with the root region and the staying nodes of an amount."""
        return replace(self, chosen_at=amount)

    def _region(self, amount: float) -> "RootRegion":
        rotated = self.motion.hinge.rotated(self.points[self.tail], amount)
        across = int(np.argmax(np.abs(self.motion.hinge.direction)))
        return RootRegion.of(rotated, rotated[self.panel[self.tail]], self.motion.depth, across)

    def _staying(self, amount: float, region: "RootRegion") -> BoolArray:
        """Return the panel's nodes (K,) that stay, including those that would leave the hexahedron."""
        stays, within = self.stays, self.motion.within
        while True:
            follow = self.panel & ~self.tail & ~stays
            places = self.points[follow] + self._displacement(amount, region, stays)[follow]
            leaving = ~within.contains(places)
            if not leaving.any():
                return stays
            stays = stays.copy()
            stays[np.flatnonzero(follow)[leaving]] = True

    def _displacement(self, amount: float, region: "RootRegion", stays: BoolArray) -> FloatArray:
        motion, out = self.motion, np.zeros_like(self.points)
        rotated = motion.hinge.rotated(self.points[self.tail], amount)
        apex = motion.hinge.rotated(motion.apex[None], amount)[0]
        root = self.panel[self.tail]
        out[self.tail] = rotated + _extension(motion, rotated, root, apex, region) - self.points[self.tail]
        both = self.tail & self.panel
        follow = self.panel & ~both & ~stays
        values = slide_panel(self.points[self.panel], motion.cylinder, self.points[both], out[both], self.points[stays])
        out[follow] = values[follow[self.panel]]
        return out


class RootRegion(NamedTuple):
    """Tail nodes (T,) that are extended, and points (F, 3) outboard that stay."""

    inside: BoolArray
    still: FloatArray

    @classmethod
    def of(cls, rotated: FloatArray, root: FloatArray, depth: float, across: int = 1) -> "RootRegion":
        """Take the nodes (T, 3) of a rotated tail within `depth` of its root nodes (R, 3).

        `across` is the axis, 0 to 2, along which its tip lies.
        """
        low, high = _ends(root, depth)
        outwards = rotated[:, across].mean() > root[:, across].mean()
        region, tip = box(low, high), f"{'xyz'[across]}{'+' if outwards else '-'}"
        return cls(region.contains(rotated), (region.sites_on(tip, 0.25 * depth) - low) / (high - low))


def root_on(cylinder: Cylinder, root: FloatArray, rays: FloatArray) -> FloatArray:
    """Return where the rays (R, 3) of the root nodes (R, 3) meet the cylinder; InputError if one misses it."""
    try:
        return cylinder.projected_along(root, rays)
    except ValueError as error:
        raise InputError(f"the tail turns so far that its root leaves the fuselage: {error}; turn it less") from None


def _ends(root: FloatArray, depth: float) -> tuple[FloatArray, FloatArray]:
    return root.min(axis=0) - depth, root.max(axis=0) + depth


def _extension(
    motion: RootOnCylinder, rotated: FloatArray, root: BoolArray, apex: FloatArray, region: RootRegion
) -> FloatArray:
    """Return the displacement (T, 3) that extends the rotated tail (T, 3) onto the cylinder along rays to its apex.

    The root nodes slide until they meet the cylinder. Nodes within `depth` outboard slide by a multiquadric of that
    distance, which is zero at the region's end towards the tip.
    """
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    onto = root_on(motion.cylinder, rotated[root], rays[root]) - rotated[root]
    distances = np.einsum("ij,ij->i", onto, rays[root])[:, None]
    low, high = _ends(rotated[root], motion.depth)
    still, kernel = low + region.still * (high - low), Multiquadric(motion.epsilon)
    extension = elongate(rotated, region.inside, rotated[root], distances, still, kernel) * rays
    extension[root] = onto
    return np.asarray(extension)
