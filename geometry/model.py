"""A finished CAD model for the mesher: named faces, edges and vertices, with arrays for all points."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cadquery import Compound, Edge, Face, Solid
from numpy.typing import NDArray

from .export import tessellate, write_binary_stl, write_brep, write_step, write_stl
from .parameters import FloatArray
from .projection import FreeFormSurface, PlaneSurface, curve_of, surface_of


@dataclass(frozen=True, slots=True, eq=False)
class CadFace:
    """A face of a solid; `shape` is oriented so that its normal points out of the solid."""

    shape: Face
    patch: str

    @property
    def planar(self) -> bool:
        """True on a plane."""
        return isinstance(surface_of(self.shape), PlaneSurface)

    @property
    def free_form(self) -> bool:
        """True on anything but a plane or a circular cylinder."""
        return isinstance(surface_of(self.shape), FreeFormSurface)

    @property
    def area(self) -> float:
        """Area in square metres."""
        return float(self.shape.Area())

    def normal_at(self, points: FloatArray) -> FloatArray:
        """Return unit normals (N, 3), out of the solid, at the projections of points (N, 3)."""
        return surface_of(self.shape).normals(_rows(points))

    def project(self, points: FloatArray) -> FloatArray:
        """Return nearest points (N, 3) on the underlying surface, which continues beyond the face's edges."""
        return surface_of(self.shape).nearest(_rows(points))

    def tessellation(self, deflection: float = 1e-5) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return points (N, 3) and outward triangles (T, 3) of the face to `deflection` metres; exact on a plane."""
        return tessellate(self.shape, deflection)


@dataclass(frozen=True, slots=True, eq=False)
class CadEdge:
    """An edge between exactly two exterior faces.

    Attributes
    ----------
    faces, vertices : tuple of two int
        Indices into the model's faces and vertices; the vertices in the order of the parameter.
    crease : float
        Smallest angle in degrees, along the edge, between the outward normals of its faces.
    """

    shape: Edge
    faces: tuple[int, int]
    vertices: tuple[int, int]
    crease: float

    @property
    def length(self) -> float:
        """Arc length in metres."""
        return float(self.shape.Length())

    def at(self, shares: FloatArray) -> FloatArray:
        """Return points (N, 3) at shares (N,) of the parameter range, 0 at the first vertex, 1 at the last."""
        return curve_of(self.shape).at(np.asarray(shares, dtype=np.float64))

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return nearest points (N, 3) on the edge and their parameters (N,), increasing from first to last vertex.

        On a straight edge the parameter is the distance from the first vertex.
        """
        return curve_of(self.shape).nearest(_rows(points))


@dataclass(frozen=True, slots=True, eq=False)
class CadModel:
    """A valid solid, or a compound of several; every exterior face has a patch name.

    Attributes
    ----------
    faces : tuple of CadFace
        The exterior faces, in an order that depends on the geometry alone.
    sheets : tuple of CadFace
        Internal faces behind exterior edges that are too flat for the mesher to find; they are meshed, too.
    edges : tuple of CadEdge
        All edges of the exterior faces.
    vertices : (V, 3) array
        Corners of the exterior faces.
    vertex_faces : tuple of frozenset of int
        The faces that meet at each vertex.
    fluid_inside : bool
        True if the solid is the flow volume, False if the flow is around the solid.
    """

    solid: Solid | Compound
    faces: tuple[CadFace, ...]
    sheets: tuple[CadFace, ...]
    edges: tuple[CadEdge, ...]
    vertices: FloatArray
    vertex_faces: tuple[frozenset[int], ...]
    fluid_inside: bool

    def __post_init__(self) -> None:
        if self.vertices.shape != (len(self.vertex_faces), 3):
            raise ValueError(f"vertices have shape {self.vertices.shape}, expected ({len(self.vertex_faces)}, 3)")
        if any(not 0 <= i < len(self.faces) for edge in self.edges for i in edge.faces):
            raise ValueError(f"an edge names a face outside 0 ... {len(self.faces) - 1}")

    @property
    def patches(self) -> tuple[str, ...]:
        """Patch names in the order of their first face."""
        return tuple(dict.fromkeys(face.patch for face in self.faces))

    def faces_of(self, patch: str) -> tuple[CadFace, ...]:
        """Return the faces of one patch; KeyError if there is no such patch."""
        faces = tuple(face for face in self.faces if face.patch == patch)
        if not faces:
            raise KeyError(f"no patch {patch!r}; there are {', '.join(self.patches)}")
        return faces

    def write(self, path: Path) -> None:
        """Write the solid by suffix; ValueError for any other than these, OSError if it cannot be written.

        .step has names and colours of patches on the faces, .stl is text with one named solid for each patch; .brep
        has no names.
        """
        faces = {patch: [face.shape for face in self.faces_of(patch)] for patch in self.patches}
        suffix = path.suffix.lower()
        if suffix == ".step":
            write_step(self.solid, faces, path)
        elif suffix == ".stl":
            write_stl(self.solid, faces, path)
        elif suffix == ".brep":
            write_brep((self.solid,), path)
        else:
            raise ValueError(f"{path} ends in {path.suffix!r}; it must end in .step, .brep, .stl")

    def write_binary_stl(self, path: Path) -> None:
        """Write the solid's triangles without names; OSError if the file cannot be written."""
        write_binary_stl(self.solid, {"": [face.shape for face in self.faces]}, path)

    def write_faces(self, path: Path) -> None:
        """Write faces then sheets, in order, as one .brep whose faces share their edges."""
        write_brep(tuple(face.shape for face in self.faces + self.sheets), path)


def _rows(points: FloatArray) -> FloatArray:
    """Return the points as an array (N, 3) of float64; ValueError for any other shape."""
    rows = np.asarray(points, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"points have shape {rows.shape}, expected (N, 3)")
    return rows
