"""SU2 files of which the cells are never all in memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh
from sdm_deflect.meshing.formats.shapes import left_handed, loose_faces, mirrored, refuse_loose, stride
from sdm_deflect.meshing.formats.su2_read import SOLIDS, Section, Su2File, only, patches_of, points_of, zones_of
from sdm_deflect.meshing.formats.zones import joined
from sdm_deflect.meshing.mesh import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """A mesh of one zone in space; its cells are read from the open file each time that they are asked for.

    Parameters
    ----------
    mesh : The mesh that `read_zones` returns, but without its cells.
    counts : Number of cells of each shape, in the order in which shapes first appear.
    mirrored : Shapes whose cells the file has as mirror images of VTK's.
    """

    source: Su2File = field(repr=False)
    section: Section = field(repr=False)
    mesh: Mesh
    counts: dict[str, int]
    mirrored: frozenset[str]

    def cells(self) -> Iterator[Cells]:
        """Yield blocks of some cells of one shape, in VTK's order of nodes; the order within a shape is the file's."""
        for block in _cells(self.source, self.section, len(self.mesh.points)):
            turned = block.shape in self.mirrored
            yield Cells(block.shape, mirrored(block.shape, block.nodes)) if turned else block


@dataclass(slots=True, eq=False)
class _Sample:
    """Each first of `step` cells of one shape as they pass by; `step` doubles as `stride` does."""

    count: int = 0
    step: int = 1
    kept: list[IntArray] = field(default_factory=list)

    def add(self, nodes: IntArray) -> None:
        self.kept.append(nodes[-self.count % self.step :: self.step].copy())
        self.count += len(nodes)
        if self.step < stride(self.count):
            self.kept = [np.concatenate(self.kept)[:: stride(self.count) // self.step]]
            self.step = stride(self.count)


def in_pieces(source: Su2File) -> Pieces | None:
    """Return the mesh of an open file after one pass through its cells; None if it has several zones, or is plane.

    Errors are those of `read_zones`.
    """
    zones = zones_of(source.sections)
    if source.dimension != 3 or len(zones) > 1:
        return None
    (own,) = zones.values()
    section = only(own, "NELEM")
    points = points_of(source, only(own, "NPOIN"))
    mesh = joined(list(zones), [Mesh(points, (), patches_of(source, own, len(points)))])
    samples: dict[str, _Sample] = {}
    cells = _sampled(_cells(source, section, len(points)), samples)
    loose = loose_faces(mesh, cells)
    deque(cells, maxlen=0)  # `loose_faces` stops at the last boundary face
    refuse_loose(mesh, sum(sample.count for sample in samples.values()), loose)
    turned = [name for name, own in samples.items() if left_handed(points, name, np.concatenate(own.kept))]
    return Pieces(source, section, mesh, {name: own.count for name, own in samples.items()}, frozenset(turned))


def _cells(source: Su2File, section: Section, points: int) -> Iterator[Cells]:
    for shape, nodes in source.elements(section, SOLIDS, points):
        yield Cells(shape, nodes)


def _sampled(cells: Iterator[Cells], samples: dict[str, _Sample]) -> Iterator[Cells]:
    """Pass on cells, of which some are kept by shape."""
    for block in cells:
        samples.setdefault(block.shape, _Sample()).add(block.nodes)
        yield block
