"""Full disks: all that writes, on disks of every size from nothing to what its result takes.

``python -m tests.fuzz.disk`` carries it out, with a limit of the size of files and, where mounting is allowed, on a
small file system in memory. What takes long (meshing, fitting, drawing) is done once; then a process is forked for each
size, which goes the command's own way from there.
"""

import io
import os
import resource
import subprocess
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from shutil import copytree, rmtree
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import click

from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.report.pictures import Exhibit, Gallery
from sdm_deflect.meshing.cache import MeshCache
from sdm_deflect.meshing.files import NAME
from sdm_deflect.meshing.formats.known import written
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.vtu import read_vtu
from tests.meshing.formats.wing import wing

STEP = 50_000
"""Bytes from one size of the disk to the next."""
CASES = "sdm_deflect.cases"
TURN = ("--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended")
HINGE = ("--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "8", "--quiet")
REFERENCE = "reference"
"""What they are called that give a context: of no use later, when the validation is kept."""
SLOW = {
    "deflect": ("run.deflect_file.planned", "run.deflect_file.run", "report.page.page"),
    "run": (
        "aircraft.pipeline.meshed", "aircraft.pipeline.plan_of", "aircraft.pipeline.carried_out",
        "aircraft.pipeline.whole_mesh_seconds", f"aircraft.pipeline.{REFERENCE}", "aircraft.validation.validate",
        "report.page.page",
    ),
    "report": (f"aircraft.run_folder.{REFERENCE}", "aircraft.validation.validate", "report.page.page"),
    "geometry": ("aircraft.cad.undeflected_cad",),
}  # fmt: skip
"""Functions by command whose results are kept, because they take long and write nothing."""
DRAWING = ("report.pictures.drawn", "aircraft.report.compared")
"""Functions that draw into a folder, whose pictures are kept."""


@dataclass(frozen=True)
class Work:
    """A command, and what it writes in its folder.

    Attributes
    ----------
    new : Whether what it writes must not be there.
    kept : Results of what takes long.
    given : What has to be in its place before.
    """

    words: tuple[str, ...]
    out: str
    new: bool = False
    kept: dict[str, Any] = field(default_factory=dict)
    given: Path | None = None

    @property
    def name(self) -> str:
        """What it does to what."""
        options = [word for word in self.words[1:] if word in ("--report", "--sensitivity", "--which")]
        source = [Path(self.words[1]).name] if self.words[0] == "deflect" else []
        return " ".join([self.words[0], *source, *options, self.out])

    def arguments(self, folder: Path) -> list[str]:
        """Words of the command line, results in `folder`."""
        option = [] if self.words[0] in ("report", "store") else ["--out"]
        return [*self.words, *option, str(folder / self.out)]

    def prepare(self, folder: Path) -> None:
        """Put what is given in its place."""
        if self.given:
            copytree(self.given, folder / self.out)

    @contextmanager
    def quickly(self) -> Iterator[None]:
        """Keep what takes long the first time, and use it from then on."""
        slow = dict.fromkeys(SLOW.get(self.words[0], ()), self.once)
        with ExitStack() as stack:
            for name, wrapped in (slow | dict.fromkeys(DRAWING, self.drawn)).items():
                place, _, function = f"{CASES}.{name}".rpartition(".")
                own = wrapped(name, getattr(import_module(place), function))
                stack.enter_context(patch(f"{place}.{function}", own))
            yield

    def once(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that is carried out once."""

        def known(*arguments: Any, **options: Any) -> Any:
            if name not in self.kept:
                found = function(*arguments, **options)
                self.kept[name] = list(found) if isinstance(found, Iterator) else found
                return found if hasattr(found, "__enter__") else known()
            found = self.kept[name]
            return (
                iter(found)
                if isinstance(found, list)
                else nullcontext(dict)
                if name.endswith(f".{REFERENCE}")
                else found
            )

        return known

    def drawn(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that draws once, and then writes the same pictures anew."""

        def known(data: Any, folder: Path) -> Any:
            if name not in self.kept:
                found = function(data, folder)
                exhibits = found.exhibits if isinstance(found, Gallery) else found
                self.kept[name] = (found, [(one, one.path.read_bytes()) for one in exhibits])
                return found
            found, pictures = self.kept[name]
            folder.mkdir(parents=True, exist_ok=True)
            exhibits = []
            for one, drawing in pictures:
                (folder / one.path.name).write_bytes(drawing)
                exhibits.append(Exhibit(one.part, folder / one.path.name, one.alternative))
            return Gallery(tuple(exhibits)) if isinstance(found, Gallery) else exhibits

        return known


def outcome(words: list[str]) -> tuple[int, str]:
    """Code and complaint of a command, as the program has them."""
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        try:
            run = store if words[0] == "store" else partial(cli, prog_name="sdm", standalone_mode=False)
            code = run(words) or 0
        except click.ClickException as error:
            code, _ = 2, said.write(error.format_message())
        except (ValueError, RuntimeError) as error:
            code, _ = (2, said.write(str(error))) if is_reported(error) else (70, said.write(repr(error)))
        except OSError as error:
            code, _ = 71, said.write(repr(error))
    return code, said.getvalue()


def store(words: list[str]) -> None:
    """Keep the mesh of a run in a cache."""
    _, run, place = words
    MeshCache(Path(place).parent).store(Path(place).stem, read_vtu(Path(run) / "undeflected.vtu"), {})


def forked(work: Work, folder: Path, limit: int | None) -> tuple[int, str]:
    """The same in another process whose files cannot be longer than `limit` bytes."""
    reading, writing = os.pipe()
    if not (child := os.fork()):
        code = 99
        try:
            os.dup2(writing, 2)
            if limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            with work.quickly():
                code, said = outcome(work.arguments(folder))
            os.write(writing, said.encode()[:4096])
        finally:
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, errors="replace") as pipe:
        said = pipe.read()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said


def content(folder: Path) -> dict[str, bytes]:
    """Every file in a folder, hidden ones and empty folders too."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b""
        for path in folder.rglob("*")
        if path.name not in ("ballast", "lost+found")
    }


def verdict(work: Work, folder: Path, old: Mapping[str, bytes], limit: int | None) -> str:
    """Carry a command out once and say how that went: ``written``, ``kept``, or what is wrong."""
    code, said = forked(work, folder, limit)
    now = content(folder)
    if code == 0:
        return "written" if now.keys() >= old.keys() and not hidden(now) else "WRONG: code 0, but files are missing"
    told = str(folder / work.out)
    wrong = [
        (code != 2, f"code {code}"),
        (len(said.strip().splitlines()) != 1, "not one line"),
        (told not in said and str(folder) not in said, "does not name the target"),
        (NAME in said, "names a temporary file"),
        (now != old, f"other files: {sorted(now.items() ^ old.items())[0][0] if now != old else ''}"),
    ]
    found = [text for bad, text in wrong if bad]
    return f"WRONG: {', '.join(found)}: {said.strip()[-300:]}" if found else "kept"


def hidden(found: Mapping[str, bytes]) -> list[str]:
    """Names of temporary files."""
    return [name for name in found if any(part.startswith(".") for part in Path(name).parts)]


def limited(work: Work, folder: Path, step: int, most: int | None = None) -> Iterator[tuple[int, str]]:
    """Carry a command out with every limit of the size of files up to what it needs."""
    largest, old = max(map(len, produced(work).values())), earlier(work, folder)
    limits = list(range(0, largest + step, step))
    for limit in limits[:: max(1, len(limits) // most)] if most else limits:
        yield limit, verdict(work, folder, old, limit)
        if work.new:
            restore(folder, old)


def crowded(work: Work, folder: Path, step: int) -> Iterator[tuple[int, str]]:
    """Carry a command out on a file system with every amount of free room up to what it needs."""
    total = sum(map(len, produced(work).values()))
    with mounted(folder, 4 * total + (8 << 20)):
        old, room = earlier(work, folder), 0
        while True:
            ballast(folder, room)
            found = verdict(work, folder, old, None)
            yield room, found
            if found == "written":
                return
            room += step


def earlier(work: Work, folder: Path) -> dict[str, bytes]:
    """Leave the result of an earlier command in a folder, unless it has to be new."""
    if not work.new:
        work.prepare(folder)
        code, said = forked(work, folder, None)
        assert code == 0, said
    return content(folder)


def produced(work: Work) -> dict[str, bytes]:
    """What a command writes."""
    with TemporaryDirectory() as name, work.quickly():
        work.prepare(Path(name))
        code, said = outcome(work.arguments(Path(name)))
        assert code == 0, said
        return content(Path(name))


def restore(folder: Path, old: Mapping[str, bytes]) -> None:
    """Remove what was written."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if str(path.relative_to(folder)) not in old:
            path.unlink() if path.is_file() else path.rmdir()


@contextmanager
def mounted(folder: Path, size: int) -> Iterator[None]:
    """Mount a file system in memory."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def ballast(folder: Path, room: int) -> None:
    """Fill a file system but for `room` bytes."""
    with (folder / "ballast").open("ab") as file:
        file.truncate(0)
        status = os.statvfs(folder)
        if (fill := status.f_bavail * status.f_frsize - room) > 0:
            os.posix_fallocate(file.fileno(), 0, fill)


def deflections(folder: Path, cells: int = 3) -> list[Work]:
    """Write a wing in every format, and return the commands that deflect it."""
    mesh, found, kept = wing(cells=cells).mesh, [], {}
    for name in written():
        known = FORMATS[name]
        source = folder / ("case" if name == "openfoam" else f"wing{known.suffixes[0]}")
        known.write(mesh, source)
        words = ("deflect", str(source), *TURN, *HINGE, "--repair", "off", "--no-report")
        found.append(Work(words, f"out{source.suffix}", not source.suffix, kept))
    su2 = found[0].words
    suffixes = [FORMATS[name].suffixes[0] for name in written() if name not in ("su2", "openfoam")]
    found += [Work(su2, f"out{suffix}", kept=kept) for suffix in suffixes]
    more = ((*su2, "--sensitivity"), (*su2[:-1], "--report", "--sensitivity"))
    return [*found, *(Work(words, "out.su2", kept=kept) for words in more)]


def runs(folder: Path) -> list[Work]:
    """Run a case, and return the commands on it."""
    run = Work(("run", "tail", "--quiet"), "run")
    with run.quickly():
        code, said = outcome(run.arguments(folder))
    assert code == 0, said
    exported = ("export", str(folder / "run"), "--quiet", "--format")
    outs = {name: f"out{FORMATS[name].suffixes[0]}" for name in written()} | {"openfoam": "out"}
    exports = [Work((*exported, name), out, name == "openfoam") for name, out in outs.items()]
    others = [
        Work(("report", "--quiet"), "report", given=folder / "run"),
        Work(("store", str(folder / "run")), "mesh.npz"),
    ]
    return [run, *others, *exports, *(Work(("geometry", "--quiet"), f"out.{form}") for form in ("step", "brep", "stl"))]


def main() -> None:
    """Carry out the commands on all disks, and print how often each did what."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=int, default=STEP, help="bytes from one size to the next")
    parser.add_argument("--cells", type=int, default=3, help="size of the wing")
    parser.add_argument("--only", default="", help="a word in the names of the commands")
    parser.add_argument("--kind", choices=("limited", "crowded"), nargs="*", default=("limited", "crowded"))
    given = parser.parse_args()
    ways = {"limited": limited, "crowded": crowded}
    with TemporaryDirectory() as name:
        home = Path(name)
        works = [*deflections(home, given.cells), *runs(home)]
        click.echo(f"{'command':40}{'disk':>10}{'sizes':>8}{'kept':>8}{'written':>8}{'wrong':>8}")
        for work in (work for work in works if given.only in work.name):
            for kind in given.kind:
                place = home / "disk"
                place.mkdir()
                found = list(ways[kind](work, place, given.step))
                counts = Counter(text.partition(" ")[0].rstrip(":") for _, text in found)
                numbers = "".join(f"{counts[what]:8}" for what in ("kept", "written", "WRONG"))
                click.echo(f"{work.name:40}{kind:>10}{len(found):8}{numbers}")
                for size, text in [pair for pair in found if pair[1].startswith("WRONG")][:5]:
                    click.echo(f"    {size}: {text}")
                rmtree(place)


if __name__ == "__main__":
    main()
