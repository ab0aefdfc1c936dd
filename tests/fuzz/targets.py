"""What is tried: which inputs it has, how they are damaged, and what is done with them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz import commands, meshes
from tests.fuzz.containers import damaged_hdf5, damaged_npz
from tests.fuzz.inputs import Input
from tests.fuzz.mutation import Damage
from tests.fuzz.oracle import WrongError

LARGEST = 200_000
"""Bytes of an input of which others are made."""

Run = Callable[[Path, Input, Random], None]


@dataclass(frozen=True, slots=True)
class Target:
    """Something that reads.

    Attributes
    ----------
    name : as on the command line.
    seeds : makes sound inputs, with an empty folder to work in.
    run : does something with an input that lies in a folder; raises what a user would see.
    words : of the format.
    weight : its share of the time.
    sample : inputs of the short run: what once did harm, then random ones.
    made : makes an input of sound ones; None: by damage.
    """

    name: str
    seeds: Callable[[Path], Iterator[Input]]
    run: Run
    words: Sequence[bytes] = field(default=(), repr=False)
    weight: float = 1.0
    sample: int = 300
    made: Callable[[Random, Sequence[Input]], Input] | None = None

    def input(self, random: Random, known: Sequence[Input]) -> Input:
        """Return a random input."""
        small = [one for one in known if one.size < LARGEST]
        return self.made(random, small) if self.made else damaged(random, small, self.words)


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
        return Input(files or one.files, one.words)
    damage = Damage(random, words, tuple(other.files.values()))
    data = one.files[name]
    if data[:4] == b"\x89HDF":
        return one.with_file(name, damaged_hdf5(random, data, damage))
    if name.endswith(".npz"):
        return one.with_file(name, damaged_npz(random, data, damage))
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
    from sdm_deflect.meshing.formats.format import MeshFileError
    from sdm_deflect.meshing.formats.known import written
    from sdm_deflect.meshing.formats.registry import FORMATS, read

    name = random.choice(written())
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
    from sdm_deflect.deform.volume.deflection import sweep
    from sdm_deflect.deform.volume.plan import Plan

    if not mesh.patches:
        return
    middle, size = mesh.points.mean(axis=0), np.ptp(mesh.points, axis=0).max(initial=0.0)
    reach = np.array([0.0, 0.1 * size, 0.0])
    hinge = np.array([middle - reach, middle + reach])
    name = mesh.patches[0].name
    job = settings_of([name], hinge, 3.0, {"fixed": "*"} if len(mesh.patches) > 1 else {}).jobs()[0]
    plan = Plan.of(mesh, job, (3.0,))
    if random.random() < 0.3:
        for _, one in sweep(plan, (3.0,)):
            checks_of(one)


SAMPLES = {
    "su2": 800,
    "cgns": 250,
    "gmsh": 500,
    "ugrid": 500,
    "tau": 500,
    "fluent": 250,
    "plot3d": 500,
    "openfoam": 500,
    "vtu": 700,
}
READERS = tuple(
    Target(name, getattr(meshes, name), read_mesh, meshes.WORDS[name], sample=sample)
    for name, sample in SAMPLES.items()
)
FIGURES = (b"corners", b"nan", b"PK\x03\x04", b"x,y,z,dx,dy,dz\n")
COMMANDS = (
    Target("tables", commands.tables, commands.run_command, FIGURES),
    Target("options", commands.options, commands.run_command, made=commands.made_options),
    Target("settings", commands.settings, commands.run_command, made=commands.made_settings),
    Target(
        "folders",
        commands.folders,
        commands.run_command,
        (b"null", b"NaN", b"[[surface]]", b"{}", b"1e999"),
        sample=150,
    ),
    Target("geometry", commands.geometry, commands.build, (), 0.5, 10, commands.made_geometry),
    Target("cache", commands.cache, commands.load_cached, (b"PK\x03\x04", b"\x93NUMPY"), 0.5, 400),
)
TARGETS = {target.name: target for target in (*READERS, *COMMANDS)}
