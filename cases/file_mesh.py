"""The mesh that `sdm_deflect.read` returns, with a table of patches, quality, motion and saving."""

import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, MeshFileError, shortened
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.cases.run.inspection import extent, reach
from sdm_deflect.deform.volume.controls import Wanted
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import PLURALS, Quality, by_shape, find_orientation
from sdm_deflect.meshing.mesh.standard import parts_of

if TYPE_CHECKING:
    from sdm_deflect.deform.mesh_motion import MeshMotion


class FileMesh(Mesh):
    """A mesh from a file: `mesh["flap"]` is a patch, and `print(mesh)` prints a table of patches and their extents."""

    __slots__ = ()

    @classmethod
    def of(cls, mesh: Mesh) -> "FileMesh":
        """Return a mesh as a `FileMesh`, without checking it again."""
        out = object.__new__(cls)
        for field in fields(mesh):
            object.__setattr__(out, field.name, getattr(mesh, field.name))
        return out

    def __getitem__(self, name: str) -> Patch:
        """Return a patch; InputError, with the most similar names, if there is none of that name."""
        return self.patch(self.expand([name], "patch")[0])

    def quality(self) -> tuple[Quality, ...]:
        """Return the quality of all cells, by type."""
        signs = (find_orientation(self.points, block)[0] for block in self.cells)
        return by_shape(self.points, zip(self.cells, repeat(None), signs, strict=False))

    def moved_by(self, plan: "MeshMotion", amounts: Wanted) -> "FileMesh":
        """Return the mesh with its nodes moved by a plan.

        Parameters
        ----------
        plan : A plan that was measured on this mesh, in any order of its nodes.
        amounts : As for `MeshMotion.at`.

        Raises InputError for an amount outside its range, or if the plan was measured on another mesh.
        """
        return self.of(self.with_points(moved_points(plan, amounts, self)))

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the mesh as it is, and return the path; errors as of `Result.save`."""
        return save_mesh(self, self.points, path)

    def __repr__(self) -> str:
        shapes = Counter[str]()
        for block in self.cells:
            for shape, _, typed, _ in parts_of(block):
                shapes[shape] += len(typed)
        counts = "".join(f", {count} {PLURALS[shape]}" for shape, count in shapes.items())
        width = max(map(len, self.names), default=0)
        rows = (
            f"{patch.name:<{width}} {len(patch):>9} faces{reach(extent(self.points[patch.nodes]))}"
            for patch in self.patches
        )
        return "\n".join([f"{self.name}: {len(self.points)} points{counts}", *rows])


def moved_points(plan: "MeshMotion", amounts: Wanted, mesh: Mesh) -> FloatArray:
    """Return the places (N, 3) to which a plan moves a mesh's nodes; InputError as for `FileMesh.moved_by`."""
    from sdm_deflect.cases.run.apply import compare_points, move

    pose, name = plan.in_order(amounts), Path(mesh.source or mesh.name)
    compare_points(plan, [(name, mesh.points, mesh.zones)])
    return move(plan, pose, name, mesh.points, mesh.zones)


def save_mesh(mesh: Mesh, points: FloatArray, path: str | PathLike[str]) -> Path:
    """Write a mesh with new points (N, 3), read it back to compare, and return its path; see `Result.save`."""
    place, lost = written(mesh, points, path)
    for text in lost:
        warnings.warn(f"{path}: {text}", stacklevel=3)
    return place


def written(
    mesh: Mesh, points: FloatArray, path: str | PathLike[str], progress: Progress = silent
) -> tuple[Path, tuple[str, ...]]:
    """Write a mesh with new points (N, 3); return path and losses, a sentence each; errors of `save_mesh`."""
    from sdm_deflect.base.files import permitted_as
    from sdm_deflect.cases.run.mesh_files import OutputFiles, check_written, write_mesh
    from sdm_deflect.cases.run.output import OutputError, output_files

    out, source = path_of(path), Path(mesh.source) if mesh.source else None
    with about_files():
        wanted = OutputFiles.of(source or out.with_name(f"no file but {out.name}.vtu"), out, ((0.0,),))
        wanted.check()
        wanted.check_names(mesh)
        try:
            with permitted_as(mesh.source), output_files(wanted.out.parent) as scratch:
                beside = scratch / wanted.out.name
                lost = write_mesh(source and wanted.source, mesh, points, beside, progress)
                check_written(mesh, points, beside, wanted.out)
                wanted.keep_tables(scratch)
        except OutputError as error:
            raise InputError(str(error)) from None
    return wanted.out, lost


def path_of(path: Any) -> Path:
    """Return a caller's argument as a path; InputError if it is no path."""
    if not isinstance(path, str | PathLike) or "\0" in str(path):
        raise InputError(f"{shortened(path)} is no path of a file or folder")
    return Path(path)


@contextmanager
def about_files() -> Iterator[None]:
    """Turn errors of mesh files and impossible paths into InputErrors."""
    try:
        yield
    except MeshFileError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{shortened(error.filename)}: {error.strerror}") from None
