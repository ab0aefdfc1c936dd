"""The command line with random words, settings and files; what would take long is left out."""

import io
import os
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints
from unittest.mock import patch

import click
import numpy as np
import tomli_w

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.registry import CASES
from sdm_deflect.cases.cli.commands import carry_out, cli
from sdm_deflect.cases.settings.conversion import to_toml
from sdm_deflect.cases.settings.job_settings import JobSettings
from sdm_deflect.deform.base.cache_folder import FOLDER_VARIABLE
from sdm_deflect.deform.base.schema import inline_in, settings_in
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh import Skin, skin, tetrahedral, tets_of
from tests.fuzz import meshes
from tests.fuzz.inputs import Input, of_path
from tests.fuzz.mutation import Damage
from tests.fuzz.oracle import WrongError, is_single

MESH = "m.su2"
BASE = ("deflect", MESH, "--surface", "body", "--fixed", "far", "--hinge", "0,-1,0", "0,1,0", "--angle", "5", "-q")
DRY = (*BASE, "--no-report", "--dry-run")
JOB: dict[str, Any] = {
    "fixed": ["far"],
    "tolerance": 0.01,
    "surface": [{"patches": ["body"], "hinge": [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], "angle": 5.0}],
}
SKIPPED = {
    "sdm_deflect.cases.aircraft.pipeline": ("run_case", "meshed"),
    "studies.studies": ("table", "page", "reasons"),
    "sdm_deflect.cases.view.page": ("Page",),
    "sdm_deflect.cases.cli.examination": ("examined",),
    "sdm_deflect.cases.report.pictures": ("drawn",),
}
"""Functions by module that take long: a command ends there."""
CAD = "sdm_deflect.cases.aircraft.cad"
TEXTS = (
    "", " ", "a", "body", "far", "b*", "*", "?", "[", "0", "-1", "1", "2", "nan", "inf", "-inf", "1e300", "-1e300",
    "1e-300",
    "1e308", "0.5", "1e9", "1e20", "²", "٣", "1_0", "0x10", "5,nan", "1:2", "1:2:0", "0:90:1e-9", "-1e9:1e9:1", "1,2,3",
    "0,0,0", "1e300,0,0", "1,2", "1,2,3,4", "nan,0,0", "true", "false", "auto", "edges:", "edges:0", "edges:nan",
    "edges:181",
    "edges:1e400", "far:plane", "far:cylinder", "far:surface", "far:moon", ":plane", "far:",
    "x" * 3000, "ü", "\x1b[31mred", "a\nb",
    "\udcff",
    "\U0001f600", "{}", "[]", "[[[[", "null", "1,", ",", "-", "--", "--help", "../m.su2", ".", "..", "none", "none.su2",
    "folder", "folder/none.su2", "m.su2", "m.su2/x.su2", "table.csv", "table.npz", "nodes.txt", "box.toml", "job.toml",
    "out.su2", "out.cgns", "out.msh", "out.vtu", "out.stl", "out.step", "case", "out.", ".su2", "m-deflected.su2",
    "a/b/c.su2",
    "aileron", "tail", "all", "rudder", "aileron-chimera", "small", "medium", "paper", "squv", "mv", "table1", "page",
    "wing.half_span=0.3", "tolerance=0", "=", "a=b", "a.b.c=1", "angle=", "angle=nan", "title=", "name=foo",
    "deflections=[]",
    "surface=5", "box=[[0,0,0],[1,1,1]]", "max_steps=1000000000000", "spacing=1e-9", "margin=1e300", "strip=0",
    "x=" + "[" * 999,
)  # fmt: skip
"""What stands in the place of a word."""
VALUES = (
    0, 1, -1, 2, 3, 8, 10**6, 2**31, 2**63 - 1, -(2**63), 0.0, -0.0, 0.5, 1e-13, 1e-300, 1e300, -1e300, float("nan"),
    float("inf"), True, False, "", "abc", "body", "far", "*", "auto", "rigid", "blended", "edges:40", "mv", "worst",
    "x" * 500,
    "ü\x1b[31m", "table.csv", "nodes.txt", "box.toml", "table.npz", [], [[]], [0], ["far"], ["body", "far"], [1, "a"],
    [True],
    [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[1e300, 0.0, 0.0], [0.0, 1.0, 0.0]],
    [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]], [[0.0, 0.0], [1.0, 1.0]], {}, {"a": 1}, {"far": "plane"},
    {"far": "cylinder"},
    {"far": "moon"}, {"body": "plane"}, [{}], [{"patches": ["body"]}], ["x-", "y+"], ["x"],
)  # fmt: skip
"""What stands in the place of a setting."""


def tables(folder: Path) -> Iterator[Input]:
    """Displacements, lists of nodes, boxes and settings in files, with the command that reads them."""
    files = support(folder)
    hinged = (*DRY[:6], *DRY[-3:])
    by_file = {
        "table.csv": (*hinged, "--table", "table.csv", "--set", "amount=1"),
        "table.npz": (*hinged, "--table", "table.npz"),
        "nodes.txt": (*DRY, "--motion", "blended", "--held", "far", "--driven", "nodes.txt"),
        "box.toml": (*DRY, "--box", "box.toml"),
        "job.toml": ("deflect", MESH, "--config", "job.toml", "-q", "--no-report", "--dry-run"),
    }
    for name, words in by_file.items():
        yield Input({name: files[name], MESH: files[MESH]}, words)


def mesh() -> bytes:
    """Return the mesh that commands read."""
    with tempfile.TemporaryDirectory() as name:
        FORMATS["su2"].write(meshes.block(), Path(name, MESH))
        return Path(name, MESH).read_bytes()


def support(folder: Path) -> dict[str, bytes]:
    """Return a mesh and all files that options may name."""
    mesh = meshes.block()
    FORMATS["su2"].write(mesh, folder / MESH)
    body = mesh.points[mesh.on("body")]
    rows = np.column_stack([body, 0.05 * np.sin(body)])
    np.savetxt(folder / "table.csv", rows, delimiter=",", header="x,y,z,dx,dy,dz", comments="")
    np.savez(folder / "table.npz", points=rows[:, :3], vectors=rows[:, 3:])
    np.savetxt(folder / "nodes.txt", mesh.on("body")[:4], fmt="%d")
    (folder / "box.toml").write_text("corners = [[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]]\n")
    (folder / "job.toml").write_text(tomli_w.dumps(JOB))
    names = (MESH, "table.csv", "table.npz", "nodes.txt", "box.toml", "job.toml")
    return {name: (folder / name).read_bytes() for name in names}


def options(folder: Path) -> Iterator[Input]:
    """Every command as it should be called."""
    files = {**support(folder), **next(iter(folders(folder))).files}
    run = "m-deflected-report"
    for words in (
        DRY, (*BASE, "--no-report", "--out", "out.su2"), (*DRY, "--angles", "-5:5:5"), (*DRY, "--config", "job.toml"),
        (*DRY, "--motion", "blended", "--held", "far", "--driven", "nodes.txt", "--strip", "0.2"),
        (*DRY, "--slide", "far:plane", "--box", "box.toml", "--zone", "*", "--steps", "2", "--min-quality", "0"),
        (*DRY, "--periodic", "body", "far"),
        (*DRY, "--select", "half=body side:0,0,0,1,0,0", "--fixed", "half"),
        ("quality", MESH, "--select", "part=far#1 box:-9,-9,0,9,9,9 sharp:40"),
        (*DRY, "--set", "tolerance=0.1", "--set", "max_steps=3", "--json"),
        (*BASE, "--no-report", "--repair", "off", "--sensitivity", "--out", "out.cgns", "--json"), ("quality", MESH),
        ("quality", MESH, "--json"),
        ("list",), ("run", "aileron", "--angle", "5", "-q"), ("run", "tail", "--scale", "medium", "--set",
        "wing.half_span=0.3"),
        ("geometry", "--out", "out.step", "--case", "tail"), ("limit", "aileron", "--quality", "0.3", "--resolution",
        "2"),
        ("validate", run, "-q"), ("report", run, "-q"), ("view", run, "--no-open", "-q", "--port", "0"),
        ("compare", run, "run", "-q", "--out", "out.html"), ("compare", run, "run", "--json"),
        ("export", run, "--format", "su2", "--which", "deflected", "--out", "out.su2", "-q"), ("study", "table1", "-q"),
        ("cache",), ("cache", "--json"), ("doctor", "-q"),
    ):  # fmt: skip
        yield Input(files, words)


def made_options(random: Random, known: Sequence[Input]) -> Input:
    """Return a call with words that are wrong, missing, or too many."""
    one = random.choice(known)
    words = list(one.words)
    command = cli.commands.get(words[0])
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        kind = random.randrange(6)
        at = random.randrange(1, len(words)) if len(words) > 1 else 0
        if kind == 0 and command:
            words[1:1] = option(random, command)
        elif kind == 1 and command:
            words += option(random, command)
        elif kind == 2:
            del words[at]
        elif kind == 3:
            words[at] = "".join(chr(c) for c in Damage(random).of(words[at].encode("utf-8", "replace"))[:500] if c)
        else:
            words[at] = random.choice(TEXTS)
        words = words or [random.choice(list(cli.commands))]
    return Input(one.files, tuple(words))


def option(random: Random, command: click.Command) -> list[str]:
    """Return a random option of a command with as many values as it takes, mostly."""
    options = [param for param in command.params if isinstance(param, click.Option)]
    if not options:
        return [random.choice(TEXTS)]
    one = random.choice(options)
    name = random.choice((*one.opts, *one.secondary_opts))
    count = 0 if one.is_flag else one.nargs
    return [name, *(random.choice(TEXTS) for _ in range(count if random.random() < 0.95 else count + 1))]


def settings(folder: Path) -> Iterator[Input]:
    """Settings of a job and of a case, in files and as assignments."""
    files = support(folder)
    yield Input(files, ("deflect", MESH, "--config", "job.toml", "-q", "--no-report", "--dry-run"))
    yield Input(files, DRY)
    for name, case in CASES.items():
        yield Input({"case.toml": to_toml(case).encode()}, ("run", "--config", "case.toml", "-q"))
        yield Input({}, ("run", name, "-q"))


def made_settings(random: Random, known: Sequence[Input]) -> Input:
    """Return settings of which some are wrong: of another type, extreme, unknown or missing."""
    one = random.choice(known)
    of_job = one.words[0] == "deflect"
    keys = KEYS[of_job]
    if "--config" not in one.words:
        chosen = [f"{random.choice(keys)}={_text(random)}" for _ in range(random.choice((1, 1, 2)))]
        return Input(one.files, (*one.words, *(word for text in chosen for word in ("--set", text))))
    name = one.words[one.words.index("--config") + 1]
    try:
        nested = tomllib.loads(one.files[name].decode())
    except (ValueError, RecursionError):
        return one.with_file(name, Damage(random).of(one.files[name]))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        _set(random, nested, random.choice(keys).split("."))
    data = tomli_w.dumps(nested).encode()
    if random.random() < 0.1:
        data = Damage(random, (b"[[surface]]", b"'", b'"""', b"=", b"[" * 3000, b"{a={" * 999, b"1979-05-27")).of(data)
    return one.with_file(name, data)


def keys_of(kind: Any, before: str = "") -> Iterator[str]:
    """Yield the names of all settings of a dataclass, those of tables with a point."""
    yield from (f"{before}{name}" for name in inline_in(kind))
    for name, setting in settings_in(kind).items():
        yield f"{before}{name}"
        for part in filter(is_dataclass, (setting.kind, *get_args(setting.kind))):
            yield from keys_of(part, f"{before}{name}.")


KEYS = {True: tuple(keys_of(JobSettings)), False: tuple(keys_of(Case))}


def _value(random: Random) -> Any:
    value = random.choice(VALUES)
    if random.random() < 0.2:
        value = random.uniform(-1.0, 1.0) * 10.0 ** random.randint(-3, 3)
    return value if random.random() < 0.95 else random.choice(([value], [[value]], {"a": value}, [value, value]))


def _text(random: Random) -> str:
    if random.random() < 0.4:
        return random.choice(TEXTS)
    return tomli_w.dumps({"a": _value(random)}).partition("=")[2].strip()


def _set(random: Random, nested: dict[str, Any], path: list[str]) -> None:
    """Set, delete or add the setting at a path; of a list of tables, in any of them."""
    for name in path[:-1]:
        inner = nested.get(name)
        if isinstance(inner, list) and inner and isinstance(inner[0], dict):
            inner = random.choice(inner)
        if not isinstance(inner, dict):
            inner = nested[name] = {}
        nested = inner
    kind = random.random()
    if kind < 0.1:
        nested.pop(path[-1], None)
    elif kind < 0.15:
        nested[path[-1] + "s"] = _value(random)
    else:
        nested[path[-1]] = _value(random)


def folders(folder: Path) -> Iterator[Input]:
    """What `sdm deflect` and `sdm run` leave, with each command that reads it."""
    files = support(folder)
    run = "m-deflected-report"
    with _without("sdm_deflect.cases.report.folder", ("report_lacks",), "the drawing"):
        code = call((*BASE, "--out", "m-deflected.su2"), folder)[0]
    assert code in (0, 1), code
    own = {f"{run}/{name}": data for name, data in _files(folder / run).items()}
    reads = (
        ("report", run, "-q"), ("view", run, "--no-open", "-q"), ("validate", run, "-q"),
        ("export", run, "--format", "su2", "--out", "out.su2", "-q"),
        ("deflect", MESH, "--config", f"{run}/settings.toml", "--no-report", "--dry-run", "-q"),
    )  # fmt: skip
    for words in reads:
        yield Input({**own, MESH: files[MESH]}, words)
    case = {f"run/{name}": data for name, data in _case_folder(folder / "run").items()}
    for words in reads[:4]:
        yield Input(case, (words[0], "run", *words[2:]))


def _case_folder(folder: Path) -> dict[str, bytes]:
    """Return the files of a case with two cells, no surface of which is a control surface but by its name."""
    from sdm_deflect.meshing.formats.vtu_write import write_vtu

    folder.mkdir()
    mesh: Mesh = meshes.tetrahedra()
    faces = mesh.patches[0].faces[0].nodes
    tets = mesh.cells[0].nodes
    patch = np.array([0, 0, 0, 1, 1, 2])
    skin = Skin(faces, patch, patch + 1)
    tet_mesh = tetrahedral(mesh.points, tets, skin, ("wing_left", "aileron_left", "far_field"))
    (folder / "case.toml").write_text(to_toml(CASES["aileron"]))
    for name in ("undeflected.vtu", "deflected.vtu"):
        write_vtu(folder / name, tet_mesh)
    return _files(folder)


def _files(folder: Path) -> dict[str, bytes]:
    return {name.partition("/")[2]: data for name, data in of_path(folder).files.items()}


class _StopError(BaseException):
    """Work that takes long would begin."""


@contextmanager
def _without(module: str, names: Sequence[str], result: Any = None) -> Iterator[None]:
    with ExitStack() as stack:
        for name in names:
            stack.enter_context(patch.object(import_module(module), name, lambda *_, **__: result))
        yield


def _stop(*_: Any, **__: Any) -> None:
    raise _StopError


NO_CAD = SimpleNamespace(deflected_cad=_stop, undeflected_cad=_stop)
"""In the place of a module that loads much and takes seconds."""


@contextmanager
def _module(name: str, stub: Any) -> Iterator[None]:
    sys.modules[name] = stub
    try:
        yield
    finally:
        del sys.modules[name]


def geometry(folder: Path) -> Iterator[Input]:
    """The CAD of each case."""
    del folder
    for name in ("aileron", "tail", "rudder"):
        yield Input({}, ("geometry", "--out", "out.stl", "--case", name, "--angle", "5", "-q"))


def made_geometry(random: Random, known: Sequence[Input]) -> Input:
    """Return the CAD with some of its quantities anywhere in their ranges."""
    words = list(random.choice(known).words)
    for _ in range(random.choice((1, 1, 2, 4))):
        kind = random.choice([one for one in fields(Fighter) if is_dataclass(get_type_hints(Fighter)[one.name])])
        one = random.choice(fields(get_type_hints(Fighter)[kind.name]))
        if "low" in one.metadata:
            low, high = one.metadata["low"], one.metadata["high"]
            near = one.default * random.uniform(0.8, 1.25)
            value = min(max(random.choice((low, high, random.uniform(low, high), near, near, near)), low), high)
            words += ["--set", f"{kind.name}.{one.name}={value!r}"]
    return Input({}, tuple(words))


def build(folder: Path, given: Input, random: Random) -> None:
    """Call the command, CAD included."""
    del random
    import_module(CAD)
    answer(given, *call(given.words, folder))


def run_command(folder: Path, given: Input, random: Random) -> None:
    """Call the command up to where it takes long."""
    del random
    with ExitStack() as stack:
        for module, names in SKIPPED.items():
            for name in names:
                stack.enter_context(patch.object(import_module(module), name, _stop))
        stack.enter_context(_module(CAD, NO_CAD))
        stack.enter_context(patch.dict("os.environ", {FOLDER_VARIABLE: str(folder / "cache")}))
        try:
            answer(given, *call(given.words, folder))
        except _StopError:
            return


def answer(given: Input, code: Any, out: str, err: str) -> None:
    """See that the answer of a command is one: an exit code, and of an error one line."""
    if code not in (0, 1, 2):
        raise WrongError(f"exit code {code}: {err}")
    if "Traceback" in out + err or "Warning" in err:
        raise WrongError(f"noise: {err[:1000]}")
    line = err.removesuffix("\n")
    said = sum(map(len, given.words))
    if code == 2 and not (is_single(line.rpartition("\n")[2], said) and "sdm: " in line):
        raise WrongError(f"exit code 2 with {err[:1000]!r}")


def call(words: Sequence[str], folder: Path) -> tuple[Any, str, str]:
    """Call `sdm` in this process within a folder; return exit code, output and complaints."""
    out, err = io.StringIO(), io.StringIO()
    here = Path.cwd()
    os.chdir(folder)
    try:
        with patch.object(sys, "argv", ["sdm", *words]), redirect_stdout(out), redirect_stderr(err):
            carry_out()
    except SystemExit as end:
        return end.code, out.getvalue(), err.getvalue()
    finally:
        os.chdir(here)
    raise WrongError("the command did not end")


def cache(folder: Path) -> Iterator[Input]:
    """A kept mesh."""
    from sdm_deflect.meshing.cache import MeshCache

    mesh = meshes.tetrahedra()
    faces = mesh.patches[0].faces[0].nodes
    patch_of = np.zeros(len(faces), dtype=np.intp)
    kept = tetrahedral(mesh.points, mesh.cells[0].nodes, Skin(faces, patch_of, patch_of + 1), ("wall",))
    MeshCache(folder).store("key", kept, {"seconds": 1.5})
    yield from (of_path(path) for path in folder.iterdir())


def load_cached(folder: Path, given: Input, random: Random) -> None:
    """Load a damaged mesh: it is not there, or it is the same."""
    del random
    from sdm_deflect.meshing.cache import MeshCache

    loaded = MeshCache(folder).load("key")
    if loaded is None:
        return
    mesh, plain = loaded[0], meshes.tetrahedra()
    same = (mesh.points.tobytes(), tets_of(mesh).tobytes()) == (plain.points.tobytes(), plain.cells[0].nodes.tobytes())
    faces = plain.patches[0].faces[0].nodes
    alike = np.array_equal(skin(mesh).triangles, faces) and mesh.names == ("wall",)
    if not (same and alike) or loaded[1] != {"seconds": 1.5}:
        raise WrongError("another mesh was loaded than was stored")
