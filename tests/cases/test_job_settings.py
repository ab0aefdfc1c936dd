"""Jobs from options, TOML and keywords: the same names mean the same, and a mistake is one sentence."""

from dataclasses import replace
from tomllib import loads

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.settings.conversion import structure, to_toml
from sdm_deflect.cases.settings.job_settings import (
    JobSettings,
    angles_of,
    job_settings,
    read_job,
    settings_of,
    with_options,
)
from sdm_deflect.cases.settings.jobs import jobs_of, swept
from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.surface import Listed, OnPatches, TrailingEdge
from sdm_deflect.deform.volume.job import in_proportion

HINGE = [[0.7, 0, 0], [0.7, 1, 0]]
OWN = Rotation.about(*np.array(HINGE))
TWO = """
box = [[-3, -1, -1], [3, 1, 1]]
max_centers = 900
slide = { symmetry = "plane" }
[[surface]]
patches = ["left"]
hinge = [[-1, 0, 0], [-1, 1, 0]]
angle = 12
[[surface]]
patches = "right"
hinge = [[1, 0, 0], [1, 1, 0]]
angle = -6
motion = "blended"
held = [3, 4, 5]
"""


@pytest.fixture
def two(tmp_path):
    (tmp_path / "job.toml").write_text(TWO)
    return read_job(tmp_path / "job.toml")


def test_a_configuration_of_two_surfaces(two):
    job = jobs_of(job_settings(two))[0]
    assert in_proportion([job], (4.0,)) == ((4.0, -2.0),)
    assert job.fitting.max_centers == 900
    assert [(one.patch, one.shape) for one in job.slides] == [("symmetry", "plane")]
    assert job.surfaces[1].motion.held.nodes.tolist() == [3, 4, 5]


def test_options_replace_what_a_configuration_says(two):
    options = {"angle": 4.0, "fixed": ("wing",), "slide": {"root": "cylinder"}, "hinge": None, "patches": ()}
    job = jobs_of(job_settings(with_options(two, options, ["max_centers=700", "box=auto", "margin=0.5"])))[0]
    assert job.amounts == (4.0, -2.0)
    assert job.fixed == ("wing",)
    assert {one.patch for one in job.slides} == {"symmetry", "root"}
    assert (job.fitting.max_centers, job.box) == (700, Automatic(0.5))
    only = jobs_of(job_settings(with_options(two, {"patches": ("flap",), "hinge": HINGE, "angle": 0.0})))[0]
    assert [one.patches for one in only.surfaces] == [("flap",)]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_mirrored_surface_moves_as_a_mirror_image_by_the_same_angle(sign):
    flap = {"patches": ["left"], "hinge": [[0.1, 0.2, 0.0], [0.3, 1.0, 0.2]], "angle": 7.0, "range": [-5.0, 9.0]}
    jobs = jobs_of(job_settings({"surface": [{**flap, "mirror": ["right"], "sign": sign}]}))
    (one,), (other,) = (job.surfaces for job in jobs)
    assert (other.patches, other.amount, other.range) == (
        ("right",),
        7.0 * sign,
        tuple(sorted((-5.0 * sign, 9.0 * sign))),
    )
    points, flip = np.random.default_rng(3).normal(size=(9, 3)), np.array([1.0, -1.0, 1.0])
    moved = one.motion.axis.displacement(points, one.amount)
    np.testing.assert_allclose(
        other.motion.axis.displacement(points * flip, sign * other.amount), moved * flip, atol=1e-15
    )


@pytest.mark.parametrize("hinge", [HINGE, HINGE[::-1], [[0.0, 0.0, 0.0], [0.3, 0.2, 1.0]]])
@pytest.mark.parametrize(("word", "sign"), [("down", -1.0), ("up", 1.0)])
def test_down_and_up_are_those_of_the_trailing_edge_whatever_the_hinge(hinge, word, sign):
    row = 2 if hinge[0][2] == hinge[1][2] else 1
    surface = {"patches": ["flap"], "hinge": hinge, word: 5.0, "vertical": "xyz"[row]}
    (moving,) = jobs_of(job_settings({"surface": [surface]}))[0].surfaces
    aft = moving.motion.axis.point + np.array([[1.0, 0.0, 0.0]])
    assert sign * moving.motion.axis.displacement(aft, moving.amount)[0, row] > 0.05
    assert abs(moving.amount) == 5.0


def test_in_a_plane_mesh_y_is_up():
    (moving,) = jobs_of(job_settings({"surface": [{"patches": ["flap"], "hinge": [[0.7, 0.0]], "down": 5.0}]}))[
        0
    ].surfaces
    assert moving.amount == -5.0
    with pytest.raises(InputError, match="set vertical = y"):
        jobs_of(job_settings({"surface": [{"patches": ["fin"], "hinge": [[0, 0, 0], [0, 0, 1]], "down": 5.0}]}))


def test_a_table_of_amounts_has_a_column_for_each_surface_in_any_order(tmp_path):
    (tmp_path / "rows.csv").write_text("third,first,second\n3,1,2\n30,10,20\n")
    rows = [{"patches": [name], "hinge": HINGE} for name in ("first", "second", "third")]
    assert swept(job_settings({"surface": rows}), tmp_path / "rows.csv")[1] == ((1.0, 2.0, 3.0), (10.0, 20.0, 30.0))


def test_toml_repeats_the_settings(two):
    settings = job_settings(with_options(two, {}, ["surface=[]", "tolerance=1e-5"]))
    for one in (job_settings(two), settings, JobSettings()):
        assert structure(loads(to_toml(one)), JobSettings) == one
    text = to_toml(job_settings(two))
    assert all(name in text for name in ("strategy", "tolerance", "spacing_edges", "max_steps", "strip", "driven"))


def test_files_are_relative_to_the_configuration(tmp_path):
    (tmp_path / "job.toml").write_text(
        'box = "box.toml"\n[[surface]]\npatches = "a"\nhinge = [[0,0,0],[0,1,0]]\nangle = 1\nmotion = "blended"\n'
        'held = "held.txt"\ndriven = "edges:30"\n'
    )
    (tmp_path / "box.toml").write_text("corners = [[0, 0, 0], [1, 1, 1]]")
    (tmp_path / "held.txt").write_text("1\n2\n")
    job = jobs_of(job_settings(read_job(tmp_path / "job.toml")))[0]
    assert job.box.hexahedron.corners.max() == 1.0
    assert job.surfaces[0].motion.held.nodes.tolist() == [1, 2]
    assert job.surfaces[0].motion.driven == TrailingEdge(30.0)
    (tmp_path / "box.toml").write_text("corner = 3")
    with pytest.raises(InputError, match=r"box\.toml: .*corner.*did you mean corners"):
        jobs_of(job_settings(read_job(tmp_path / "job.toml")))[0]


def job_of(surfaces, hinge, angle, options):
    return jobs_of(settings_of(surfaces, hinge, angle, options))[0]


def test_keywords_are_the_same_settings():
    options = {"fixed": "wing*", "slide": {"symmetry": "plane"}, "motion": "blended", "tolerance": 1e-5}
    job = job_of("flap", np.array(HINGE), np.float64(15), options)
    assert (job.surfaces[0].patches, job.angle, job.fixed) == (("flap",), 15.0, ("wing*",))
    assert job.fitting.tolerance == 1e-5
    assert job.surfaces[0].motion.held == OnPatches(("wing*",))
    corners = np.array([[-1.0, -1, -1], [2, 2, 2]])
    assert job_of(["a", "b"], HINGE, 3, {"box": corners}).box.hexahedron.corners.max() == 2.0
    assert job_of("a", HINGE, 3, {"box": Automatic(2.0)}).box == Automatic(2.0)
    assert job_of("a", HINGE, 3, {"fitting": replace(job.fitting, max_centers=500)}).fitting.max_centers == 500
    own = Blended(Rotation.about(*np.array(HINGE)), Listed(np.arange(3)))
    assert job_of("a", None, 3, {"motion": own}).surfaces[0].motion is own
    held = job_of("a", HINGE, 3, {"motion": "blended", "held": np.arange(3)}).surfaces[0].motion.held
    assert held.nodes.tolist() == [0, 1, 2]


def test_python_takes_the_words_of_the_command():
    def job(**options):
        return jobs_of(settings_of("flap", HINGE, 5.0, options))[0]

    for slide in ("symmetry:plane", "symmetry:plane,root:cylinder", ["symmetry:plane"], {"symmetry": "plane"}):
        assert (job(slide=slide).slides[0].patch, job(slide=slide).slides[0].shape) == ("symmetry", "plane")
    blended = job(motion="blended", fixed="wing*,tip", held="rib, hinge", driven="edges:30", box="auto", strip=0.1)
    motion = blended.surfaces[0].motion
    assert (blended.fixed, motion.held.names, motion.rib.share) == (("wing*", "tip"), ("rib", "hinge"), 0.1)
    assert motion.driven == TrailingEdge(30.0)
    assert jobs_of(settings_of("flap", HINGE, np.array(5.0), {"tolerance": None, "slide": None}))[0].angle == 5.0
    hexahedron = box(np.zeros(3), np.ones(3))
    assert job(box=hexahedron).box.hexahedron is hexahedron


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("a", HINGE, "15"), {}, "angle = '15' is not a number"),
        (("a", HINGE, None), {}, "the angle of a is missing"),
        (("a", HINGE, float("nan")), {}, "angle = nan is not a finite number"),
        (("a", [[0, 0, 0]], 5), {}, "hinge = ((0.0, 0.0, 0.0),): must be two points"),
        ((5, HINGE, 5), {}, "surfaces = 5 is no list of names"),
        (([], HINGE, 5), {}, "no surface to move"),
        (("a", HINGE, 5), {"tolerence": 1}, "unknown setting tolerence; did you mean tolerance?"),
        (("a", HINGE, 5), {"tolerance": "abc"}, "tolerance = 'abc' is not a number"),
        (("a", HINGE, 5), {"strategy": "both"}, "strategy = 'both' is not one of squv, mv"),
        (("a", HINGE, 5), {"min_quality": 2}, "min_quality = 2 must be a number from 0 to 1"),
        (("a", HINGE, 5), {"allow_inverted": "false"}, "allow_inverted = 'false' is neither true nor false"),
        (("a", HINGE, 5), {"box": "none.toml"}, "none.toml"),
        (("a", HINGE, 5), {"box": [[0, 0, 0]]}, "the box"),
        (("a", HINGE, 5), {"slide": "symmetry"}, "slide = symmetry: must be NAME:plane"),
        (("a", HINGE, 5), {"surface": []}, "unknown setting surface; did you mean surfaces?"),
        (("a", HINGE, 5), {"patches": "b"}, "unknown setting patches; did you mean surfaces?"),
        (("a", HINGE, 5), {"amount": 0.5}, "unknown setting amount; did you mean angle?"),
        (("a", HINGE, 5), {"strip": 0.1}, "strip = 0.1: a rigid motion has no use for it"),
        (("a", HINGE, 5), {"motion": OWN, "driven": "b"}, "driven = 'b': the motion has its own"),
        (("a", [[0, 0, 0], [0, 0, 1]], 5), {"motion": OWN}, "the motion has another one; leave hinge out"),
        (("a", HINGE[::-1], 5), {"motion": OWN}, "the motion has another one; leave hinge out"),
        (("a", HINGE, 5), {"margin": 1, "box": HINGE}, "margin = 1: only the automatic box has a margin"),
        (([{"patches": "a"}], HINGE, None), {}, "hinge belongs to one surface"),
        (([{"patches": "a"}], None, 5), {}, "angle belongs to one surface"),
        (([{"patches": "a", "hinge": HINGE}], None, None), {}, "the angle of a is missing"),
        (([{"patches": "a"}, {"patches": "b", "angel": 3}], None, None), {}, "unknown setting surfaces[1].angel"),
        (("a", HINGE, 5), {"slide": {"symmetry": "ball"}}, "slide.symmetry = 'ball' is not one of plane, cylinder"),
        (("a", HINGE, 5), {"motion": "bent"}, "motion = 'bent' is not one of rigid, blended"),
        (("a", HINGE, 5), {"motion": "blended", "held": ""}, "held = '' is empty"),
        (("a", HINGE, 5), {"motion": "blended", "held": [1, "a"]}, "held must be patches, or indices of nodes"),
        (("a", HINGE, 5), {"motion": "blended", "driven": "edges:x"}, "driven = edges:x"),
        (("a", None, 5), {"table": "none.csv"}, "none.csv"),
    ],
)
def test_a_wrong_argument_is_named(arguments, options, message):
    with pytest.raises(InputError) as caught:
        job_of(*arguments, options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "--" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("surfaces = 3", "unknown setting surfaces; did you mean surface"),
        ("surface = 5", "surface = 5 is not a list"),
        ("[surface]\npatches = 'a'", "surface = {'patches': 'a'} is not a list"),
        ("[[surface]]\nangle = 3", "patches is missing"),
        (
            "[[surface]]\npatches = 'a'\n[[surface]]\npatches = 'b'\nhinge = true",
            "surface[1].hinge = True is not a list",
        ),
        ("[[surface", "job.toml"),
        ("fixed = " + 3000 * "[" + 3000 * "]", "job.toml"),
    ],
)
def test_a_wrong_configuration_is_one_sentence(text, message, tmp_path):
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        job_settings(read_job(tmp_path / "job.toml"))
    assert message in str(caught.value)


def test_a_motion_of_ones_own_cannot_be_written():
    settings = structure({"surface": [{"patches": "a", "motion": Rotation.about(*np.array(HINGE))}]}, JobSettings)
    with pytest.raises(InputError, match="no file can hold"):
        to_toml(settings)


@pytest.mark.parametrize(
    ("text", "angles"),
    [
        ("-30:30:30", (-30.0, 0.0, 30.0)),
        ("0:1:0.4", (0.0, 0.4, 0.8)),
        ("5,1,5", (5.0, 1.0)),
        ("6:-6:-6", (6.0, 0.0, -6.0)),
    ],
)
def test_ranges_of_angles(text, angles):
    assert angles_of(text) == pytest.approx(angles)


def test_angles_of_python_keep_their_order():
    assert angles_of([5, -3.0, np.float64(5.0)]) == (5.0, -3.0, 5.0)
    assert angles_of(np.array([0.0, 2.0])) == angles_of(range(0, 3, 2)) == angles_of(x for x in (0, 2)) == (0.0, 2.0)


@pytest.mark.parametrize("text", ["1:2:0", "1:2:-1", "a", "", "1:2:3:4", "0:1:1e-9", "nan", "5,nan", "0:100:50"])
def test_ranges_that_are_none(text):
    with pytest.raises(InputError, match="angles = "):
        angles_of(text)


def test_periodic_patches_are_pairs_of_names_or_tables():
    for given in (("a", "b"), [("a", "b")], [{"patches": "a,b"}], {"patches": ["a", "b"]}):
        (pair,) = jobs_of(settings_of("flap", HINGE, 5.0, {"periodic": given}))[0].periodic
        assert (pair.first, pair.second, pair.axis, pair.translation) == ("a", "b", None, None)
    table = {"patches": ["a", "b"], "axis": [[0, 1, 0], [2, 1, 0]]}
    one, other = jobs_of(settings_of("flap", HINGE, 5.0, {"periodic": [table, ("c", "d")]}))[0].periodic
    assert (one.axis.direction.tolist(), one.axis.point.tolist(), other.first) == ([1, 0, 0], [0, 1, 0], "c")
    table = {"patches": ["a", "b"], "translation": [0, 2]}
    assert jobs_of(settings_of("flap", HINGE, 5.0, {"periodic": table}))[0].periodic[0].translation.tolist() == [
        0,
        2,
        0,
    ]


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("ab", "periodic = 'ab' is not a list"),
        (("a", "b", "c"), "periodic ('a', 'b', 'c'): two patches are images of one another"),
        ({"patches": ["a", "b"], "axis": [[0, 0, 0]]}, "periodic a b: axis = "),
        ({"patches": ["a", "b"], "axis": [[0, 0, 0], [0, 0, 0]]}, "periodic a b: the axis has no length"),
        ({"patches": ["a", "b"], "translation": [1]}, "must be three numbers, or two in a plane mesh"),
        ({"patches": ["a", "b"], "translation": [1, 0, 0], "axis": [[0, 0]]}, "leave out one of them"),
    ],
)
def test_wrong_periodic_patches_are_refused(given, sentence):
    with pytest.raises(InputError) as error:
        jobs_of(settings_of("flap", HINGE, 5.0, {"periodic": given}))[0]
    assert sentence in str(error.value)
