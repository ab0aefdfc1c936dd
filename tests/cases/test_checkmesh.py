"""What is said of faces and cells, beside what OpenFOAM's checkMesh says of the same files."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sdm_deflect.cases.run.inspection import file_figures, inspect
from sdm_deflect.cases.run.metrics import deflection_figures, face_rows
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.polyhedra import polyhedral_cells
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Periodic
from sdm_deflect.meshing.mesh.faces import FACES as OF_SHAPES
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.orthogonality import AffectedFaces, face_quality
from tests.cases import foam
from tests.cases.snappy import CONTROL
from tests.deform.blocks import block_with_body, grid
from tests.deform.jobs import placed, turn
from tests.meshing.formats.wing import wing

HEAD = "FoamFile { version 2.0; format ascii; class dictionary; object controlDict; }\n"
KEYS = ("non_orthogonality_max", "non_orthogonality_mean", "skewness_max")


def asked(mesh, folder):
    """What checkMesh prints of a mesh, with many digits."""
    OpenFoam().write(mesh, folder)
    (folder / "system/controlDict").write_text(HEAD + CONTROL)
    return foam.run("checkMesh", folder)


def wavy(mesh, size):
    """The mesh with all nodes that are on no patch moved at random."""
    free = np.setdiff1d(np.arange(len(mesh.points)), mesh.on(*mesh.names))
    points = mesh.points.copy()
    points[free] += np.random.default_rng(3).normal(0.0, size, (len(free), 3))
    return mesh.with_points(points)


def thin():
    """A plane case one cell thick."""
    points, cells = grid([0, 0, 0], [5, 40, 3], [5, 4, 1])
    points[:, :2] += np.repeat(np.random.default_rng(3).normal(0.0, 0.1, (30, 2)), 2, axis=0)
    sides = np.concatenate([cells[:, [0, 3, 2, 1]], cells[:, [4, 5, 6, 7]]])
    return Mesh(points, (Cells("hexahedron", cells),), (Patch("sides", (Cells("quad", sides),), constraint="empty"),))


@pytest.mark.parametrize(
    "mesh", [wavy(block_with_body(5), 0.1), wing(cells=3).mesh, thin()], ids=["block", "wing", "plane"]
)
def test_every_figure_is_that_of_checkmesh(mesh, tmp_path):
    found = foam.metrics(asked(mesh, tmp_path / "case"))
    own = file_figures(tmp_path / "case")["face_quality"]
    theirs = [found[name] for name in ("non-orthogonality", "mean non-orthogonality", "skewness")]
    assert [own[key] for key in KEYS] == pytest.approx(theirs, rel=1e-9)
    assert own["non_orthogonality_max"] > 5.0
    assert f"max {own['non_orthogonality_max']:.2f}" in inspect(tmp_path / "case")


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """The body turned a little, in a case of OpenFOAM."""
    folder = tmp_path_factory.mktemp("block") / "case"
    asked(block_with_body(8), folder)
    return turn(OpenFoam().read(folder), box=[[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]])


# Checks, and what checkMesh says where they fail.
COMPLAINTS = {
    "skewness_max": "***Max skewness",
    "non_orthogonality_max": "Number of non-orthogonality errors",
    "inverted_cells": "Error in face pyramids",
}


@pytest.mark.parametrize("seed", [5, 14, 19, 30])
def test_a_check_fails_where_checkmesh_complains(seed, turned, tmp_path):
    rng, points = np.random.default_rng(seed), turned.points.copy()
    free = turned.plan.boxes[0].region.inside
    some = rng.choice(free[(np.abs(turned.plan.mesh.points[free]) < 1.1).all(axis=1)], 6, replace=False)
    points[some] += rng.normal(0.0, 0.5 if seed < 30 else 0.05, (len(some), 3))
    worse = placed(turned, points)
    checks = {check.name: check for check in checks_of(worse)}
    said = asked(turned.plan.mesh.with_points(points), tmp_path / "case")
    for name, complaint in COMPLAINTS.items():
        at_fault = checks[name].value >= 90.0 if name == "non_orthogonality_max" else not checks[name].passed
        assert at_fault == (complaint in said), name
    assert ("Mesh OK." in said) == all(check.passed for check in checks.values()) == (seed == 30)


def bricks():
    """A block of cubes of size 1 as a case of OpenFOAM has it."""
    points, cells = grid([0, 0, 0], [4, 4, 4], [4, 4, 4])
    mesh = Mesh(points, (Cells("hexahedron", cells),), ())
    return replace(mesh, cells=(polyhedral_cells(mesh).cells,))


def pushed(points, height, push, zigzag):
    """Layers of a height, each pushed along those below, or along every second one."""
    level = points[:, 2] % 2 if zigzag else points[:, 2]
    return points * [1.0, 1.0, height] + push * np.outer(level, [1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("name", "change", "fault"),
    [
        ("skewness_max", (1.0, 4.5, True), True),
        ("non_orthogonality_max", (0.1, 2.0, False), False),
        ("", (0.2, 0.5, False), False),
    ],
)
def test_cells_that_are_not_inverted_fail_by_their_faces(name, change, fault, tmp_path):
    """Ours fails from 85 degrees on, checkMesh from 90."""
    mesh = bricks()
    affected = AffectedCells.of(mesh, np.arange(len(mesh.points)))
    moved = pushed(mesh.points, *change)
    faces = AffectedFaces.of(affected)
    failing = [row[0] for row in faces.verdicts(faces.at(moved)) if row[1] > row[2]]
    assert failing == [name] * bool(name)
    assert not affected.newly_inverted(moved).any()
    said = asked(mesh.with_points(moved), tmp_path / "case")
    assert ("Mesh OK." not in said) == fault


@pytest.fixture(scope="module", params=["shift", "rotation"])
def periodic(request, tmp_path_factory):
    """A case with a periodic pair, all of whose nodes are moved at random, and what checkMesh says of it."""
    (points, cells), rng = grid([0, 0, 0], [3, 3, 3], [3, 3, 3]), np.random.default_rng(4)
    base = points[:16] + [0.0, 2.0, 0.0] + rng.normal(0.0, 0.1, (16, 3)) * (points[:16, 1:].prod(axis=1) != 0)[:, None]
    turned = request.param == "rotation"
    turns = Rotation.from_rotvec(np.outer([0, -10, -20, -30] if turned else [0] * 4, [0, 0, 1]), degrees=True)
    shift = np.array([0.0, 0.0, 0.0] if turned else [2.0, 0.3, 0.1])
    planes = [turns[i].apply(base) + i / 3 * shift for i in range(4)]
    places = np.concatenate([planes[0], *(plane + rng.normal(0.0, 0.1, (16, 3)) for plane in planes[1:3]), planes[3]])
    sides = np.concatenate([cells[:, list(face)] for face in OF_SHAPES["hexahedron"]])
    on = [np.isin(sides, nodes).all(axis=1) for nodes in (np.arange(16), np.arange(48, 64))]
    patches = [Patch(name, (Cells("quad", sides[own]),)) for name, own in zip(("low", "high"), on, strict=True)]
    flat = Mesh(places, (Cells("hexahedron", cells),), tuple(patches))
    folder = tmp_path_factory.mktemp(request.param) / "case"
    OpenFoam().write(flat, folder)
    (folder / "system/controlDict").write_text(HEAD + CONTROL)
    boundary = folder / "constant/polyMesh/boundary"
    text = boundary.read_text()
    way = "rotational; rotationAxis (0 0 1); rotationCentre (0 0 0)" if turned else "translational"
    for name, other, sign in (("low", "high", 1.0), ("high", "low", -1.0)):
        vector = " ".join(map(repr, (sign * shift).tolist()))
        kind = f"type cyclic; neighbourPatch {other}; transform {way}; separationVector ({vector});"
        text = re.sub(rf"({name}\s*{{\s*)type\s+\w+;", rf"\g<1>{kind}", text)
    boundary.write_text(text)
    nodes = np.column_stack([np.arange(16), np.arange(48, 64)])
    pair = Periodic("low", ("low", "high"), nodes, turns[3].as_matrix(), shift)
    return replace(flat, cells=(polyhedral_cells(flat).cells,), periodic=(pair,)), foam.run("checkMesh", folder)


def test_faces_of_a_periodic_pair_are_between_two_cells(periodic):
    mesh, said = periodic
    assert "Coupled point location match" in said
    found, own = foam.metrics(said), face_quality(mesh)
    theirs = [found[name] for name in ("non-orthogonality", "mean non-orthogonality", "skewness")]
    assert [own.as_dict()[key] for key in KEYS] == pytest.approx(theirs, rel=1e-9)
    assert own.faces == 54 + 9
    assert face_quality(replace(mesh, periodic=())).non_orthogonality_mean != own.non_orthogonality_mean


def test_a_sheared_block_has_the_angle_by_which_it_is_sheared():
    mesh = bricks()
    found = face_quality(mesh.with_points(pushed(mesh.points, 1.0, np.tan(np.radians(40.0)), False)))
    assert found.non_orthogonality_max == pytest.approx(40.0, abs=1e-9)
    assert (found.faces, found.severe, found.skew) == (144, 0, 0)


def test_faces_at_fault_before_do_not_excuse_others():
    """As many faces are at fault as before, but others."""
    mesh = bricks()
    faces = AffectedFaces.of(AffectedCells.of(mesh, np.arange(len(mesh.points))))
    skewness, cosines = faces.before.skewness.copy(), faces.before.cosines.copy()
    skewness[3], cosines[5] = 6.0, np.cos(np.radians(88.0))
    before = faces.before._replace(skewness=skewness, cosines=cosines)
    known = replace(faces, before=before)
    other = before._replace(skewness=np.roll(skewness, 1), cosines=np.roll(cosines, 1))
    worse = before._replace(skewness=1.5 * skewness, cosines=np.where(cosines < 0.1, -0.1, cosines))
    for after, failing in ((before, []), (other, ["non_orthogonality_max", "skewness_max"]), (worse, ["non_ort"])):
        found = {row[0]: row for row in known.verdicts(after)}
        assert [name for name, row in found.items() if row[1] > row[2]] == [
            name for name in found if any(name.startswith(one) for one in failing)
        ]
    assert "1 newly above 4" in {row[0]: row[4] for row in known.verdicts(other)}["skewness_max"]


def test_figures_of_a_deflection_are_of_the_touched_cells_before_and_after(turned):
    figures = deflection_figures(turned)
    of, rows = face_rows(figures)
    assert of == "faces of the affected cells"
    assert len(rows) == 5
    affected = figures["face_quality"]["touched"]
    assert affected["after"]["non_orthogonality_max"] > affected["before"]["non_orthogonality_max"]
    assert affected["after"]["faces"] == affected["before"]["faces"] < face_quality(turned.plan.mesh).faces
