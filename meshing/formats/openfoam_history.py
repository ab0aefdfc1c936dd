"""OpenFOAM cases of a mesh that moves: points and face sweeps of each time, as a solver on moving meshes writes them.

A time has a folder of its own. ``polyMesh/points`` in it are the points; ``meshPhi`` is the volume that each face
sweeps from the time before, over the time that this takes; ``V0`` are the volumes of the cells at the time before.
OpenFOAM reads both where it starts from such a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Polyhedra
from sdm_deflect.deform.mesh.polyhedra import pyramids_of
from sdm_deflect.deform.mesh.swept import Swept
from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.formats.openfoam import OpenFoam, case_folder, has_parts, mesh_folder
from sdm_deflect.meshing.formats.openfoam_files import MESH, FoamPatch, open_foam, parse, vectors
from sdm_deflect.meshing.formats.openfoam_write import SCALAR, control, header, write_list

DIGITS, MOST_DIGITS = 6, 17
"""Digits of a time in the name of its folder unless ``timePrecision`` says otherwise, and those that tell any two."""
EXACT = 1e-12
"""Share of a step by which the name of a time may be off."""
POINTS = "points"
OWN_KIND = (
    "empty", "wedge", "symmetry", "symmetryPlane", "cyclic", "cyclicSlip", "cyclicAMI", "cyclicACMI",
    "cyclicPeriodicAMI", "nonuniformTransformCyclic", "overset",
)  # fmt: skip
"""Types of patches on which every field has that type, too; on all others what is not given is ``calculated``."""


@dataclass(frozen=True, slots=True)
class Times:
    """Rising times, and the names of their folders.

    Attributes
    ----------
    values : (T,) the times, s, as their names say them.
    digits : how many the names have at most: so many that each is right to `EXACT` of the shortest step.
    """

    values: tuple[float, ...]
    digits: int = field(init=False)

    def __post_init__(self) -> None:
        given, step = np.array(self.values), min(np.diff(self.values))
        for digits in range(DIGITS, MOST_DIGITS + 1):
            named = [float(f"{value:.{digits}g}") for value in self.values]
            if np.abs(named - given).max() <= EXACT * step:
                break
        object.__setattr__(self, "values", tuple(value + 0.0 for value in named))  # -0 is called 0
        object.__setattr__(self, "digits", digits)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the folder of each time, as OpenFOAM writes it."""
        return tuple(f"{value:.{self.digits}g}" for value in self.values)

    @property
    def control(self) -> str:
        """The content of a ``controlDict`` with these times; its step is their shortest."""
        names, step = self.names, min(np.diff(self.values))
        return control(
            application="pimpleFoam", startTime=names[0], endTime=names[-1], deltaT=f"{step:.12g}", writeInterval=1,
            purgeWrite=None, timeFormat="general", timePrecision=self.digits, runTimeModifiable="false",
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Balance:
    """How well the face sweeps of one time add up; see `Swept`.

    Attributes
    ----------
    cells : number of cells with a node that moves.
    gap, gap_of_volume : the largest gaps of any of them, as shares.
    """

    cells: int
    gap: float
    gap_of_volume: float


def check_source(path: Path) -> None:
    """Refuse a case to which no history can be added, with a MeshFileError."""
    if has_parts(path):
        raise MeshFileError(
            f"{path}: a history needs the mesh of the whole, and this names the parts of a decomposed case; put them "
            "together with reconstructParMesh -constant"
        )
    case = case_folder(path)
    if mesh_folder(path) != case / MESH:
        raise MeshFileError(f"{path}: is the mesh of a case; name the folder of the case for a history")
    for folder in sorted(one for one in case.iterdir() if _is_time(one)):
        if (folder / MESH.name).exists() or (folder / "meshPhi").exists():
            raise MeshFileError(f"{path}: has a mesh that moves in {folder.name} already; name a case without one")


def write_points(case: Path, name: str, points: FloatArray) -> None:
    """Write the points (N, 3) of a time."""
    folder = case / name / MESH.name
    folder.mkdir(parents=True)
    write_list(folder / POINTS, "vectorField", [points.astype(SCALAR)], location=f"{name}/{MESH.name}")


def read_points(case: Path, name: str) -> FloatArray:
    """Return the points (N, 3) of a time."""
    folder = case / name / MESH.name
    with about(folder / POINTS):
        return vectors(open_foam(folder, POINTS)).values


def write_face_sweeps(case: Path, times: Times, progress: Progress = silent) -> tuple[Balance, ...]:
    """Write the face sweeps and old volumes of all times but the first into a case with the points of each.

    Returns how well they add up. No more than the points of two times are in memory.
    """
    cells, patches = _faces_of(case)
    names, values = times.names, times.values
    after = read_points(case, names[0])
    volumes = pyramids_of(after, cells).volume
    found = []
    for i in range(1, len(names)):
        progress(f"time {names[i]}", i / len(names))
        before, after = after, read_points(case, names[i])
        swept = Swept.of(cells, before, after)
        _write_fluxes(case / names[i], swept.faces / (values[i] - values[i - 1]), len(cells.neighbour), patches)
        _write_volumes(case / names[i], volumes)
        volumes[swept.rows] = swept.volumes
        found.append(Balance(len(swept.rows), swept.gap, swept.gap_of_volume))
    return tuple(found)


def _is_time(path: Path) -> bool:
    try:
        return path.is_dir() and float(path.name) is not None
    except ValueError:
        return False


def _faces_of(case: Path) -> tuple[Polyhedra, list[FoamPatch]]:
    """The cells of a case as its files have them, and its patches."""
    (cells,) = OpenFoam().read(case).cells
    assert isinstance(cells, Polyhedra)
    with about(case / MESH / "boundary"):
        return cells, parse(open_foam(case / MESH, "boundary").text())


def _write_fluxes(folder: Path, values: FloatArray, inner: int, patches: Sequence[FoamPatch]) -> None:
    """Write values (F,) of all faces as a field: those inside, then those of each patch."""
    with (folder / "meshPhi").open("wb") as file:
        file.write(header("surfaceScalarField", "meshPhi", folder.name, "binary").encode())
        file.write(b"dimensions [0 3 -1 0 0 0 0];\n\ninternalField ")
        file.writelines((*_listed(values[:inner]), b";\n\nboundaryField\n{\n"))
        for patch in patches:
            kind = patch.type if patch.type in OWN_KIND else "calculated"
            own = values[patch.start : patch.start + (0 if kind == "empty" else patch.count)]
            file.write(f"    {patch.name}\n    {{\n        type {kind};\n        value ".encode())
            file.writelines((*_listed(own), b";\n    }\n"))
        file.write(b"}\n")


def _write_volumes(folder: Path, volumes: FloatArray) -> None:
    with (folder / "V0").open("wb") as file:
        file.write(header("volScalarField::Internal", "V0", folder.name, "binary").encode())
        file.write(b"dimensions [0 3 0 0 0 0 0];\n\nvalue ")
        file.writelines((*_listed(volumes), b";\n"))


def _listed(values: FloatArray) -> tuple[bytes | memoryview, ...]:
    """A list of numbers as it stands in a field; one number where all are equal, or there is none."""
    if not len(values) or (values == values[0]).all():
        return (f"uniform {float(values[0]) if len(values) else 0.0!r}".encode(),)
    return b"nonuniform List<scalar>\n%d\n(" % len(values), np.ascontiguousarray(values, SCALAR).data, b")\n"
