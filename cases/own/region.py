"""The part of a mesh that deforms: the box, the nodes inside, and what may not be there."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.boundary import SAME, Boundary
from sdm_deflect.cases.own.box import Scene
from sdm_deflect.deform.mesh import Mesh, Zone
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.volume.hexahedron import Hexahedron

POSES = 4  # positions between rest and the full angle that the box has to hold


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The confining hexahedron and what is in it.

    Attributes
    ----------
    hexahedron, why : the box and the reason for its shape.
    inside : (M,) sorted indices of the nodes inside, in the zones that deform.
    zones : names of those zones.
    """

    hexahedron: Hexahedron
    why: str
    inside: IndexArray = field(repr=False)
    zones: tuple[str, ...]

    @classmethod
    def of(cls, boundary: Boundary, angles: tuple[float, ...]) -> "Region":
        """Confine the motion to all `angles`.

        Raises
        ------
        InputError
            If a moving node leaves the box, or the box contains nodes of a patch that is not declared, or cuts a
            zone from one that fits to it.
        """
        subject, ends = boundary.subject, (min(angles), max(angles))
        zones = _zones(boundary)
        choice = boundary.job.box.choose(_scene(boundary, zones, ends))
        inside = _inside(subject, zones, choice.hexahedron)
        region = cls(choice.hexahedron, choice.why, inside, tuple(zone.name for zone in zones))
        _check_moving(boundary, region, ends)
        _check_clear(boundary, region)
        _check_interfaces(boundary, region, zones)
        return region


def _zones(boundary: Boundary) -> tuple[Zone, ...]:
    """Return the zones that hold moving nodes, and those that the job adds."""
    subject, wanted = boundary.subject, boundary.job.zones
    names = [zone.name for zone in subject.zones]
    for name in wanted:
        if name not in (*names, "*"):
            raise InputError(f"{subject.name}: --zone {name!r} is no zone; the zones are {', '.join(names)}")

    def moves(zone: Zone) -> bool:
        first, end = np.searchsorted(boundary.nodes, (zone.start, zone.stop))
        return bool(end > first)

    return tuple(z for z in subject.zones if moves(z) or z.name in wanted or "*" in wanted)


def _inside(subject: Mesh, zones: tuple[Zone, ...], hexahedron: Hexahedron) -> IndexArray:
    parts = [
        zone.start + np.flatnonzero(hexahedron.contains(subject.points[zone.start : zone.stop])) for zone in zones
    ]
    return np.concatenate(parts)


def _scene(boundary: Boundary, zones: tuple[Zone, ...], angles: tuple[float, ...]) -> Scene:
    subject = boundary.subject
    moving = subject.points[boundary.nodes]
    shares = np.linspace(0.0, 1.0, POSES + 1)[1:]
    moves = [boundary.displacement(angle * share) for angle in set(angles) for share in shares]
    largest = max(float(np.linalg.norm(move, axis=1).max()) for move in moves)
    axes = [moving.motion.axis for moving in boundary.job.surfaces if moving.motion.axis is not None]
    others = [name for name in subject.names if name not in boundary.declared]
    nodes = _of_zones(subject.on(*others), zones)
    return Scene(
        moving, np.vstack([moving + move for move in moves]), largest, axes[0] if axes else None, subject.points[nodes]
    )


def _of_zones(nodes: IndexArray, zones: tuple[Zone, ...]) -> IndexArray:
    return np.concatenate([nodes[(nodes >= zone.start) & (nodes < zone.stop)] for zone in zones])


def _check_moving(boundary: Boundary, region: Region, angles: tuple[float, ...]) -> None:
    """Raise if a node that moves starts or ends outside."""
    tol = SAME * boundary.size
    start = boundary.subject.points[boundary.nodes]
    for angle in sorted(set(angles)):
        move = boundary.displacement(angle)
        moves = np.abs(move).max(axis=1) > tol
        both = [region.hexahedron.contains(places[moves], tol) for places in (start, start + move)]
        out = int(np.count_nonzero(~(both[0] & both[1])))
        if out:
            names = ", ".join(name for surface in boundary.surfaces for name in surface.patches)
            raise InputError(
                f"{boundary.subject.name}: {out} of {int(moves.sum())} moving nodes of {names} cross the box at "
                f"{angle:g}; enlarge it"
            )


def _check_clear(boundary: Boundary, region: Region) -> None:
    """Raise if the box contains nodes of a patch that is neither moving, fixed nor sliding."""
    subject, tol = boundary.subject, SAME * boundary.size
    for patch in subject.patches:
        name, nodes = patch.name, patch.nodes
        if name in boundary.declared:
            continue
        own = np.intersect1d(nodes, region.inside, assume_unique=True)
        within = own[region.hexahedron.contains(subject.points[own], -tol)]
        shared = np.intersect1d(nodes, boundary.nodes, assume_unique=True)
        if len(within) or len(shared):
            raise InputError(
                f"{subject.name}: the box contains {len(within)} of {len(nodes)} nodes of {name}"
                + (f" ({len(shared)} shared with the moving surface)" if len(shared) else "")
                + f"; name it in --fixed {name} or --slide {name}:plane, or take a smaller box"
            )


def _check_interfaces(boundary: Boundary, region: Region, zones: tuple[Zone, ...]) -> None:
    """Raise if nodes of a zone that stays coincide with nodes inside: zones that fit must deform together."""
    subject, tol = boundary.subject, SAME * boundary.size
    others = [zone for zone in subject.zones if zone not in zones]
    known = np.union1d(boundary.nodes, boundary.still)
    free = np.setdiff1d(region.inside, known, assume_unique=True)
    for zone in others:
        near = _inside(subject, (zone,), region.hexahedron)
        if len(near) and len(free):
            gap, _ = cKDTree(subject.points[near]).query(subject.points[free], distance_upper_bound=tol)
            count = int(np.isfinite(gap).sum())
            if count:
                raise InputError(
                    f"{subject.name}: {count} nodes inside the box coincide with nodes of zone {zone.name}, which "
                    f"would stay behind; add --zone {zone.name}"
                )
