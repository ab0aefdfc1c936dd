"""Reports of any mesh: sections tile the plane, pictures take every cell, the folder makes the page anew."""

import json
import re
from base64 import b64decode
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import chain

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.cases.report import folder as folders
from sdm_deflect.cases.report.data import MESH_UNITS, METRES, in_view
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.report.folder import PART, part_of, write_arrays, write_run_folder
from sdm_deflect.cases.report.page import page
from sdm_deflect.cases.report.pictures import Gallery
from sdm_deflect.cases.report.scene3d import TABLES, _corners, turnable
from sdm_deflect.cases.report.slices import CutPlane, by_size, cut_cells, cut_walls, planes, triangles_of
from sdm_deflect.cases.run.output import RUN, check_installed
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.surface.surface import name_of
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_of
from tests.cases.conftest import UNFOLD
from tests.deform.blocks import block_with_body, two_bodies
from tests.limits import limited
from tests.meshing.formats.examples import hybrid, polyhedral
from tests.meshing.formats.wing import wing

FILES = {
    "convergence.csv", "deflected.vtu", "interpolant.npz", "metrics.json", "report.html", "settings.toml",
}  # fmt: skip
EVERYWHERE = np.array([[-9.0] * 3, [9.0] * 3])


def plane(axis, station):
    return CutPlane(axis, station, "a plane", EVERYWHERE)


def area(polygon):
    x, y = polygon.T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def sections(mesh, cut):
    return list(chain.from_iterable(cut_cells(mesh.points, block, cut)[0] for block in mesh.cells))


@pytest.fixture(scope="module")
def coarse_wing():
    return wing(cells=3)


@pytest.mark.parametrize("whole", [block_with_body(), polyhedral(block_with_body())], ids=["hexahedra", "polyhedra"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sections_tile_the_plane(whole, axis):
    mesh = replace(whole, zones=())
    through = sections(mesh, plane(axis, 0.1))
    assert sum(map(area, through)) == pytest.approx(16.0 - 1.0, rel=1e-12)
    assert sum(map(area, sections(mesh, plane(axis, 0.9)))) == pytest.approx(16.0, rel=1e-12)
    walls = cut_walls(mesh, mesh.points, plane(axis, 0.1), mesh.names)
    lengths = np.linalg.norm(np.diff(walls, axis=1), axis=-1)
    assert lengths.sum() == pytest.approx(4 * 4.0 + 4 * 1.0, rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sections_of_all_types_are_those_of_polyhedra(axis):
    mesh = hybrid()
    middle = mesh.points.mean(axis=0) + 0.013
    both = [sections(one, plane(axis, middle[axis])) for one in (mesh, polyhedral(mesh))]
    areas = [sorted(map(area, some)) for some in both]
    np.testing.assert_allclose(areas[0], areas[1], rtol=1e-12)


CORNER, BASE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
UNIT = {
    "tetra": ([*CORNER, [0, 0, 1]], 1 / 6),
    "pyramid": ([*BASE, [0, 0, 1]], 1 / 3),
    "wedge": ([*([x, y, 1] for x, y, _ in CORNER), *CORNER], 1 / 2),
    "hexahedron": ([*BASE, *([x, y, 1] for x, y, _ in BASE)], 1.0),
}


@pytest.mark.parametrize("shape", UNIT)
def test_triangles_of_the_turnable_picture_enclose_the_cell(shape):
    points, volume = np.array(UNIT[shape][0], dtype=float), UNIT[shape][1]
    assert quality_of(points, Cells(shape, np.arange(len(points))[None]))[0] > 0.5
    table = np.reshape(TABLES[shape], (-1, 3))
    edges = np.vstack([table[:, [0, 1]], table[:, [1, 2]], table[:, [2, 0]]])
    assert {tuple(edge) for edge in edges} == {tuple(edge[::-1]) for edge in edges}
    a, b, c = points[table].transpose(1, 0, 2)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(volume, rel=1e-12)


def test_faces_of_any_size_are_cut_into_triangles():
    mesh = polyhedral(hybrid())
    faces = mesh.cells[0].faces
    sizes = np.diff(faces.offsets)
    assert {cells.shape[1]: len(cells) for cells in by_size([faces])} == {
        int(k): int((sizes == k).sum()) for k in np.unique(sizes)
    }
    assert len(triangles_of([faces])) == (sizes - 2).sum()


@pytest.mark.parametrize("whole", [hybrid(), replace(polyhedral(hybrid()), zones=())], ids=["cells", "polyhedra"])
def test_part_of_a_mesh_keeps_the_quality_of_its_cells(whole):
    rows = [np.arange(0, len(block), 2) for block in whole.cells]
    some, node = part_of(whole, rows, np.array([3]))
    np.testing.assert_array_equal(some.points, whole.points[node])
    for block, own, kept in zip(whole.cells, rows, some.cells, strict=True):
        expected = quality_of(whole.points, block, own)
        np.testing.assert_allclose(quality_of(some.points, kept), expected, rtol=1e-12)
    for patch, cut in zip(whole.patches, some.patches, strict=True):
        assert len(cut) == sum((faces.nodes == 3).any(axis=1).sum() for faces in patch.faces)


def test_folder_holds_all_and_makes_the_page_anew(coarse_wing, tmp_path, monkeypatch):
    source, out = tmp_path / "wing.su2", tmp_path / "out" / "bent.su2"
    format_of(source).write(coarse_wing.mesh, source)
    mesh = replace(format_of(source).read(source), name="wing.su2", source=str(source))
    one = deflect(Plan.of(mesh, [blended(coarse_wing.hinge)]), (3.0,))
    checks = tuple(checks_of(one))
    folder = folders.folder_of(out)
    data = write_run_folder(folder, one, checks, out, {"deflect": one.seconds})
    assert {path.name for path in folder.iterdir() if path.is_file()} == FILES
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    assert not [name for name in files if not any(fnmatchcase(name, pattern) for pattern in RUN)]
    stored = json.loads((folder / "metrics.json").read_text())
    assert stored["mesh"]["points"] == len(mesh.points)
    assert set(stored["quality_inside"]["after"]) == {"hexahedron", "wedge", "pyramid", "tetra"} & {
        q.shape for q in one.quality
    }
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".json", ".toml", ".vtu")}
    (folder / "report.html").unlink()
    again = FinishedRun.of(folder).report()
    np.testing.assert_array_equal(again.points, one.points)
    assert again.checks == checks
    assert turnable(again) == turnable(data)
    assert before == {name: (folder / name).read_bytes() for name in before}
    drawn = [FinishedRun.of(folder).report("svg") and (folder / "figures" / "quality.svg").read_bytes() for _ in (1, 2)]
    assert drawn[0] == drawn[1]
    assert b"<svg" in drawn[0]
    FinishedRun.of(folder).report()
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".png"}
    text = (folder / "report.html").read_text()
    assert re.findall(r'<figure class="(\w+)">', text) == ["paper", "slices", "quality", "convergence"]
    assert "Distance from CAD" not in text
    for key in ("mesh", "timings", "deflections", "version", "total_seconds", "motion"):
        for figures in ({name: one for name, one in stored.items() if name != key}, stored | {key: "many"}):
            harmless = key in figures if key == "version" else key == "motion" and key not in figures
            if not harmless:
                with pytest.raises(InputError, match=r"metrics\.json"):
                    page(replace(data, figures=figures), Gallery(()))
    limited(monkeypatch, shown=10)
    write_arrays(folder, one, whole=False)
    assert (folder / "deflected.vtu").stat().st_size < 0.8 * len(before["deflected.vtu"])
    np.testing.assert_array_equal(FinishedRun.of(folder).report().points, one.points)
    source.write_bytes(source.read_bytes().replace(b"NDIME= 3", b"NDIME= 4"))
    with pytest.raises(MeshFileError, match=r"wing\.su2"):
        FinishedRun.of(folder).report()
    format_of(source).write(hybrid(), source)
    with pytest.raises(InputError, match=rf"has 14 points, but {len(mesh.points)} when it was deflected"):
        FinishedRun.of(folder).report()
    format_of(source).write(coarse_wing.mesh, source)
    for name, text in (("interpolant.npz", "PK"), ("metrics.json", "{}"), ("settings.toml", "= 1")):
        (folder / name).write_text(text)
        with pytest.raises(InputError, match=r"no whole folder of a run|no table of figures|no archive of arrays"):
            FinishedRun.of(folder).report()


def blended(hinge):
    from sdm_deflect.cases.settings.job_settings import job_settings

    surface = {"patches": ["flap_*"], "hinge": hinge.tolist(), "angle": 3.0, "motion": "blended"}
    return jobs_of(job_settings({"surface": [surface], "fixed": ["wing_*"]}))[0]


@pytest.mark.parametrize("whole", [True, False])
def test_a_note_says_when_the_file_is_a_part_of_the_mesh(whole, coarse_wing, tmp_path, monkeypatch):
    one = deflect(Plan.of(coarse_wing.mesh, [blended(coarse_wing.hinge)]), (3.0,))
    limited(monkeypatch, shown=10**9 if whole else 1)
    write_run_folder(tmp_path, one, (), None, {})
    path = tmp_path / "deflected.vtu"
    cells = sum(format_of(path).read(path).cell_counts)
    assert (cells == sum(one.plan.mesh.cell_counts)) == whole
    notes = [note for note in json.loads((tmp_path / "metrics.json").read_text())["notes"] if "holds only" in note]
    assert notes == ([] if whole else [PART.format(cells=cells)])


def test_the_command_that_repeats_it_is_typed_outside_the_folder(coarse_wing, tmp_path):
    """It replaces the folder of the report, so a shell within would stand in a folder that is gone."""
    mesh = replace(coarse_wing.mesh, source=str(tmp_path / "a wing.su2"))
    one = deflect(Plan.of(mesh, [blended(coarse_wing.hinge)]), (3.0,))
    data = write_run_folder(tmp_path / "scratch", one, (), tmp_path / "out.su2", {})
    assert data.repeat == "sdm deflect 'a wing.su2' --config out-report/settings.toml"


@pytest.mark.nightly
def test_polyhedra_and_nodes_alone_have_a_report(tmp_path):
    block = block_with_body()
    loose = Mesh(block.points, (), tuple(Patch(p.name, (), p.nodes) for p in block.patches))
    hinge = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    for name, mesh in (("polyhedra", replace(polyhedral(block), zones=())), ("nodes", loose)):
        job = Job((Moving(("body",), Rotation.about(*hinge), 5.0),))
        one = deflect(Plan.of(mesh, [job]), (5.0,))
        data = write_run_folder(tmp_path / name, one, tuple(checks_of(one)), None, {})
        text = (tmp_path / name / "report.html").read_text()
        pictures = set(re.findall('<figure class="([a-z]+)"', text)) - {"paper"}
        assert pictures == ({"slices", "quality", "convergence"} if mesh.cells else {"convergence"})
        assert ("scaled Jacobian" in text) == bool(mesh.cells)
        assert data.drawn == ("body",)
        with pytest.raises(InputError, match="names no mesh"):
            FinishedRun.of(tmp_path / name).report()


def test_page_of_a_hybrid_mesh_is_turnable(coarse_wing, opened, tmp_path):
    one = deflect(Plan.of(coarse_wing.mesh, [blended(coarse_wing.hinge)]), (3.0,))
    data = write_run_folder(tmp_path, one, tuple(checks_of(one)), None, {})
    tab, _, complaints = opened(tmp_path / "report.html")
    tab.evaluate(UNFOLD)
    tab.locator("#scene-threshold").fill("0.6")
    blocks = zip(data.mesh.cells, one.plan.affected.rows, strict=True)
    quality = np.concatenate([quality_of(one.points, block, rows) for block, rows in blocks])
    said = f"{(quality < 0.6).sum()} of {len(quality)} cells below 0.60, 0 inverted"
    assert tab.locator("#scene-count").inner_text() == said
    assert all(re.search(r"\d", image.get_attribute("alt")) for image in tab.locator("img:not(#still)").all())
    assert complaints == []


def test_names_of_a_mesh_cannot_inject_markup(coarse_wing, opened, tmp_path):
    evil = "</script><script>document.title='broken'</script>"
    named = {"symmetry": evil}
    patches = tuple(Patch(named.get(p.name, p.name), p.faces) for p in coarse_wing.mesh.patches)
    one = deflect(Plan.of(replace(coarse_wing.mesh, patches=patches, name=evil), [blended(coarse_wing.hinge)]), (3.0,))
    data = write_run_folder(tmp_path, one, tuple(checks_of(one)), None, {})
    (tmp_path / "report.html").write_text(page(data, Gallery(())), encoding="utf-8")
    tab, _, complaints = opened(tmp_path / "report.html")
    assert tab.title().startswith(evil)
    assert tab.locator("script").count() == 5
    assert complaints == []


@pytest.mark.parametrize("cells", [lambda mesh: mesh, polyhedral], ids=["as they are", "polyhedra"])
def test_pictures_of_the_near_cells_are_those_of_all(cells, coarse_wing):
    mesh = replace(cells(coarse_wing.mesh), zones=())
    data = folders.data_of(deflect(Plan.of(mesh, [blended(coarse_wing.hinge)]), (3.0,)))
    near = data.near
    assert 0 < sum(map(len, near.mesh.cells)) < sum(map(len, mesh.cells))
    one, other = turnable(near), turnable(data)
    own, whole = ([(g["shape"], g["rows"], g["points"]) for g in s.pop("cells")["groups"]] for s in (one, other))
    assert one == other
    assert own == whole
    assert near.worst() == pytest.approx(data.worst(), rel=1e-12)
    for plane_of in planes(data, data.boxes[0], data.surfaces[0]):
        areas = [
            sorted(area(p) for block in one.mesh.cells for p in cut_cells(data.points, block, plane_of)[0])
            for one in (data, near)
        ]
        assert len(areas[0]) > 10
        np.testing.assert_allclose(areas[1], areas[0], rtol=1e-12)


def test_the_last_section_is_where_layers_changed_most(coarse_wing, tmp_path):
    one = deflect(Plan.of(coarse_wing.mesh, [blended(coarse_wing.hinge)]), (25.0,))
    checks = tuple(checks_of(one))
    (check,) = (check for check in checks if check.name == "layer_height")
    assert check.value > 0.1
    data = write_run_folder(tmp_path, one, checks, None, {})
    *others, last = planes(data, data.boxes[0], data.surfaces[0])
    assert last.what == "where layers changed most"
    assert [one.what for one in others] == ["section at half span", "at the worst cell"]
    np.testing.assert_array_equal(last.window, check.window)
    assert check.window[0][1] < last.station < check.window[1][1]


def test_without_its_libraries_a_report_has_all_but_the_page(coarse_wing, tmp_path, monkeypatch):
    monkeypatch.setattr("sdm_deflect.cases.run.output.find_spec", lambda name: None if name == "jinja2" else name)
    one = deflect(Plan.of(coarse_wing.mesh, [blended(coarse_wing.hinge)]), (3.0,))
    write_run_folder(tmp_path, one, tuple(checks_of(one)), None, {})
    assert {path.name for path in tmp_path.iterdir()} == FILES - {"report.html"}
    with pytest.raises(InputError, match=r"needs jinja2: in your clone, pip install '.\[report\]'"):
        check_installed("report")


def test_far_field_is_not_drawn_at_first(coarse_wing):
    shown = in_view(coarse_wing.mesh, tuple(n for n in coarse_wing.mesh.names if n.startswith(("wing", "flap"))))
    assert set(coarse_wing.mesh.names) - set(shown) == {"symmetry", "far_field"}


def test_a_plane_of_symmetry_near_the_body_hides_nothing():
    # With a side among the parts the other sides are not much larger, but as wide as the mesh along two axes.
    assert in_view(block_with_body(), ("body", "x-")) == ("body", "x-")


@pytest.mark.parametrize(
    ("patches", "name"),
    [(("flap_upper", "flap_lower"), "flap"), (("flap",), "flap"), (("a1", "b1", "c1"), "a1 and 2 more")],
)
def test_surfaces_are_called_what_their_patches_share(patches, name):
    assert name_of(patches) == name


def test_lengths_are_shown_in_their_unit():
    assert METRES.text(0.0123) == "12.3 mm"
    assert MESH_UNITS.text(0.0123) == "0.0123 mesh units"


def test_the_command_writes_a_folder_unless_told_not_to(coarse_wing, tmp_path, sdm):
    source = tmp_path / "wing.su2"
    format_of(source).write(coarse_wing.mesh, source)
    hinge = [",".join(map(str, point)) for point in coarse_wing.hinge.tolist()]
    common = ["deflect", source, "--surface", "flap_*", "--fixed", "wing_*", "--motion", "blended", "-q",
              "--angle", "3", "--hinge", *hinge]  # fmt: skip

    assert sdm(*common, "--no-report", "--out", tmp_path / "bare.su2")[0] == 0
    assert not (tmp_path / "bare-report").exists()
    assert sdm(*common, "--out", tmp_path / "bent.su2")[0] == 0
    assert (tmp_path / "bent.su2").read_bytes() == (tmp_path / "bare.su2").read_bytes()
    assert sdm("report", tmp_path / "bent-report")[0] == 0
    (tmp_path / "foreign-report").mkdir()
    code, _, complaint = sdm(*common, "--out", tmp_path / "foreign.su2")
    assert code == 2
    assert "is no earlier report" in complaint
    assert not (tmp_path / "foreign.su2").exists()


def test_an_angle_of_a_sweep_is_told_as_it_is(coarse_wing, tmp_path):
    plan = Plan.of(coarse_wing.mesh, [blended(coarse_wing.hinge)], ((3.0,), (-1.0,)))
    data = write_run_folder(tmp_path, deflect(plan, (-1.0,)), (), None, {})
    assert [surface.amount_text for surface in data.surfaces] == ["\N{MINUS SIGN}1\N{DEGREE SIGN}"]
    assert "angle = -1.0" in (tmp_path / "settings.toml").read_text()
    assert data.title == "mesh: flap by \N{MINUS SIGN}1\N{DEGREE SIGN}"
    assert data.headline == "mesh: flap \N{MINUS SIGN}1\N{DEGREE SIGN}"


def test_turnable_cells_of_polyhedra_are_those_of_their_types_or_triangles_of_their_own():
    mesh = replace(polyhedral(block_with_body()), zones=())
    hinge = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    one = deflect(Plan.of(mesh, [Job((Moving(("body",), Rotation.about(*hinge), 5.0),))]), (5.0,))
    (group,) = turnable(folders.data_of(one))["cells"]["groups"]
    rows = one.plan.affected.rows[0]
    assert (group["shape"], group["corners"], group["cell"]) == ("hexahedron", 8, None)
    assert len(b64decode(group["rows"])) == 4 * len(rows)
    alone, triangles = _corners(mesh.cells[0], rows)
    assert np.bincount(np.frombuffer(b64decode(alone["cell"]), "<u4")).tolist() == [12] * len(rows)
    assert triangles.shape == (12 * len(rows), 3)


def test_a_label_stands_at_the_tip_of_each_surface():
    hinge = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    one = deflect(Plan.of(block_with_body(), [Job((Moving(("body",), Rotation.about(*hinge), 5.0),))]), (5.0,))
    scene = turnable(folders.data_of(one))
    (label,) = scene["labels"]
    assert (label["name"], label["amount"], label["own"]) == ("body", "+5\N{DEGREE SIGN}", "body")
    node = one.plan.mesh.on("body")[label["row"]]
    moved = np.linalg.norm(one.points - one.plan.mesh.points, axis=1)
    assert moved[node] >= 0.35 * moved.max()
    assert [view["name"] for view in scene["views"]] == ["surfaces", "everything"]


def test_faces_that_go_through_others_are_drawn():
    one = deflect(
        Plan.of(two_bodies(), [Job((Moving(("left",), Rotation.about([-1.25, -1, 0], [-1.25, 1, 0]), 5.0),))]), (5.0,)
    )
    data = folders.data_of(one).with_verdict(tuple(checks_of(one)), {})
    assert turnable(data)["crossed"]["segments"] == ""
    points = one.points.copy()
    points[data.mesh.on("left")] += [2.0, 0.3, 0.2]
    failed = tuple(replace(check, value=1.0) if check.name == "surfaces_crossed" else check for check in data.checks)
    crossed = turnable(replace(data, points=points, checks=failed))["crossed"]["segments"]
    places = np.frombuffer(b64decode(crossed), "<f4").reshape(-1, 3)
    assert len(places) > 0
    known = {tuple(place) for place in points.astype("<f4").tolist()}
    assert {tuple(place) for place in places.tolist()} <= {tuple(np.float32(x) for x in place) for place in known}
