"""A plan is of a mesh: it answers for all its nodes, however they were read, and refuses another mesh."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect as sdm
from sdm_deflect import InputError, MeshMotion
from sdm_deflect.deform.plan_file import digest
from sdm_deflect.deform.volume import places
from sdm_deflect.deform.volume.places import hashes
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.cases.test_apply import decompose
from tests.deform.blocks import block_with_body, joined, two_bodies
from tests.deform.plates import plate
from tests.deform.test_mesh_motion import AROUND_BOTH, SLAT_AND_FLAP
from tests.limits import limited

TURN = {"hinge": [[0, -0.6, 0], [0, 0.6, 0]], "range": (-8, 5)}
FILES = ("mesh.su2", "mesh.cgns", "mesh.msh", "mesh.b8.ugrid", "mesh.vtu", "case")


def written(mesh, folder, name):
    """A mesh in a file or a case."""
    path = folder / name
    if name == "case":
        OpenFoam().write(mesh, path)
    else:
        FORMATS["gmsh" if name.endswith(".msh") else path.suffix[1:]].write(mesh, path)
    return path


def shifted(mesh, by):
    return mesh.with_points(mesh.points + np.asarray(by))


@pytest.fixture(scope="module")
def block():
    return block_with_body(8)


@pytest.fixture(scope="module")
def held(block):
    return sdm.plan(block, "body", **TURN)


@pytest.fixture(scope="module")
def other(block):
    """The same surfaces in another volume mesh: interior nodes stand elsewhere."""
    points = block.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), block.on(*block.names))
    points[inner] += 1e-3 * np.random.default_rng(2).normal(size=(len(inner), 3))
    return block.with_points(points)


@pytest.mark.parametrize("pieces", [False, True])
@pytest.mark.parametrize("name", FILES)
def test_a_plan_by_path_has_the_bits_of_a_plan_by_mesh(name, pieces, block, tmp_path, monkeypatch):
    path = written(block, tmp_path, name)
    mesh = sdm.read(path)
    expected = sdm.plan(mesh, "body", **TURN)
    if pieces:
        limited(monkeypatch, file=0, in_memory=0, points=97, cells=61)
    found = sdm.plan(path, "body", **TURN)
    assert bool(found.plan.mesh.whole) == (pieces and name not in ("mesh.vtu", "mesh.msh"))
    gradient = np.random.default_rng(1).normal(size=mesh.points.shape)
    assert found.at(3).shape == mesh.points.shape
    for amount in (-8.0, 0.0, 3.3):
        assert found.at(amount).tobytes() == expected.at(amount).tobytes()
        assert found.jvp(amount, 1).tobytes() == expected.jvp(amount, 1).tobytes()
        assert found.vjp(amount, gradient).tobytes() == expected.vjp(amount, gradient).tobytes()
    assert np.array_equal(found.places.places, expected.places.places)
    (tmp_path / "x" / "constant").mkdir(parents=True)
    found.save_openfoam(tmp_path / "x")
    size = len(mesh.points)
    assert (tmp_path / "x" / "0" / "X0").read_bytes().count(mesh.points.astype("<f8").tobytes()) == 1
    with pytest.raises(InputError, match=rf"gradient \({size - 1}, 3\) must be \({size}, 3\)"):
        found.vjp(3, gradient[1:])


@pytest.mark.parametrize("pieces", [False, True])
def test_plane_meshes_and_two_zones_by_path(pieces, block, tmp_path, monkeypatch):
    flat = {"hinge": [0.1, 0.0], "range": (-9, 9), "box": [[-0.55, -0.55], [0.55, 0.55]]}
    cases = (
        (plate(20, "quad"), "hole", "plate.su2", flat),
        (joined(block, shifted(block, [9, 0, 0])), "body", "two.cgns", TURN),
        (joined(shifted(block, [9, 0, 0]), block), "body'", "second.cgns", TURN | {"force": True}),
    )
    for mesh, name, file, given in cases:
        FORMATS[file.rpartition(".")[2]].write(mesh, tmp_path / file)
        mesh = sdm.read(tmp_path / file)
        surface = name if name in mesh.names else next(one for one in mesh.names if one.endswith(name.rstrip("'")))
        surface = mesh.names[-len(mesh.names) // 2 :][[*block.names].index("body")] if name == "body'" else surface
        expected = sdm.plan(mesh, surface, **given)
        with pytest.MonkeyPatch.context() as patch:
            if pieces:
                limited(patch, file=0, in_memory=0, points=97, cells=61)
            found = sdm.plan(tmp_path / file, surface, **given)
        assert found.at(4).tobytes() == expected.at(4).tobytes()
        assert (found.at(4) != mesh.points).any()
        assert np.array_equal(found.places.places, expected.places.places)


def test_a_plan_of_one_amount_by_path_is_its_deflection(block, tmp_path, monkeypatch):
    path = written(block, tmp_path, "mesh.su2")
    given = {"hinge": TURN["hinge"], "angle": 5.0}
    expected = sdm.deflect(sdm.read(path), "body", **given).points
    whole = sdm.plan(path, "body", **given)
    limited(monkeypatch, file=0, in_memory=0, points=97, cells=61)
    for one in (whole, sdm.plan(path, "body", **given)):
        assert one.at(5).tobytes() == expected.tobytes()
        assert one.at(0).tobytes() == block.points.tobytes()
        with pytest.raises(InputError, match="4: the plan is of 5 alone"):
            one.at(4)


def test_a_plan_of_one_pose_of_two_surfaces_serves_no_other(tmp_path):
    mesh = two_bodies()
    given = [
        {"patches": name, "hinge": SLAT_AND_FLAP[name]["hinge"], "angle": angle}
        for name, angle in (("left", 0.0), ("right", -3.0))
    ]
    one = sdm.plan(mesh, given, box=AROUND_BOTH)
    expected = sdm.deflect(mesh, given, box=AROUND_BOTH).points
    one.save(tmp_path / "one.npz")
    for found in (one, MeshMotion.load(tmp_path / "one.npz", mesh.points)):
        assert found.at((0, -3)).tobytes() == expected.tobytes()
        assert found.at({"right": -3}).tobytes() == expected.tobytes()
    given[0]["angle"] = 2.0
    both = sdm.plan(mesh, given, box=AROUND_BOTH)
    for pose in ((2, 0), {"right": -3}, (2, -1)):
        with pytest.raises(InputError, match="the plan is of 2, -3 alone"):
            both.at(pose)


def test_one_way_to_ask_for_an_amount(held, block, tmp_path):
    held.save(tmp_path / "p.npz")
    loaded = MeshMotion.load(tmp_path / "p.npz")
    plans = held, held.on(block.points), loaded.on(block.points), MeshMotion.load(tmp_path / "p.npz", block.points)
    expected = held.at(3)
    for one in plans:
        for amount in (3, 3.0, np.float32(3), {"body": 3}, (3,), [3.0], np.array([3.0])):
            assert one.at(amount).tobytes() == expected.tobytes(), amount
        for wrong, said in (
            (None, "must be a number"), ("3", "must be a number"), (True, "must be a number"), (3 + 0j, "must be a"),
            ({"tail": 3}, "'tail' is no surface"), ((3, 3), "has 1 surfaces"), (np.nan, "outside its range"),
        ):  # fmt: skip
            with pytest.raises(InputError, match=said):
                one.at(wrong)
        with pytest.raises(InputError, match="speeds = nan must be finite"):
            one.jvp(3, np.nan)
        with pytest.raises(InputError, match="gradient: a coordinate is not finite"):
            one.vjp(3, np.full(block.points.shape, np.nan))


def test_nodes_are_found_in_any_order_and_partition(held, block):
    rng = np.random.default_rng(3)
    order = rng.permutation(len(block.points))
    table = held.places
    place = table.find(block.points)
    assert np.array_equal(table.places[place[place >= 0]], block.points[place >= 0])
    assert sorted(place[place >= 0]) == list(range(len(table.places)))
    for rows in np.array_split(order, 5):
        assert np.array_equal(table.find(block.points[rows]), place[rows])
    row = np.flatnonzero(place >= 0)[7]
    near = block.points.copy()
    near[row, 1] = np.nextafter(near[row, 1], 9.0)
    assert table.find(near)[row] == -1
    assert table.nearly(near[row : row + 1]) == 1
    assert np.array_equal(hashes(np.array([[0.0, -0.0, 1.0]])), hashes(np.array([[-0.0, 0.0, 1.0]])))


def test_nodes_of_a_zone_that_stays_do_not_move_in_the_box_of_another(block):
    both = joined(block, shifted(block, [0.31, 0.17, 0.05]))
    plan = sdm.plan(both, "body", **TURN)
    assert plan.on(both.points).at(4).tobytes() == plan.at(4).tobytes()
    assert (plan.at(4)[len(block.points) :] == both.points[len(block.points) :]).all()
    inside = np.flatnonzero(plan.places.contains(both.points[len(block.points) :], [0]))
    assert len(inside) > 50
    moved = both.points.copy()
    moved[plan.rows[0][3], 0] += 0.01
    with pytest.raises(InputError, match=r"measured on another mesh: 1 of its \d+ nodes are not among them"):
        plan.on(moved)
    with pytest.raises(InputError, match="1 are near a place of the plan"):
        plan.on(both.points[plan.rows[0]] + np.eye(len(plan.rows[0]), 1) * [[1e-9, 0.0, 0.0]])


def test_places_with_one_hash_are_told_apart(held, block, monkeypatch):
    twice = joined(block, block)
    bodies = ["body", twice.names[len(twice.names) // 2 + [*block.names].index("body")]]
    both = sdm.plan(twice, bodies, **TURN)
    expected = held.places.find(block.points), both.places.find(twice.points)
    monkeypatch.setattr(places, "hashes", lambda points: np.floor(3.0 * points[:, 0]).astype(np.int64).view(np.uint64))
    assert np.array_equal(replace(held.places).find(block.points), expected[0])
    again = replace(both).places
    assert len(again.places) == len(both.places.places)
    assert np.array_equal(again.find(twice.points), expected[1])


def test_places_of_a_lattice_have_hashes_of_their_own():
    axis = np.arange(-40.0, 40.0)
    lattice = np.stack(np.meshgrid(axis, 0.5 * axis, 0.25 * axis), axis=-1).reshape(-1, 3)
    assert len(np.unique(hashes(lattice))) == len(lattice)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda mesh, held: 1000.0 * mesh.points, r"times 0\.001 they would be those of the plan"),
        (lambda mesh, held: np.round(mesh.points + 1e-9, 7), "measured on another mesh|near a place"),
        (lambda mesh, held: mesh.points + 1e-9, "near a place of the plan, but not on it: give all digits"),
        (lambda mesh, held: mesh.points.astype("f4").astype("f8"), "near a place of the plan|measured on another mesh"),
        (lambda mesh, held: held.at(5), "measured on another mesh"),
        (lambda mesh, held: np.vstack([mesh.points, [[0.0, 0.0, 0.61]]]), "measured on another mesh"),
    ],
)
def test_points_of_another_mesh_are_refused(change, said, tmp_path):
    mesh = block_with_body(9)
    points = mesh.points + 0.01 * np.sin(5.0 * mesh.points[:, [1, 2, 0]])
    mesh = mesh.with_points(points)
    one = sdm.plan(mesh, "body", **TURN)
    with pytest.raises(InputError, match=said):
        one.on(change(mesh, one))
    warp = pytest.importorskip("openmdao.api"), pytest.importorskip("sdm_deflect.openmdao")
    problem = warp[0].Problem(reports=False)
    problem.model.add_subsystem("warp", warp[1].Warp(plan=one, points=change(mesh, one)))
    with pytest.raises(InputError, match=said):
        problem.setup()


def test_another_volume_mesh_with_the_same_surfaces_is_refused(held, block, other, sdm_command, tmp_path):
    held.save(tmp_path / "p.npz")
    FORMATS["su2"].write(other, tmp_path / "other.su2")
    with pytest.raises(InputError, match="measured on another mesh"):
        held.on(other.points)
    with pytest.raises(InputError, match=r"is of another mesh: \d+ of its \d+ places are points of other\.su2"):
        sdm.read(tmp_path / "other.su2").moved_by(held, 3)
    code, _, said = sdm_command("apply", tmp_path / "p.npz", "--angle", "3", tmp_path / "other.su2", "--quiet")
    assert (code, "p.npz: is of another mesh" in said) == (2, True)
    assert not (tmp_path / "other-deflected.su2").exists()
    np.savez(tmp_path / "s.npz", sensitivity=np.ones(other.points.shape))
    words = ["gradient", tmp_path / "s.npz", "--plan", tmp_path / "p.npz", "--at", "3"]
    code, _, said = sdm_command(*words, "--mesh", tmp_path / "other.su2")
    assert (code, "is of another mesh" in said) == (2, True)
    OpenFoam().write(other, tmp_path / "case")
    code, _, said = sdm_command("export", tmp_path / "p.npz", "--format", "openfoam", "--out", tmp_path / "case")
    assert (code, "is of another mesh" in said) == (2, True)
    assert not (tmp_path / "case" / "0").exists()


@pytest.fixture
def sdm_command(sdm):
    """The command; `sdm` is the package here."""
    return sdm


def test_parts_of_a_case_are_compared(held, block, other, sdm_command, tmp_path):
    """Of some parts places may be missing; a point in the box that is no place is of another mesh."""
    held.save(tmp_path / "p.npz")
    for name, mesh in (("case", block), ("other", other)):
        OpenFoam().write(mesh, tmp_path / name)
        decompose(tmp_path / name, 12, "writeFormat binary; writePrecision 17;")
    turn = ["apply", tmp_path / "p.npz", "--angle", "3"]
    code, said, _ = sdm_command(*turn, *(tmp_path / "case").glob("processor*"))
    assert (code, "in none of these meshes" in said) == (0, False)
    for parts in ((tmp_path / "other").glob("processor*"), [tmp_path / "other" / "processor1"]):
        code, _, said = sdm_command(*turn, *parts)
        assert (code, "is of another mesh" in said) == (2, True)
    shutil.rmtree(tmp_path / "case-deflected")
    code, said, _ = sdm_command(*turn, tmp_path / "case" / "processor1", "--json", "--quiet")
    told = json.loads(said)
    assert code == 0
    assert 0 < told["missing"] < told["places"] == len(held.places.places)


def test_a_mesh_moved_by_a_plan_is_saved_in_three_lines(held, block, tmp_path):
    held.save(tmp_path / "p.npz")
    FORMATS["cgns"].write(joined(block, shifted(block, [9, 0, 0])), tmp_path / "two.cgns")
    FORMATS["su2"].write(block, tmp_path / "block.su2")
    mesh = sdm.read(tmp_path / "block.su2")
    for plan in (held, MeshMotion.load(tmp_path / "p.npz")):
        mesh.moved_by(plan, {"body": 3}).save(tmp_path / "moved.su2")
        assert np.array_equal(sdm.read(tmp_path / "moved.su2").points, held.at(3))
    two = sdm.read(tmp_path / "two.cgns")
    with pytest.raises(InputError, match="none of its zones"):
        two.moved_by(held, 3)
    plan = sdm.plan(two, next(name for name in two.names if name.endswith("body")), **TURN)
    assert two.moved_by(plan, 3).points.tobytes() == plan.at(3).tobytes()


def test_an_earlier_version_of_the_file_is_refused(held, tmp_path):
    held.save(tmp_path / "p.npz")
    with np.load(tmp_path / "p.npz") as stored:
        arrays = dict(stored) | {"kind": np.array("plan of sdm-deflect, 1")}
    np.savez(tmp_path / "old.npz", **arrays)
    with pytest.raises(InputError, match="an earlier version wrote it; make the plan again"):
        MeshMotion.load(tmp_path / "old.npz")


@pytest.fixture(scope="module")
def stored(held, tmp_path_factory):
    """The arrays of a plan's file but its digest, and a function that loads others with a right digest."""
    folder = tmp_path_factory.mktemp("stored")
    held.save(folder / "p.npz")
    with np.load(folder / "p.npz") as file:
        arrays = {name: file[name] for name in file.files if name != "digest"}

    def refusal(name, value):
        """The sentence on a file with another value; empty if it moves the mesh as before."""
        changed = {key: np.asarray(one) for key, one in (arrays | {name: value}).items() if one is not None}
        np.savez(folder / "bad.npz", **changed, digest=np.array(digest(changed)))
        try:
            found = MeshMotion.load(folder / "bad.npz", held.plan.mesh.points)
        except InputError as error:
            return str(error)
        return "" if np.array_equal(found.at(3), held.at(3)) else "other mesh"

    return arrays, refusal


def wrong_arrays(array):
    """Yield none, and arrays of other types, shapes and sizes."""
    yield from (None, [array, array], np.zeros((0, 7)))
    yield np.zeros(3) if array.dtype.kind == "U" else array.astype("U")
    if array.dtype.kind == "f" and array.size:
        yield from (1e300 * (array + 1.0), np.full_like(array, np.nan))


def test_no_array_of_the_file_can_be_another(stored):
    arrays, refusal = stored
    for name, array in arrays.items():
        for wrong in wrong_arrays(array):
            said = refusal(name, wrong)
            assert said.count("\n") == 0
            assert "bad.npz: " in said or (said == "" and not array.size), (name, said)


def places_in(value, at=()):
    """Yield the way to each value of JSON."""
    yield at
    inner = value.items() if isinstance(value, dict) else enumerate(value if isinstance(value, list) else ())
    for key, one in inner:
        yield from places_in(one, (*at, key))


def test_no_value_of_its_text_can_be_of_another_kind(stored):
    arrays, refusal = stored
    for *way, last in list(places_in(json.loads(str(arrays["plan"]))))[1:]:
        for wrong in (None, [], {}, 1e300, True, float("nan")):
            content = json.loads(str(arrays["plan"]))
            inner = content
            for key in way:
                inner = inner[key]
            if wrong == inner[last] or (wrong == [] and (last == "failed" or way == ["measured"])):
                continue  # no check failed, or nothing was measured
            inner[last] = wrong
            said = refusal("plan", np.array(json.dumps(content)))
            assert "bad.npz: " in said or last in ("least", "site_error", "high", "low"), (way, last, wrong, said)
            assert said.count("\n") == 0


def test_a_plan_is_never_written_over_other_files(held, tmp_path):
    for path, said in (
        (tmp_path / "mine.npz", "this program did not write it"), (tmp_path, "is there and no file"),
        (tmp_path / "p.npz" / "x.npz", "cannot be written|Not a directory"),
    ):  # fmt: skip
        np.savez(tmp_path / "mine.npz", x=np.arange(3))
        (tmp_path / "p.npz").write_bytes(b"")
        with pytest.raises(InputError, match=said):
            held.save(path)
    with np.load(tmp_path / "mine.npz") as stored:
        assert stored["x"].tolist() == [0, 1, 2]
    held.save(tmp_path / "real.npz")
    (tmp_path / "link.npz").symlink_to("real.npz")
    replace(held, source="other.su2").save(tmp_path / "link.npz")
    assert (tmp_path / "link.npz").is_symlink()
    assert MeshMotion.load(tmp_path / "real.npz").source == "other.su2"
