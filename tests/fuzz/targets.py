"""What is tried: which inputs it has, how they are damaged, and what is done with them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from sdm_deflect.cases.settings.jobs import jobs_of
from tests.fuzz import meshes
from tests.fuzz.inputs import Input
from tests.fuzz.mutation import Damage, damaged_hdf5

# Bytes of an input of which others are made.
LARGEST = 200_000

Run = Callable[[Path, Input, Random], None]


class WrongError(Exception):
    """What was done is wrong, though no error was reported."""


@dataclass(frozen=True, slots=True)
class Target:
    """Something that reads.

    Attributes
    ----------
    name : as on the command line.
    seeds : makes sound inputs, with an empty folder to work in.
    run : does something with an input that lies in a folder; raises what a user would see.
    words : of the format.
    """

    name: str
    seeds: Callable[[Path], Iterator[Input]]
    run: Run
    words: Sequence[bytes] = field(default=(), repr=False)

    def input(self, random: Random, known: Sequence[Input]) -> Input:
        """Return a random input."""
        return damaged(random, [one for one in known if one.size < LARGEST], self.words)


def damaged(random: Random, known: Sequence[Input], words: Sequence[bytes]) -> Input:
    """Return a sound input with one of its files damaged, missing, or in the place of another."""
    one, other = random.choice(known), random.choice(known)
    name = random.choice(list(one.files))
    if len(one.files) > 1 and random.random() < 0.1:
        files = dict(one.files)
        if random.random() < 0.5:
            del files[name]
        else:
            files[name] = random.choice(list({**other.files, **files}.values()))
        return Input(files or one.files)
    damage = Damage(random, words, tuple(other.files.values()))
    data = one.files[name]
    if data[:4] == b"\x89HDF":
        return one.with_file(name, damaged_hdf5(random, data, damage))
    return one.with_file(name, damage.of(data))


def read_mesh(folder: Path, given: Input, random: Random) -> None:
    """Read a mesh and, if it is accepted, judge it, write it and plan a deflection."""
    from sdm_deflect.cases.run.inspection import inspect
    from sdm_deflect.meshing.formats.registry import format_of, read

    path = folder / given.main
    mesh = read(path)
    out = folder / "out"
    out.mkdir()
    if random.random() < 0.5:
        inspect(path)
    if random.random() < 0.5:
        again = out / path.name
        shift = [0.25, 0.25, 0.0 if mesh.plane else 0.25]
        moved = mesh.points + shift
        format_of(path).rewrite(path, moved, again)
        found = read(again).points
        if format_of(path).name != "plot3d" or len(found) == len(moved):  # rounding may put blocks together, or apart
            _compare(moved, found)
    if random.random() < 0.3:
        _write_elsewhere(mesh, out, random)
    if random.random() < 0.3:
        _plan(mesh, random)


def _compare(wanted, found) -> None:
    import numpy as np

    if wanted.shape != found.shape:
        raise WrongError(f"written {wanted.shape} points, read {found.shape}")
    off = np.abs(wanted - found)
    if (off > 1e-6 * np.maximum(1.0, np.abs(wanted).max(initial=0.0))).any():
        raise WrongError("other points were read than were written")


def _write_elsewhere(mesh, out: Path, random: Random) -> None:
    from sdm_deflect.base.errors import MeshFileError
    from sdm_deflect.meshing.formats.registration import writable
    from sdm_deflect.meshing.formats.registry import FORMATS, read

    name = random.choice(writable())
    path = out / f"other{FORMATS[name].suffixes[0] if name != 'openfoam' else ''}"
    try:
        FORMATS[name].write(mesh, path)
    except MeshFileError:
        if any(out.glob(".*")) or path.exists():
            raise WrongError(f"an unwritten {name} left something") from None
        return
    axes = 2 if mesh.plane and name == "su2" else 3  # it has no z then, and says so
    _compare(mesh.points[:, :axes], read(path).points[:, :axes])


def _plan(mesh, random: Random) -> None:
    """Plan a deflection of the first patch, and sometimes carry it out."""
    import numpy as np

    from sdm_deflect.cases.settings.job_settings import settings_of
    from sdm_deflect.deform.checks import checks_of
    from sdm_deflect.deform.loop import run
    from sdm_deflect.deform.volume.plan import Plan

    if not mesh.patches:
        return
    middle, size = mesh.points.mean(axis=0), np.ptp(mesh.points, axis=0).max(initial=0.0)
    reach = np.array([0.0, 0.1 * size, 0.0])
    hinge = np.array([middle - reach, middle + reach])
    name = mesh.patches[0].name
    job = jobs_of(settings_of([name], hinge, 3.0, {"fixed": "*"} if len(mesh.patches) > 1 else {}))[0]
    plan = Plan.of(mesh, [job], ((3.0,),))
    if random.random() < 0.3:
        for one, _ in run(plan):
            checks_of(one)


TARGETS = {
    name: Target(name, getattr(meshes, name), read_mesh, meshes.WORDS[name])
    for name in ("su2", "cgns", "gmsh", "ugrid", "tau", "fluent", "plot3d", "openfoam", "vtu")
}
