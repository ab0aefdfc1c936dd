"""The mesh that `sdm_deflect.read` returns: a mesh that shows, judges and saves itself."""

from collections import Counter
from dataclasses import fields
from itertools import repeat
from os import PathLike
from pathlib import Path

from sdm_deflect.cases.run.inspection import NAMES, extent, reach
from sdm_deflect.deform.mesh.mesh import Mesh, Patch, Polyhedra
from sdm_deflect.deform.mesh.quality import POLYHEDRON, Quality, by_shape, oriented


class FileMesh(Mesh):
    """A mesh of a file: `mesh["flap"]` is a patch, and `print(mesh)` a table of patches and where they are."""

    __slots__ = ()

    @classmethod
    def of(cls, mesh: Mesh) -> "FileMesh":
        """Take a mesh as it is, without checking it again."""
        found = object.__new__(cls)
        for one in fields(mesh):
            object.__setattr__(found, one.name, getattr(mesh, one.name))
        return found

    def __getitem__(self, name: str) -> Patch:
        """Return a patch; InputError if there is none of that name, with the nearest ones."""
        return self.patch(self.named([name], "patch")[0])

    def quality(self) -> tuple[Quality, ...]:
        """Return the quality of all cells, by type."""
        signs = (oriented(self.points, block)[0] for block in self.cells)
        return by_shape(self.points, zip(self.cells, repeat(None), signs, strict=False))

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the mesh as it is, and return the path; errors as of `Result.save`."""
        from sdm_deflect.cases.api import saved

        return saved(self, self.points, path)

    def __repr__(self) -> str:
        shapes = Counter[str]()
        for block in self.cells:
            shapes[POLYHEDRON if isinstance(block, Polyhedra) else block.shape] += len(block)
        counts = "".join(f", {count} {NAMES[shape]}" for shape, count in shapes.items())
        width = max(map(len, self.names), default=0)
        rows = (
            f"{one.name:<{width}} {len(one):>9} faces{reach(extent(self.points[one.nodes]))}" for one in self.patches
        )
        return "\n".join([f"{self.name}: {len(self.points)} points{counts}", *rows])
