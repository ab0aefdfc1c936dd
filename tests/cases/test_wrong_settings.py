"""Every setting with every kind of bad value, wherever it may be given: it is taken, or refused in one sentence."""

import os
from dataclasses import fields, is_dataclass, replace
from datetime import date

import click
import numpy as np
import pytest

import sdm_deflect as sd
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.schema import inline_in, settings_in
from sdm_deflect.cases.aircraft.registry import case_named, resolve
from sdm_deflect.cases.api import deflect, read, sweep
from sdm_deflect.cases.cli.deflect import deflect as command
from sdm_deflect.cases.run import cluster
from sdm_deflect.cases.settings.conversion import to_toml
from sdm_deflect.cases.settings.job_settings import BY_NAME, SectionSettings, read_job
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
NAN, INF = float("nan"), float("inf")


def nested(depth):
    return [nested(depth - 1)] if depth else []


BAD = [
    True, 0, -1, 3, 1.5, 1e-13, 1e300, -1e300, 1e-300, NAN, INF, -INF, 10**400, 2**63, "", " ", "abc", "²", "nan",
    "\0", "/dev/null", "a" * 5000, [], [[]], {}, {"a": 1}, {5: 5}, [NAN], ["", 5], "*", nested(400), date(2000, 1, 1),
    b"x", object(), 1j, [None], "edges:nan", [[0, 0, 0], [1e300] * 3], [[0, 0, 0], [1e-300] * 3], set(), type,
]  # fmt: skip
ARRAYS = [
    *BAD, np.array([1.5]), np.array(["a"]), np.array([[0.5, 1, 2]]), np.array([[0, 1, 99]]), np.array([[0, 1, -1]]),
    [[0, 1], [2]], np.full((4, 3), NAN), np.full((4, 3), 1e300), np.zeros((4, 2)), np.zeros((2, 2, 2)),
    np.array([[True, False, True]]), np.array([[1 + 1j, 0, 0]]), np.array([["2000-01-01"] * 3], dtype="datetime64[D]"),
    np.array([[0, 1, 2**63]], dtype=np.uint64),
]  # fmt: skip
TEXTS = [
    "0", "-1", "nan", "inf", "-inf", "1e300", "-1e300", "1e-13", "1e-300", "", "  ", "²", "5,nan", "abc", "/dev/null",
    "a" * 5000, "9" * 400, "-", "*", "[", "~", "nan,nan,nan", "1e300,0,0", "x:plane", "x:", "edges:-5", "edges:nan",
    "no.txt", ".", "0:1e9:1", "\x1b[31m", "wing.su2", "folder.su2",
]  # fmt: skip
ASSIGNED = ["true", "-1", "1e300", "nan", "''", "abc", "[[]]", "{a=1}", "9" * 400, "2000-01-01", "[" * 300, '"\\u0000"']


def faults(attempt, values):
    """Return the values that are refused in no sentence, with what was said; any other exception fails the test."""
    found = []
    for value in values:
        try:
            attempt(value)
        except InputError as error:
            if not str(error) or not str(error).isprintable():
                found.append((value, str(error)))
    return found


@pytest.mark.filterwarnings("ignore:(hinge|tolerance)")
@pytest.mark.parametrize("name", [*BY_NAME, "surface", "surfaces", "fitting", "nosuch"])
def test_a_keyword_of_python(name, block):
    blended = {"motion": "blended", "held": [0, 1, 2], "driven": [120, 121]}
    base = blended if name in ("held", "driven", "strip") else {}

    def attempt(value):
        given = {"surfaces": "body", "hinge": HINGE, "angle": 5.0, **base, name: value}
        deflect(block, given.pop("surfaces"), given.pop("hinge"), given.pop("angle"), **given)

    assert faults(attempt, BAD) == []


@pytest.mark.parametrize(
    "attempt",
    [
        lambda value: read(value),
        lambda value: sweep(block_of(), "body", HINGE, value),
        lambda value: deflect(value, "body", HINGE, 5.0),
        lambda value: deflect((value, {"body": [0, 1]}), "body", HINGE, 5.0),
        lambda value: deflect((np.eye(4, 3), {"body": value}), "body", HINGE, 5.0),
        lambda value: deflect(block_of(), [{"patches": value}], None, None),
        lambda value: deflect(block_of(), "body", HINGE, 5.0, progress=value if not callable(value) else 5),
        *(
            lambda value, one=one.name: deflect(
                block_of(), "body", HINGE, 5.0, section=[{"patch": "x-", "point": [0, 0, 0], "axis": "x", one: value}]
            )
            for one in fields(SectionSettings)
        ),
        lambda value: Mesh(value, (), ()),
        lambda value: Mesh(np.eye(4, 3), value, ()),
        lambda value: Mesh(np.eye(4, 3), (value,), ()),
        lambda value: Mesh(np.eye(4, 3), (), value),
        lambda value: Mesh(np.eye(4, 3), (), (value,)),
        lambda value: Mesh(np.eye(4, 3), (), (), zones=value),
        lambda value: Mesh(np.eye(4, 3), (Cells("triangle", value),), ()),
        lambda value: Mesh(np.eye(4, 3), (), (Patch("a", (), value),)).on("a"),
        lambda value: Cells(value, [[0, 1, 2]]),
        lambda value: Patch(value, ()),
        lambda value: Patch("a", value),
        lambda value: block_of().with_points(value),
        lambda value: sd.Rotation(value),
        lambda value: sd.Rotation.about(value, [0, 0, 1]),
        lambda value: sd.Listed(value),
        lambda value: sd.OnPatches(value),
        lambda value: sd.TrailingEdge(value),
        lambda value: sd.Blended(value),
        lambda value: sd.Blended(sd.Rotation.about(*HINGE), rib=value),
        lambda value: sd.Blended(sd.Rotation.about(*HINGE), hinge_nodes=value),
        lambda value: sd.Blended(sd.Rotation.about(*HINGE), epsilon=value),
        lambda value: sd.Hexahedron(value),
        lambda value: sd.Table(value, np.eye(4, 3)),
        lambda value: sd.Table(np.eye(4, 3), value),
        lambda value: sd.Table.read(value),
    ],
)
def test_an_argument_of_python(attempt):
    assert faults(attempt, ARRAYS) == []


def block_of():
    from tests.deform.blocks import block_with_body

    return block_with_body(4)


@pytest.fixture
def folder(tmp_path, monkeypatch, hybrid_wing):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "ANSWER", 1)  # second, of a scheduler that is none
    FORMATS["su2"].write(hybrid_wing.mesh, tmp_path / "wing.su2")
    (tmp_path / "folder.su2").mkdir()
    return tmp_path


OPTIONS = [one.opts[0] for one in command.params if isinstance(one, click.Option) and not one.is_flag]
TURN = {
    "--surface": ["flap_*"], "--fixed": ["wing_*"], "--slide": ["symmetry:plane"], "--motion": ["blended"],
    "--hinge": ["0.7,0.3,0", "0.7,0.7,0"], "--angle": ["8"],
}  # fmt: skip


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_of_deflect(option, sdm, folder):
    found = []
    for text in TEXTS:
        given = {**TURN, option: [text, "0.7,0.7,0"] if option == "--hinge" else [text]}
        for other in {"--angles": ["--angle"], "--table": ["--hinge"]}.get(option, ()):
            del given[other]
        words = [word for name, values in given.items() for word in (name, *values)]
        code, _, said = sdm("deflect", "wing.su2", "--quiet", "--dry-run", *words)
        if code not in (0, 2) or said.count("\n") != (code == 2) or "Warning" in said:
            found.append((text, code, said))
    assert found == []


def keys(value, place=""):
    """Yield every setting of a dataclass by its place in a file."""
    yield from inline_in(type(value))
    for name, setting in settings_in(type(value)).items():
        yield f"{place}{name}"
        if is_dataclass(setting.of(value)):
            yield from keys(setting.of(value), f"{place}{name}.")


def test_a_setting_of_a_case():
    found = list(keys(case_named("aileron-chimera")))
    assert {"wing.half_span", "adaptation.n_add", "deflections", "block.gap_share", "mesh.corner"} <= {*found}
    for key in found:

        def attempt(text, key=key):
            resolve("aileron-chimera", assignments=[f"{key}={text}"])

        assert (key, faults(attempt, ASSIGNED)) == (key, [])


def test_a_key_of_a_file_of_a_case(tmp_path):
    path, whole = tmp_path / "case.toml", to_toml(case_named("tail"))
    lines = whole.splitlines()

    def attempt(text):
        path.write_text(text, encoding="utf-8")
        resolve("", config=path)

    for i, line in enumerate(lines):
        key, equals, _ = line.partition(" = ")
        bad = [f"{key} = {text}" for text in ASSIGNED[:6]] if equals else [line.replace("]", ".x]"), "[nosuch]", "["]
        texts = ["\n".join([*lines[:i], one, *lines[i + 1 :]]) for one in ["", *bad]]
        assert (line, [fault for _, fault in faults(attempt, texts)]) == (line, [])


@pytest.mark.parametrize("content", [b"", b"\xff", b"a = " + 3000 * b"[", 3000 * b"a=1\n", b"[[surface]]\n" * 300])
def test_a_file_of_settings(content, tmp_path):
    (tmp_path / "job.toml").write_bytes(content)
    for reading in (read_job, lambda path: resolve("", config=path)):
        assert faults(reading, [tmp_path / "job.toml", tmp_path, tmp_path / "none", tmp_path / "\0"]) == []


@pytest.mark.parametrize("setting", ["--table", "--held", "--driven", "--config", "--box"])
def test_a_device_or_a_pipe_is_not_read(setting, sdm, folder):
    os.mkfifo("pipe.txt")
    for path in ("pipe.txt", "/dev/zero"):
        given = {**TURN, setting: [path]}
        for other in {"--table": ["--hinge"]}.get(setting, ()):
            del given[other]
        code, _, said = sdm(
            "deflect", "wing.su2", "--quiet", "--dry-run", *[w for n, v in given.items() for w in (n, *v)]
        )
        assert (code, said.count("\n")) == (2, 1)


@pytest.mark.parametrize(("scale", "shift"), [(1e-8, 0.0), (1e-30, 0.0), (1e-160, 0.0), (1.0, 1e8), (1.0, 1e12)])
def test_nodes_that_cannot_be_told_apart(scale, shift, hybrid_wing):
    mesh = replace(hybrid_wing.mesh, points=hybrid_wing.mesh.points * scale + shift)
    hinge = np.array([[0.7, 0.3, 0.0], [0.7, 0.7, 0.0]]) * scale + shift
    with pytest.raises(InputError, match=r"cannot be kept apart|no length"):
        deflect(mesh, "flap_*", hinge, 8.0, fixed="wing_*", slide="symmetry:plane", motion="blended")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--hinge", "0.7,0.6,0", "0.7,1.4,0", "--angle", "5", "--angles", "1:3:1"], "--angle beside --angles"),
        (["--hinge", "0.7,0.6,0", "0.7,1.4,0", "--down", "5", "--angles", "1:3:1"], "--down beside --angles"),
        (["--hinge", "0.7,0.6,0", "--angle", "5"], "follows one point: a hinge needs two, such as"),
    ],
)
def test_words_that_take_each_other_s_place_are_refused(tmp_path, sdm, words, complaint):
    assert sdm("example", tmp_path)[0] == 0
    code, out, err = sdm("deflect", tmp_path / "naca.su2", "--surface", "flap", "--fixed", "wing", *words, "--quiet")
    assert (code, out) == (2, "")
    assert complaint in " ".join(err.split())


def test_a_range_on_the_command_line_is_of_one_surface(tmp_path, sdm):
    assert sdm("example", tmp_path, "--fighter")[0] == 0
    words = ("--config", tmp_path / "fighter.toml", "--range", "-5:5", "--plan", tmp_path / "plan.npz", "--quiet")
    code, _, err = sdm("deflect", tmp_path / "fighter.su2", *words)
    assert code == 2
    assert "--range: there are several surfaces" in " ".join(err.split())
