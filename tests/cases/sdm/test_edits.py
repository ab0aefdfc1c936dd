"""Whoever changes a file of a finished run is noticed: a check of a name fails, or a sentence says what is wrong."""

import csv
import shutil
from contextlib import suppress
from functools import partial

import numpy as np
import pytest

from sdm_deflect.cases.aircraft import validation
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import FinishedCase, undeflected_models
from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.report.data import read_figures
from sdm_deflect.cases.run.export import export_run
from sdm_deflect.cases.view.run import InteractiveRun
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.interpolant import SolveError
from sdm_deflect.geometry.errors import CadError
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.formats import vtu_write
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.vtu_write import write_vtu
from sdm_deflect.meshing.mesh import skin, tets_of, triangles_of
from tests.cases.sdm.deflected_cad import built
from tests.labelled import changed

pytestmark = pytest.mark.mesher
WING, FLAP = "wing_left", "aileron_left"


@pytest.fixture(scope="module")
def finished(finish):
    """A run and its folder."""
    return finish(case_named("aileron"), "aileron-bare")


@pytest.fixture(scope="module")
def judge(finished):
    """Validate a folder against CAD built once; return the checks by name."""
    case = finished[0].case
    models, verified = undeflected_models(case), {}

    def remembered(mesh, *rest):
        key = tuple(array.tobytes() for array in (mesh.points, tets_of(mesh), skin(mesh).triangles, skin(mesh).face))
        if key not in verified:
            verified[key] = verify(mesh, *rest)
        return verified[key]

    def call(folder):
        checks = FinishedCase.of(folder).checked(lambda: built(case), lambda _: models)
        return {check.name: check for check in checks}

    verify = validation.verify
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "verify", remembered)
        yield call


def meshes(folder):
    return read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")


def store(folder, before, after, **arrays):
    """Write both meshes, the second with the arrays that belong to it, but for those given."""
    own = {"quality": mean_ratio(after.points, tets_of(after))}
    if len(after.points) == len(before.points):
        own["displacement"] = after.points - before.points
    own = {name: values for name, values in (own | arrays).items() if values is not None}
    on_points, on_cells = ({name: own[name]} if name in own else {} for name in ("displacement", "quality"))
    write_vtu(folder / "undeflected.vtu", before)
    write_vtu(folder / "deflected.vtu", after, on_points, on_cells)


def inside(before, after):
    """Nodes that moved, those on the boundary left out."""
    moved = np.flatnonzero((before.points != after.points).any(axis=1))
    return np.setdiff1d(moved, before.on(*before.names))


def moved(change):
    """Change the points of deflected.vtu: `change(points, before, after)` writes into them."""

    def edit(folder):
        before, after = meshes(folder)
        points = after.points.copy()
        change(points, before, after)
        store(folder, before, after.with_points(points))

    return edit


def share(factor):
    def change(points, before, after):
        own = inside(before, after)
        points[own] = before.points[own] + factor * (after.points - before.points)[own]

    return moved(change)


def noise(size, count=None):
    def change(points, before, after):
        own = inside(before, after)[:count]
        points[own] += size * np.random.default_rng(1).uniform(-1.0, 1.0, (len(own), 3))

    return moved(change)


def wall(shift, patch=FLAP):
    """Move a node within a patch by so much along a unit vector in its face and along its normal."""

    def change(points, before, after):
        node, across, normal = frame(after, patch)
        points[node] += shift[0] * across + shift[1] * normal

    return moved(change)


def frame(mesh, patch):
    """A node inside a planar face of a patch, a unit vector in the face and its normal."""
    own = triangles_of(mesh, patch)
    corners = mesh.points[own]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    others = mesh.on(*(name for name in mesh.names if name != patch))
    for node in np.setdiff1d(own, others):
        around = normals[(own == node).any(axis=1)]
        if np.abs(around - around[0]).max() < 1e-9:
            triangle = corners[(own == node).any(axis=1)][0]
            along = triangle[1] - triangle[0]
            return node, along / np.linalg.norm(along), around[0]
    raise AssertionError(patch)


def bit(points, before, after):
    outer = np.setdiff1d(np.flatnonzero((before.points == after.points).all(axis=1)), before.on(*before.names))
    points[outer[0], 2] = np.nextafter(points[outer[0], 2], 1.0)


def fixed_bit(points, before, after):
    node = before.on("fin")[0]
    points[node, 0] = np.nextafter(points[node, 0], 9.0)


def inverted(points, before, after):
    points[inside(before, after)[0]] += [0.0, 0.0, 0.05]


def undone(points, before, after):
    points[:] = before.points


def in_both(change):
    """Change the cells and labels of both meshes: `change(mesh)` returns another one."""

    def edit(folder):
        before, after = map(change, meshes(folder))
        store(folder, before, after)

    return edit


def in_one(change):
    """Change those of deflected.vtu alone."""

    def edit(folder):
        before, after = meshes(folder)
        store(folder, before, change(after))

    return edit


def without_cells(rows, mesh):
    return changed(mesh, tets=np.delete(tets_of(mesh), rows, axis=0))


def doubled(rows, mesh):
    return changed(mesh, tets=np.vstack([tets_of(mesh), tets_of(mesh)[rows]]))


def inside_out(mesh):
    tets = tets_of(mesh).copy()
    tets[7] = tets[7][[1, 0, 2, 3]]
    return changed(mesh, tets=tets)


def with_triangles(keep, mesh):
    return changed(mesh, triangles=skin(mesh).triangles[keep], patch=skin(mesh).patch[keep], face=skin(mesh).face[keep])


def without_third(mesh):
    own = np.flatnonzero(skin(mesh).patch == mesh.names.index(FLAP))
    return with_triangles(np.delete(np.arange(len(skin(mesh).patch)), own[::3]), mesh)


def flipped(mesh):
    own, triangles = skin(mesh).patch == mesh.names.index(WING), skin(mesh).triangles.copy()
    triangles[own] = triangles[own][:, ::-1]
    return changed(mesh, triangles=triangles)


def relabelled(mesh):
    patch = skin(mesh).patch.copy()
    patch[np.flatnonzero(patch == mesh.names.index(WING))[0]] = mesh.names.index("fuselage")
    return changed(mesh, patch=patch)


def other_face(mesh):
    face = skin(mesh).face.copy()
    own = np.flatnonzero(skin(mesh).patch == mesh.names.index("fin"))
    face[own] = np.roll(face[own], len(own) // 2)
    return changed(mesh, face=face)


def foreign_face(mesh):
    return changed(mesh, face=np.where(skin(mesh).face == skin(mesh).face.max(), 9999, skin(mesh).face))


def renamed(mesh):
    return changed(mesh, names=tuple("flap" if name == FLAP else name for name in mesh.names))


def names_swapped(mesh):
    other = {FLAP: "aileron_right", "aileron_right": FLAP}
    return changed(mesh, names=tuple(other.get(name, name) for name in mesh.names))


def reordered(mesh):
    return changed(mesh, tets=tets_of(mesh)[::-1])


def with_node(mesh):
    return changed(mesh, points=np.vstack([mesh.points, mesh.points[:1] + 0.1]))


def both_moved(patch, shift):
    """Move a node of a patch in both meshes, in its face and along its normal."""

    def edit(folder):
        before, after = meshes(folder)
        node, across, normal = frame(before, patch)
        step = np.zeros_like(before.points)
        step[node] = shift[0] * across + shift[1] * normal
        store(folder, before.with_points(before.points + step), after.with_points(after.points + step))

    return edit


def cylinder_moved(folder):
    before, after = meshes(folder)
    step = np.zeros_like(before.points)
    step[before.on("fuselage")[100]] = [0.0, 0.0, 1e-3]
    store(folder, before.with_points(before.points + step), after.with_points(after.points + step))


def gone(name):
    return lambda folder: (folder / name).unlink()


def content(name, data):
    return lambda folder: (folder / name).write_bytes(data)


def half(name):
    return lambda folder: content(name, (folder / name).read_bytes()[: (folder / name).stat().st_size // 2])(folder)


def text(name, old, new):
    def edit(folder):
        path = folder / name
        whole = path.read_text()
        assert old in whole
        path.write_text(whole.replace(old, new, 1))

    return edit


def rows(change):
    """Change the rows of convergence.csv."""

    def edit(folder):
        path = folder / "convergence.csv"
        table = list(csv.reader(path.read_text().splitlines()))
        change(table)
        with path.open("w", newline="") as file:
            csv.writer(file).writerows(table)

    return edit


EDITS = {
    "a cell turned inside out by a node": (moved(inverted), "inverted_cells"),
    "a wall node off its face by 1e-8 m": (wall((0.0, 1.01e-8)), "exact_to_cad"),
    "a fixed wall node slid by 1e-8 m": (wall((1e-8, 0.0), WING), "fixed_surfaces_moved"),
    "an outside node by one bit": (moved(bit), "outside_moved"),
    "a fixed wall node by one bit": (moved(fixed_bit), "fixed_surfaces_moved"),
    "deflected.vtu is not deflected": (moved(undone), "exact_to_cad"),
    "1 tetrahedron deleted in both": (in_both(partial(without_cells, [7])), "undeflected_mesh"),
    "1 tetrahedron doubled in both": (in_both(partial(doubled, [7])), "undeflected_mesh"),
    "1 tetrahedron turned inside out in both": (in_both(inside_out), "inverted in the file"),
    "tetrahedra in another order in deflected.vtu": (in_one(reordered), "differ in tets"),
    "a node of no cell in both": (in_both(with_node), "undeflected_mesh"),
    "a node of no cell in deflected.vtu": (in_one(with_node), "differ in their number of points"),
    "a third of the aileron's triangles deleted in both": (in_both(without_third), "undeflected_mesh"),
    "triangles flipped in both": (in_both(flipped), "undeflected_mesh"),
    "triangles flipped in deflected.vtu": (in_one(flipped), "differ in triangles"),
    "a triangle relabelled in both": (in_both(relabelled), "undeflected_mesh"),
    "a triangle relabelled in deflected.vtu": (in_one(relabelled), "differ in patch"),
    "CAD faces exchanged in both": (in_both(other_face), "undeflected_mesh"),
    "CAD faces exchanged in deflected.vtu": (in_one(other_face), "differ in face"),
    "a CAD face that does not exist in both": (in_both(foreign_face), "undeflected_mesh"),
    "a patch renamed in both": (in_both(renamed), "no patch aileron_left"),
    "names exchanged in both": (in_both(names_swapped), "aileron_left"),
    "names exchanged in deflected.vtu": (in_one(names_swapped), "differ in names"),
    "a fuselage node moved by 1 mm in both": (cylinder_moved, "undeflected_mesh"),
    "deflected.vtu missing": (gone("deflected.vtu"), "deflected.vtu"),
    "undeflected.vtu truncated": (half("undeflected.vtu"), "undeflected.vtu"),
    "interpolant.npz missing": (gone("interpolant.npz"), "interpolant.npz"),
    "case.toml missing": (gone("case.toml"), "case.toml"),
    "case.toml: angle by 1e-7 deg": (text("case.toml", "angle = -12.0", "angle = -12.0000001"), "trailing_edge_angle"),
    "metrics.json missing": (gone("metrics.json"), "metrics.json"),
    "convergence.csv missing": (gone("convergence.csv"), "convergence.csv"),
    "convergence.csv: a row removed": (rows(lambda table: table.pop(-3)), "do not count up"),
}  # fmt: skip
"""What is changed, how, and the check that fails or a part of the sentence."""


def test_an_unchanged_run_passes(finished, judge):
    run, folder = finished
    checks = judge(folder)
    own = {"undeflected_mesh"}
    assert {name: check.verdict for name, check in checks.items()} == dict.fromkeys(
        {check.name for check in run.checks} | own, "passed"
    )


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_noticed(finished, judge, tmp_path, name):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    edit, by = EDITS[name]
    edit(folder)
    assert by in noticed(judge, folder)


def noticed(judge, folder):
    """Names of the checks that fail, or the sentence that refuses the folder."""
    try:
        return [check.name for check in judge(folder).values() if not check.passed]
    except (RuntimeError, ValueError) as error:
        if is_reported(error):
            return str(error)
        raise


FILES = ("case.toml", "metrics.json", "interpolant.npz", "convergence.csv", "undeflected.vtu", "deflected.vtu")


def damages(data, rng, most):
    """Yield a file's bytes with single bits flipped, cut, emptied and replaced."""
    for place in rng.integers(len(data), size=most):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        yield bytes(flipped)
    for share in (0.5, 0.1, 0.99)[:most]:
        yield data[: int(share * len(data))]
    yield from (b"", b"junk")[:most]


@pytest.mark.parametrize("most", [1, pytest.param(4, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_leaves_no_traceback(finished, judge, tmp_path, name, most):
    folder, rng = shutil.copytree(finished[1], tmp_path / "run"), np.random.default_rng(len(name))
    data = (folder / name).read_bytes()
    for damage in damages(data, rng, most):
        (folder / name).write_bytes(damage)
        for command in (judge, shown, read_figures, exported):
            with suppress(InputError, MeshFileError, MeshingError, SolveError, CadError):
                command(folder)


@pytest.mark.parametrize(("part", "message"), [("points", "not finite"), ("patch", r"patch holds 0 \.\.\. 99")])
def test_a_point_that_is_no_number_and_a_patch_that_is_none_are_refused(finished, tmp_path, monkeypatch, part, message):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    mesh = read_vtu(folder / "deflected.vtu")
    if part == "points":
        points = mesh.points.copy()
        points[0] = np.nan
        object.__setattr__(mesh, "points", points)  # past the checks of a new mesh
    else:
        wrong = skin(mesh)
        wrong.patch[0] = 99
        monkeypatch.setattr(vtu_write, "skin", lambda mesh: wrong)
    write_vtu(folder / "deflected.vtu", mesh)
    for command in (FinishedCase.of, shown, exported):
        with pytest.raises(MeshFileError, match=message):
            command(folder)


def shown(folder):
    """Prepare the view of a run."""
    return InteractiveRun.of(FinishedCase.of(folder))


def exported(folder):
    """Write the deflected mesh for a flow solver."""
    export_run(folder, "su2", "deflected", folder.with_suffix(".su2"))
