"""The files of a finished run that the view needs, read back; it needs no CAD and no graphics library."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self
from zipfile import BadZipFile

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.confine import DIRECTIONS
from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.settings import resolve
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.vtu import FormatError, read_vtu

SAME = 1e-8
"""A centre and its data site are no further apart (m)."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A run's case, its mesh before and after, and its centres by name (see `write_interpolants`)."""

    folder: Path
    case: Case
    mesh: TetMesh
    deflected: FloatArray
    centers: dict[str, FloatArray]

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read a run.

        Raises
        ------
        InputError
            One sentence: the folder is not that of a run, or one of its files is damaged or another run's.
        """
        if not (folder / "case.toml").is_file():
            raise InputError(f"{folder} is not the output folder of a run: it has no case.toml")
        case = resolve("", config=folder / "case.toml")
        try:
            mesh, deflected = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
        except (FormatError, ValueError) as error:
            raise InputError(f"{folder} cannot be shown: {error}; run the case again") from None
        if mesh.points.shape != deflected.points.shape or not np.array_equal(mesh.tets, deflected.tets):
            raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in points or cells")
        return cls(folder, case, mesh, deflected.points, _arrays(folder / "interpolant.npz"))

    def steps(self, tag: str) -> int:
        """Return the number of steps that the surface of this tag took."""
        later = [name for name in self.centers if name.startswith(f"centers_x{tag}_step")]
        return 1 + len(later)

    def chosen(self, sites: DataSites, suffix: str) -> IndexArray:
        """Return the rows (C,) of the sites that are the centres of this surface and step.

        Raises
        ------
        InputError
            If the file has no such centres, or they are no data sites.
        """
        centers = self.centers.get(f"centers_{DIRECTIONS[sites.components[0]]}{suffix}")
        if centers is None or centers.ndim != 2 or centers.shape[1] != 3 or not np.isfinite(centers).all():
            raise self.foreign("interpolant.npz")
        distance, rows = cKDTree(sites.points).query(centers)
        if np.any(distance > SAME) or len(np.unique(rows)) != len(rows):
            raise self.foreign("interpolant.npz")
        return np.asarray(rows, dtype=np.intp)

    def foreign(self, name: str) -> InputError:
        """Return the error that says that a file does not belong to the others."""
        return InputError(f"{self.folder}: {name} does not belong to undeflected.vtu and case.toml; run the case again")


def _arrays(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files if name.startswith("centers_")}
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; run the case again") from None
    except (OSError, ValueError, BadZipFile, AttributeError) as error:
        raise InputError(f"{path} is damaged: {error}; run the case again") from None
