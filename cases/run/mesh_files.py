"""The files of a deflection: inputs, outputs, and protection of files that must not be overwritten.

A written file is read back from the disk before it takes its place: its points must be those that were judged.
"""

import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, MeshFileError, printable
from sdm_deflect.base.states import check_unchanged
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.meshing.errors import only_rewritten
from sdm_deflect.meshing.formats.format import Format
from sdm_deflect.meshing.formats.registry import ending, format_of, in_pieces
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import gather_points
from sdm_deflect.meshing.mesh.precision import DOUBLE, EVERY_BIT, Precision

SENSITIVITY = "d_points_d_angle"
# File that marks the folder of a report.
SETTINGS = "settings.toml"
# Beginning of the table of several poses.
HEAD = b"file,verdict,least_quality,"
DIFFERS = "{}: what was written does not read back as what was judged, and is discarded: {}"


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Every file that a job writes.

    Attributes
    ----------
    source : file of the undeflected mesh.
    out : file of the deflected mesh; a folder for OpenFOAM. With several poses all names begin with it.
    poses : amounts of all surfaces at each pose; distinct, in the user's order.
    sensitive : whether d(points)/d(angle) is written beside each mesh.
    reported : whether a folder with a report is written beside each mesh.
    plan : the file of the plan, or None.
    meshes : whether meshes are written, and reports beside them.
    form, source_form : the formats of `out` and `source`.
    """

    source: Path
    out: Path
    poses: tuple[Amounts, ...]
    sensitive: bool = False
    reported: bool = False
    plan: Path | None = None
    meshes: bool = True
    form: Format = field(init=False, repr=False)
    source_form: Format = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "form", format_of(self.out))
        object.__setattr__(self, "source_form", format_of(self.source))

    @classmethod
    def of(
        cls, source: Path, out: Path | None, poses: Sequence[Amounts], sensitive: bool = False, reported: bool = False
    ) -> "OutputFiles":
        """Return the files of a job; `out` is beside the source if None.

        Raises MeshFileError for an unknown format, or one that cannot hold this mesh; InputError for an `out` without a
        name, or with another suffix if the format only rewrites files.
        """
        chosen = out or _beside(source)
        form, given = format_of(chosen), format_of(source)
        named = form.place(chosen)
        if named.name in ("", "..") and not (named := named.resolve()).name:
            raise InputError(f"{chosen} is no place for a mesh; name a file or a folder in out")
        if not form.written:
            if form is not given:
                raise only_rewritten(chosen)
            if ending(chosen).lower() != (suffix := ending(source)).lower():
                raise InputError(f"{chosen}: is to be a copy of a file {suffix} and must have that suffix")
        return cls(source, named, tuple(poses), sensitive, reported)

    def mesh(self, pose: Amounts) -> Path:
        """Return the mesh of one pose, such as ``wing-deflected_-12.su2`` where there are several.

        The amounts of further surfaces follow: ``wing-deflected_-12_+3.su2``.
        """
        first, *others = pose
        tail = f"_{first:+}".removesuffix(".0") + "".join(f"_{other:+g}" for other in others)
        return self.out if len(self.poses) == 1 else self._file(tail)

    def sensitivity(self, pose: Amounts) -> tuple[Path, Path]:
        """Return the .npz and the .vtu of the sensitivity at one pose."""
        of_pose = replace(self, out=self.mesh(pose))
        return of_pose._file("-sensitivity", ".npz"), of_pose._file("-sensitivity", ".vtu")

    def report(self, pose: Amounts) -> Path:
        """Return the folder of the report at one pose."""
        return replace(self, out=self.mesh(pose))._file("-report", "")

    @property
    def written(self) -> tuple[Path, ...]:
        """All meshes that are written."""
        return tuple(map(self.mesh, self.poses)) if self.meshes else ()

    @property
    def limits(self) -> Path:
        """The folder of `sdm limit`, such as ``wing-limit``."""
        return self.out.with_name(f"{self._file('', '').name.removesuffix('-deflected')}-limit")

    @property
    def reports(self) -> tuple[Path, ...]:
        """All folders of reports."""
        return tuple(map(self.report, self.poses)) if self.reported and self.meshes else ()

    def precision(self, mesh: Mesh) -> Precision:
        """Return the precision of a mesh's coordinates in the files."""
        return precision_of(self.source, self.out, mesh)

    @property
    def is_copy(self) -> bool:
        """Whether nothing but copies with other coordinates, and reports, is written."""
        return not self.sensitive and self.source.exists() and _keeps_bytes(self.source, self.out)

    @property
    def summary(self) -> Path | None:
        """The table of several poses, such as ``wing-deflected.csv``; None for a single mesh."""
        return self._file("", ".csv") if len(self.poses) > 1 and self.meshes else None

    @property
    def extra(self) -> tuple[Path, ...]:
        """Sensitivities beside the meshes."""
        return tuple(path for pose in self.poses for path in self.sensitivity(pose)) if self.sensitive else ()

    @property
    def tables(self) -> tuple[Path, ...]:
        """Files with names of patches beside the meshes, for formats that have such."""
        return tuple(table for pose in self.poses for table in self.form.name_files(self.mesh(pose)))

    def check_names(self, mesh: Mesh) -> None:
        """Raise MeshFileError if a table of patch names exists and belongs to another mesh."""
        for pose in self.poses if self.source_form is not self.form else ():
            self.form.check_named(mesh, self.mesh(pose))

    def keep_tables(self, scratch: Path) -> None:
        """Keep an existing table of patch names: a user may have set conditions in it."""
        for table in self.tables:
            if table.exists():
                (scratch / table.name).unlink(missing_ok=True)

    def check(self, inputs: Sequence[Path] = ()) -> None:
        """Raise InputError if an output would overwrite an input, another output or a foreign file."""
        self._check_plan()
        meshes = tuple(map(self.mesh, self.poses))
        seen: set[Path] = set()
        for target in (*meshes, *self.extra, *filter(None, [self.plan, self.summary]), *self._other_tables()):
            self._check_target(target, (self.source, *inputs))
            if target.resolve() in seen:
                raise InputError(f"{target} would be written twice; choose another name in out")
            seen.add(target.resolve())
        for folder in self.reports:
            if folder.exists() and not is_report(folder):
                raise InputError(f"{folder} exists already and is no earlier report; delete it, or choose another out")
            if Path.cwd().is_relative_to(folder.resolve()):
                raise InputError(
                    f"{folder}: this command works in the folder that it is to replace; run it from another"
                )
        if self._is_folder and self.out.resolve().is_relative_to(self.source_form.place(self.source).resolve()):
            raise InputError(f"{self.out} lies in the case that is read; name a folder outside it in out")

    def _check_plan(self) -> None:
        if not self.meshes and not self.plan:
            raise InputError("--no-mesh: nothing would be written; name a file in --plan")
        home = self.out.parent.resolve()
        if self.plan and (self.plan.parent.resolve() != home or self.plan.suffix != ".npz"):
            raise InputError(f"--plan {self.plan}: must be an .npz in {home}, with the mesh, beside which it appears")

    def _check_target(self, target: Path, read: Sequence[Path]) -> None:
        if target.exists() and any(given.exists() and target.samefile(given) for given in read):
            raise InputError(f"{target}: this is a file that is read; name another one in out")
        if target.exists() and not self._may_replace(target):
            rule = "and only the file that out names, and an earlier plan or sensitivity, are replaced"
            fault = rule if target.is_file() or target.is_dir() else "and is a pipe or a device"
            raise InputError(f"{target} exists already, {fault}; delete it, or choose another name in out")

    def _other_tables(self) -> list[Path]:
        """Return the tables that would replace a different one."""
        meshes = [mesh for mesh in map(self.mesh, self.poses) if self.form.named_otherwise(self.source, mesh)]
        return [table for mesh in meshes for table in self.form.name_files(mesh)]

    def _may_replace(self, target: Path) -> bool:
        """Return whether an existing file may be replaced."""
        if target.is_dir():
            return self._is_folder and not target.suffix[1:2].isalpha() and not any(target.iterdir())
        if target == self.plan:
            from sdm_deflect.deform.plan_file import is_plan  # loads SciPy's splines in 0.1 s

            return target.is_file() and is_plan(target)
        return target.is_file() and (target == self.out or (target in (*self.extra, self.summary) and _is_ours(target)))

    def _file(self, tail: str, suffix: str | None = None) -> Path:
        end = "" if self._is_folder else ending(self.out)
        return self.out.with_name(f"{self.out.name.removesuffix(end)}{tail}{end if suffix is None else suffix}")

    @property
    def _is_folder(self) -> bool:
        return self.form.folder


def is_report(folder: Path) -> bool:
    """Whether a folder is that of a deflected mesh."""
    return (folder / SETTINGS).is_file()


def inputs_of(given: Mapping[str, Any], folder: Path) -> tuple[Path, ...]:
    """Return the files that settings name, at any depth: tables, lists of nodes, boxes, relative to `folder`."""
    files: list[Path] = []
    for value in given.values():
        for item in value if isinstance(value, list | tuple) else (value,):
            if isinstance(item, Mapping):
                files += inputs_of(item, folder)
            elif isinstance(item, str | Path):
                with suppress(OSError, ValueError):  # too long, or with a null character, for any file
                    files += [folder / item] if (folder / item).is_file() else []
    return tuple(files)


def precision_of(source: Path | None, out: Path, mesh: Mesh) -> Precision:
    """Return the precision of coordinates in a file for a mesh read from `source`, or from elsewhere."""
    form = format_of(out)
    same = source is not None and source.exists() and format_of(source) is form
    real = form.real(out, source if same else None)
    if real == DOUBLE:
        return EVERY_BIT
    better = out.name.removesuffix(form.ending(out)) + form.finer(out, mesh)
    copied = source is not None and _keeps_bytes(source, out)
    return Precision(real, not copied, f"write the mesh in double precision, such as {better}")


def _keeps_bytes(source: Path, out: Path) -> bool:
    """Return whether `out` copies all but coordinates from the source; not for another encoding of UGRID."""
    if format_of(out) is not format_of(source):
        return False
    return format_of(out).folder or ending(out).lower() == ending(source).lower()


def write_mesh(
    source: Path | None, mesh: Mesh, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
) -> tuple[str, ...]:
    """Write the mesh with new points; return a sentence for each thing that the format of `out` cannot hold.

    In the format of the source only coordinates change; all other bytes stay. A .vtu made from
    another format shows the point array ``displacement`` and the cell array ``quality``. Raises InputError if the
    source is no longer the file that was read, MeshFileError as the format does, and ValueError for a mesh of a file
    without the states of the files that were read.
    """
    if source and not mesh.files:
        raise ValueError(f"{source}: nobody knows the state in which this mesh was read; read it by registry.read")
    form = format_of(out)
    if whole := mesh.whole:
        moved_rows = np.flatnonzero((points != mesh.points).any(axis=1))
        whole.pieces.rewrite(whole.nodes[moved_rows], points[moved_rows], out, progress, runner)
        check_unchanged(mesh.files)
        return ()
    if source and format_of(source) is form:
        form.rewrite(source, points, out, progress)
        check_unchanged(mesh.files)
        return ()
    return tuple(map(printable, form.write_moved(mesh.for_file(), points, out, progress)))


def write_sensitivity(
    mesh: Mesh, points: FloatArray, rates: Mapping[str, FloatArray], out: tuple[Path, Path], unit: str
) -> None:
    """Write the derivatives by each surface's amount: an .npz with the points, and a .vtu to look at.

    Of a single surface `d_points_d_angle` is (N, 3); of n surfaces it is (n, N, 3), with their names in `surfaces`.
    """
    from sdm_deflect.meshing.formats.vtu import write_vtu

    arrays, picture = out
    names, (first, *others) = list(rates), list(rates.values())
    several = {SENSITIVITY: np.stack([first, *others]), "surfaces": np.array(names)} if others else {SENSITIVITY: first}
    np.savez_compressed(arrays, points=points, unit=np.array(unit), **several)
    shown = {f"{SENSITIVITY}_{name}": rate for name, rate in rates.items()} if others else several
    write_vtu(picture, replace(mesh, points=points, patches=()), shown)


def _beside(source: Path) -> Path:
    """Return the name of a deflected mesh beside the source."""
    form, suffix = format_of(source), ending(source)
    if not form.folder:
        kept = suffix if suffix.lower().endswith(form.suffixes) else form.suffixes[0]
        return source.with_name(f"{source.name.removesuffix(suffix)}-deflected{kept}")
    folder = form.place(source)
    named = folder if folder.name not in ("", "..") else folder.resolve()
    name = f"{named.name}-deflected"
    return named.with_name(name.replace(".", "-") if Path(name).suffix[1:2].isalpha() else name)


def _is_ours(path: Path) -> bool:
    """Whether a file is the sensitivity, or the table, of an earlier job."""
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as arrays:
                return f"{SENSITIVITY}.npy" in arrays.namelist()
        with path.open("rb") as file:
            begin = file.read(1 << 12)
            return begin.startswith(HEAD) if path.suffix == ".csv" else f'Name="{SENSITIVITY}'.encode() in begin
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def check_written(mesh: Mesh, points: FloatArray, staged: Path, out: Path) -> None:
    """Read a written file and compare its points, bit by bit, with `points` (N, 3).

    Raises MeshFileError, which names the final file `out`, if they differ or the file cannot be read.
    """
    if text := difference(mesh, points, staged):
        raise MeshFileError(DIFFERS.format(out, text.replace(str(staged), out.name)))


def difference(mesh: Mesh, points: FloatArray, path: Path) -> str:
    """Return a text on how the points of a file differ from those of a mesh or its submesh; empty if equal."""
    try:
        stored = _points_in(mesh, path)
    except (MeshFileError, InputError) as error:
        return str(error)
    if len(points) != len(stored):
        return f"it has {len(stored)} points, not {len(points)}"
    axes = 2 if mesh.plane else 3
    same = (points[:, :axes] == stored[:, :axes]).all(axis=1)
    if same.all():
        return ""
    row = int(np.argmin(same))
    x, y = (" ".join(f"{value:.17g}" for value in places[row]) for places in (stored, points))
    return f"{np.count_nonzero(~same)} points are elsewhere, the first at {x}, not {y}"


def _points_in(mesh: Mesh, path: Path) -> FloatArray:
    form, source, whole = format_of(path), Path(mesh.source), mesh.whole
    if not whole:
        return form.read_copy(path, source).points
    points = form.points_of_copy(path, source)
    if points is not None:
        return points[whole.nodes] if len(points) == mesh.point_count else points
    with in_pieces(path) as back:
        if back is None or back.pieces.blocks != whole.pieces.blocks or back.pieces.points != mesh.point_count:
            raise MeshFileError("it has other points or cells")
        return gather_points(back.pieces, whole.nodes)
