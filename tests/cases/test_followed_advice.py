"""Inputs that solvers take are taken; where something must be named, the error says what, and naming it helps."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body
from tests.deform.plates import plate

QUIET = ["--no-report", "--quiet"]


@pytest.fixture
def run(sdm, tmp_path):
    """Deflect a mesh that is written in a format; return the exit code, and the error or what is printed."""

    def call(mesh, *words, name="mesh.su2"):
        path = tmp_path / name
        if isinstance(mesh, Mesh):
            format_of(path).write(mesh, path)
        code, out, err = sdm("deflect", path, *words, *QUIET)
        return code, err if code == 2 else out

    return call


def strip(nx=20, ny=8):
    """A duct 2 x 1 of quadrilaterals: patches ``lower``, ``upper``, ``inlet`` and ``outlet``."""
    x, y = np.meshgrid(np.linspace(0, 2, nx + 1), np.linspace(0, 1, ny + 1), indexing="ij")
    index = np.arange(x.size).reshape(x.shape)
    cells = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    sides = {"lower": index[:, 0], "upper": index[::-1, -1], "inlet": index[0, ::-1], "outlet": index[-1]}
    patches = [Patch(n, (Cells("line", np.stack([one[:-1], one[1:]], axis=1)),)) for n, one in sides.items()]
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Mesh(points, (Cells("quad", cells),), tuple(patches))


def test_a_group_of_patches_that_are_named_needs_no_name(run):
    mesh = block_with_body()
    walls = tuple(faces for patch in mesh.patches for faces in patch.faces)
    every = Patch("all_walls", (Cells("quad", np.vstack([faces.nodes for faces in walls])),))
    half = Patch("some", (Cells("quad", mesh.patch("body").faces[0].nodes[::2]),))
    both = Mesh(mesh.points, mesh.cells, (*mesh.patches, every, half))
    words = ["--surface", "body", "--hinge", "0,-0.5,0", "0,0.5,0", "--angle", "5"]
    code, error = run(both, *words, name="mesh.msh")
    assert code == 2
    assert "also belong to all_walls" in error  # some of its faces are on patches of which nothing is said
    code, out = run(both, *words, "--fixed", "[xyz][+-]", name="mesh.msh")
    assert code == 0, out


TWO = """fixed = ["upper", "inlet"]
slide = {{ outlet = "plane" }}
[[surface]]
patches = ["first"]
hinge = [[0.0, 0.0], [0.0, 0.0]]
angle = 3
motion = "blended"
driven = {first}
[[surface]]
patches = ["second"]
hinge = [[1.0, 0.0], [1.0, 0.0]]
angle = -3
motion = "blended"
driven = {second}
{held}
"""


def test_two_blended_surfaces_with_a_common_rib(run, tmp_path):
    mesh = strip()
    lower = mesh.patch("lower").faces[0].nodes
    middle = mesh.points[lower].mean(axis=1)[:, 0]
    parts = {"first": (middle > 0.3) & (middle < 1.0), "second": (middle > 1.0) & (middle < 1.7)}
    patches = [Patch(name, (Cells("line", lower[rows]),)) for name, rows in parts.items()]
    rest = Patch("lower", (Cells("line", lower[~(parts["first"] | parts["second"])]),))
    both = Mesh(mesh.points, mesh.cells, (*patches, rest, *(mesh.patch(n) for n in ("upper", "inlet", "outlet"))))
    place = {x: int(np.argmin(np.linalg.norm(mesh.points - [x, 0, 0], axis=1))) for x in (0.7, 1.4)}
    config = tmp_path / "two.toml"
    text = TWO.replace('["upper", "inlet"]', '["upper", "inlet", "lower"]')
    for held, code in (("", 0), ('held = ["lower"]', 2), ('held = ["lower", "first"]', 0)):
        config.write_text(text.format(first=[place[0.7]], second=[place[1.4]], held=held))
        found, said = run(both, "--config", config)
        assert found == code, said
    config.write_text(text.format(first=[place[0.7]], second=[place[1.4]], held='held = ["lower"]'))
    assert (
        "blend both, and name the other one's patch in held, beside those that stay" in run(both, "--config", config)[1]
    )


FLAP = ["--select", "flap=upper box:1.2,0.9,3,2", "--surface", "flap", "--fixed", "upper", "--slide", "outlet:plane"]


def test_a_wall_that_ends_on_an_outlet(run, tmp_path):
    words = [*FLAP, "--hinge", "1.2,1", "--angle", "-5", "--motion", "blended"]
    code, error = run(strip(), *words)
    assert code == 2
    assert "name them by --driven" in error
    code, out = run(strip(), *words, "--driven", "outlet", "--out", tmp_path / "out.su2")
    assert code == 0, out
    assert "warning: nodes on outlet: 1 put back into its plane, up to 0.003" in out
    mesh, moved = (format_of(tmp_path / name).read(tmp_path / name) for name in ("mesh.su2", "out.su2"))
    assert (moved.points[moved.on("outlet"), 0] == 2.0).all()
    end = np.argmin(np.linalg.norm(mesh.points - [2, 1, 0], axis=1))
    assert moved.points[end, 1] == pytest.approx(1.0 - 0.8 * np.sin(np.radians(5.0)), abs=1e-12)


def test_a_box_around_a_mesh_whose_sides_all_slide(run):
    mesh = plate()
    (rest,) = mesh.patch("rest").faces
    middle = mesh.points[rest.nodes].mean(axis=1)
    sides = {"left": middle[:, 0] < -0.99, "right": middle[:, 0] > 0.99, "top": middle[:, 1] > 0.99}
    patches = [Patch(name, (Cells("line", rest.nodes[rows]),)) for name, rows in sides.items()]
    mesh = Mesh(mesh.points, mesh.cells, (*(mesh.patch(name) for name in ("hole", "bottom")), *patches))
    slides = [word for name in (*sides, "bottom") for word in ("--slide", f"{name}:plane")]
    words = ["--surface", "hole", *slides, "--hinge", "0,0", "--angle", "5"]
    assert run(mesh, *words, "--margin", "5")[0] == 0
    leaning = replace(mesh, points=mesh.points + 0.2 * mesh.points[:, [1, 0, 2]] * [1.0, 0.0, 0.0])
    code, error = run(leaning, *words, "--margin", "5")
    assert code == 2
    assert "nothing would hold the mesh; take a smaller box (margin), or name a side in fixed" in error
    code, out = run(leaning, *words, "--margin", "0.3")
    assert code == 0, out


@pytest.mark.parametrize("head", [b'    arch "LSB;scalar=64";\n', b""])
def test_labels_of_64_bits_without_arch_are_read(tmp_path, head):
    case = tmp_path / "case"
    format_of(case).write(block_with_body(), case)
    mesh = format_of(case).read(case)
    for path in (case / "constant/polyMesh").iterdir():
        data = path.read_bytes()
        arch = re.search(rb"    arch [^\n]*\n", data)[0] if b" arch " in data else b""
        if path.name in ("owner", "neighbour", "faces"):
            for count in re.findall(rb"\n(\d+)\n\(", data):
                at = data.index(b"\n%s\n(" % count) + len(count) + 3
                size = 4 * int(count)
                wide = np.frombuffer(data[at : at + size], "<i4").astype("<i8").tobytes()
                data = data[:at] + wide + data[at + size :]
        path.write_bytes(data.replace(arch, head) if arch else data)
    again = format_of(case).read(case)
    np.testing.assert_array_equal(again.points, mesh.points)
    for one, other in zip(again.cells, mesh.cells, strict=True):
        np.testing.assert_array_equal(one.owner, other.owner)
        np.testing.assert_array_equal(one.faces.nodes, other.faces.nodes)


def test_a_case_of_regions_alone_names_the_path_of_one(sdm, tmp_path):
    case = tmp_path / "case"
    format_of(case).write(block_with_body(), case)
    (case / "constant" / "fluid").mkdir()
    shutil.move(case / "constant/polyMesh", case / "constant/fluid/polyMesh")
    code, _, err = sdm("quality", case)
    assert code == 2
    assert "a mesh of its regions is in constant/fluid/polyMesh: name that path" in err
    code, out, err = sdm("quality", case / "constant/fluid/polyMesh", "--json")
    assert code == 0, err
    assert json.loads(out)["points"] == len(block_with_body().points)
