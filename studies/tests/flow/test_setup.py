"""What each patch of a mesh is to a flow solver, the free stream, hinges, and coefficients of forces."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.flow.forces import Forces, coefficients, hinge_moment
from studies.flow.setup import FreeStream, Hinge, Setup, kinds_of
from tests.deform.blocks import block_with_body, joined


def named(mesh, **names):
    return replace(
        mesh, patches=tuple(replace(patch, name=names.get(patch.name, patch.name)) for patch in mesh.patches)
    )


def merged(mesh, name, *parts):
    """The mesh with several patches as one."""
    kept = [patch for patch in mesh.patches if patch.name not in parts]
    return replace(mesh, patches=(*kept, Patch(name, mesh.faces_of(parts))))


SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")


def test_names_say_what_patches_are():
    mesh = named(merged(block_with_body(4), "far_field", *SIDES[:4], "z+"), **{"z-": "symmetry_plane"})
    assert kinds_of(mesh) == {"body": "wall", "far_field": "far", "symmetry_plane": "symmetry"}


def test_without_names_what_encloses_the_mesh_is_the_far_field():
    mesh = block_with_body(4)
    assert kinds_of(mesh) == {"body": "wall", **dict.fromkeys(SIDES, "far")}
    assert kinds_of(merged(mesh, "outer", *SIDES)) == {"body": "wall", "outer": "far"}


def test_a_side_of_the_mesh_beside_a_far_field_is_a_plane_of_symmetry():
    mesh = merged(block_with_body(4), "outer", *SIDES[1:])
    assert kinds_of(mesh) == {"body": "wall", "outer": "far", "x-": "symmetry"}
    assert kinds_of(block_with_body(4), ["x+", "y*"]) == {
        "body": "wall", "x+": "far", "y-": "far", "y+": "far", "x-": "symmetry", "z-": "symmetry", "z+": "symmetry",
    }  # fmt: skip


def test_a_closed_inlet_of_the_body_is_a_wall():
    assert kinds_of(named(merged(block_with_body(4), "outer", *SIDES), body="inlet"))["inlet"] == "wall"


def test_what_moves_is_a_wall_though_it_lies_in_a_side_of_the_mesh():
    mesh = merged(block_with_body(4), "outer", *SIDES[1:5])
    assert kinds_of(mesh, moving=["z+"]) == {"body": "wall", "x-": "symmetry", "z+": "wall", "outer": "far"}


def test_in_a_plane_mesh():
    """A square around a square: z has no room, and makes no side."""
    points = np.array([[x, y, 0.5] for x in range(4) for y in range(4)], dtype=float)
    quads = [
        [4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1] for i in range(3) for j in range(3) if (i, j) != (1, 1)
    ]
    inner, outer = [[5, 9], [9, 10], [10, 6], [6, 5]], [[0, 4], [4, 8], [8, 12], [15, 14], [3, 2], [2, 1], [1, 0]]
    lines = {"hole": inner, "rim": outer, "side": [[12, 13], [13, 14], [14, 15]]}
    mesh = Mesh(points, (Cells("quad", quads),), tuple(Patch(k, (Cells("line", v),)) for k, v in lines.items()))
    assert kinds_of(mesh) == {"hole": "wall", "rim": "far", "side": "symmetry"}


@pytest.mark.parametrize(
    ("mesh", "far", "said"),
    [
        (block_with_body(4), ["nosuch"], r"far field 'nosuch' is no patch"),
        (named(block_with_body(4), **{side: f"symmetry{i}" for i, side in enumerate(SIDES)}), [], r"--far-field"),
        (block_with_body(4), ["*"], r"no patch is a wall"),
    ],
)
def test_what_has_no_far_field_or_no_wall_is_refused(mesh, far, said):
    with pytest.raises(InputError, match=said):
        kinds_of(mesh, far)


def test_two_bodies_in_two_zones_have_walls_each():
    assert list(kinds_of(joined(block_with_body(4), block_with_body(4))).values()).count("wall") == 2


@pytest.mark.parametrize("given", [{"mach": 0.0}, {"mach": float("nan")}, {"alpha": 90.0}, {"pressure": -1.0}])
def test_a_free_stream_out_of_range_is_refused(given):
    with pytest.raises(InputError, match=f"{next(iter(given))} = .* must be between"):
        FreeStream(**given)


@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (7.0, -12.0)])
def test_directions_are_a_right_angled_frame(alpha, beta):
    drag, side, lift = frame = FreeStream(alpha=alpha, beta=beta).directions
    assert np.allclose(frame @ frame.T, np.eye(3))
    assert np.allclose(np.cross(lift, drag), side)
    assert (drag[2] > 0.0) == (alpha > 0.0)
    assert (drag[1] > 0.0) == (beta < 0.0)


def test_coefficients_have_the_signs_of_flight_mechanics():
    stream = FreeStream(mach=0.5)
    forces = Forces(np.array([5]), np.array([[1.0, 0.0, 3.0]]), np.array([[-2.0, 4.0, -6.0]]))
    found = coefficients(forces, Setup(stream, area=2.0, length=0.5, span=4.0))
    unit = stream.dynamic_pressure * 2.0
    expected = {"CL": 3.0, "CD": 1.0, "Cm": 4.0 / 0.5, "Cl": 2.0 / 4.0, "Cn": 6.0 / 4.0}
    assert {name: value.item() * unit for name, value in found.items()} == pytest.approx(expected)


def test_a_hinge_moment_is_that_about_its_axis():
    hinge = Hinge.through("flap", ["flap"], np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]))
    forces = Forces(np.array([5]), np.zeros((1, 3)), np.array([[1.0, 2.0, 9.0]]))
    assert hinge_moment(forces, hinge) == pytest.approx([0.6 + 1.6])
    assert hinge.renamed({"flap": "flap_"}).patches == ("flap_",)


def test_reports_of_several_starts_are_one_history(tmp_path):
    folder = tmp_path / "postProcessing" / "all"
    for start, rows in (("0", [5, 10, 15]), ("10", [15, 20])):
        (folder / start).mkdir(parents=True)
        for name, factor in (("force", 1.0), ("moment", 2.0)):
            lines = [f"{row} (({factor * row} 0 0) (0 0 0) (0 0 0))" for row in rows]
            (folder / start / f"{name}.dat").write_text("\n".join(["# Time", *lines, "25 ((1.5e"]))
    found = Forces.read(tmp_path, "all")
    assert found.iteration.tolist() == [5, 10, 15, 20]
    assert found.moment[:, 0].tolist() == [10.0, 20.0, 30.0, 40.0]
    for name in ("force", "moment"):  # OpenFOAM's names where it was stopped and begins at the same iteration again
        (folder / "10" / f"{name}_10.dat").write_text("# Time\n20 ((7 0 0))\n25 ((8 0 0))\n")
    again = Forces.read(tmp_path, "all")
    assert again.iteration.tolist() == [5, 10, 15, 20, 25]
    assert again.force[:, 0].tolist() == [5.0, 10.0, 15.0, 7.0, 8.0]
    (folder / "10" / "force.dat").write_text("15 ((1 0 0))\n20 ((1 0 x))\n")
    with pytest.raises(InputError, match=r"force\.dat: cannot be read"):
        Forces.read(tmp_path, "all")
    with pytest.raises(InputError, match="no forces are reported"):
        Forces.read(tmp_path, "flap")
