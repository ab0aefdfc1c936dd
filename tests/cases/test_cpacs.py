"""Hinge line and angle from a CPACS file: wings whose hinge points are known without it."""

import tracemalloc

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.cases.settings.cpacs import Device, FileLimits, hinge_and_angle
from sdm_deflect.cases.settings.job_settings import job_settings, read_job
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.calls import sdm
from tests.cases.cpacs_wing import STEPS, WING, X, Z, border, positioning, section, transformation, written
from tests.deform.blocks import two_bodies


def test_the_hinge_of_a_tapered_wing(tmp_path):
    """Chord 1 at y = 0, 0.5 at y = 2; at eta 0.25 the chord is 0.875, at 0.75 it is 0.625."""
    device = Device.read(written(tmp_path), "flap")
    skin = 0.06 + 0.5 * (0.01 - 0.06)  # at three quarters of the chord
    assert device.hinge == pytest.approx(np.array([[0.4375, 0.5, 0.0], [0.75 * 0.625, 1.5, 0.625 * skin]]))
    assert [step.rotation for step in device.steps] == [-20.0, 0.0, 30.0]


def test_etas_follow_the_middles_of_chords_over_several_segments(tmp_path):
    sections = section(1) + section(2) + section(3)
    positionings = positioning(1, 0.0) + positioning(2, 1.0) + positioning(3, 3.0)
    segments = (
        WING["segments"] + "<segment><fromElementUID>e2</fromElementUID><toElementUID>e3</toElementUID></segment>"
    )
    path = written(tmp_path, sections=sections, positionings=positionings, segments=segments, last="e3")
    assert Device.read(path, "flap").hinge[:, 1] == pytest.approx([1.0, 3.0])


@pytest.mark.parametrize(
    ("sweep", "dihedral", "along"), [(30, 0, (0.5, 0.75**0.5, 0)), (0, 30, (0, 0.75**0.5, 0.5)), (90, 45, (1, 0, 0))]
)
def test_positionings_are_lengths_with_sweep_and_dihedral(sweep, dihedral, along, tmp_path):
    inner = {"inner": "<hingeXsi>0</hingeXsi><hingeRelHeight>0.5</hingeRelHeight>"}
    path = written(
        tmp_path,
        sections=section(1) + section(2),
        positionings=positioning(1, 0.0) + positioning(2, 4.0, sweep, dihedral),
        **inner,
        outer=inner["inner"],
    )
    assert Device.read(path, "flap").hinge == pytest.approx(np.outer([1.0, 3.0], along), abs=1e-12)


def test_transformations_scale_turn_and_shift_in_this_order(tmp_path):
    """A wing upright: turned about x by 90 degrees, which takes y to z, and z to -y."""
    wing = transformation((2, 2, 2), (90, 0, 0), (5, 0, 1), "absGlobal")
    plain, turned = (Device.read(written(tmp_path, wing=one), "flap").hinge for one in (WING["wing"], wing))
    x, y, z = plain.T
    assert turned == pytest.approx(np.column_stack([2 * x + 5, -2 * z, 2 * y + 1]))
    euler = transformation(rotation=(10, 20, 30), kind="absGlobal")
    found = Device.read(written(tmp_path, wing=euler), "flap").hinge
    a, b, c = np.radians([10, 20, 30])
    rows = [
        [np.cos(b) * np.cos(c), -np.cos(b) * np.sin(c), np.sin(b)],
        [np.cos(a) * np.sin(c) + np.sin(a) * np.sin(b) * np.cos(c),
         np.cos(a) * np.cos(c) - np.sin(a) * np.sin(b) * np.sin(c), -np.sin(a) * np.cos(b)],
        [np.sin(a) * np.sin(c) - np.cos(a) * np.sin(b) * np.cos(c),
         np.sin(a) * np.cos(c) + np.cos(a) * np.sin(b) * np.sin(c), np.cos(a) * np.cos(b)],
    ]  # fmt: skip
    assert found == pytest.approx(plain @ np.array(rows).T)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (FileLimits(size=1000), r"is larger than 0.001 MB: leave out what is not of the wing$"),
        (FileLimits(elements=20), r"has more than 20 elements: leave out what is not of the wing$"),
        (FileLimits(depth=5), r"has elements more than 5 levels deep"),
    ],
)
def test_a_file_beyond_the_limits_is_refused(limits, said, tmp_path):
    with pytest.raises(InputError, match=said):
        Device.read(written(tmp_path), "flap", limits)


def test_memory_is_bounded_by_the_limits(tmp_path):
    """Elements, attributes and levels that come to nothing: each takes little more than it takes in the file."""
    path, limits = tmp_path / "wide.xml", FileLimits(size=300_000, elements=30_000, depth=50)
    for text in ("<a b=''/>" * 29_000, "<a>" * 49 + "</a>" * 49, "".join(f"<a uID='{i}'/>" for i in range(15_000))):
        path.write_text(f"<c>{text}</c>")
        tracemalloc.start()
        with pytest.raises(InputError, match=r"device 'd' is no trailingEdgeDevice"):
            Device.read(path, "d", limits)
        assert tracemalloc.get_traced_memory()[1] < 15e6
        tracemalloc.stop()


def test_a_profile_may_begin_on_either_side(tmp_path):
    back = "".join(
        f"<{k}>{';'.join(map(str, values[::-1]))}</{k}>" for k, values in (("x", X), ("y", [0] * 5), ("z", Z))
    )
    one = Device.read(written(tmp_path), "flap").hinge
    other = Device.read(written(tmp_path, profile=f"<pointList>{back}</pointList>"), "flap").hinge
    assert one == pytest.approx(other)


def test_the_angle_is_that_of_a_step_or_between_two(tmp_path):
    path = written(tmp_path)
    assert hinge_and_angle(path, "flap=1", None)[1] == 30.0
    assert hinge_and_angle(path, "flap = -0.5", None)[1] == pytest.approx(-10.0)
    assert hinge_and_angle(path, "flap", 7.0)[1] == 7.0
    only = "<step><relDeflection>0.4</relDeflection><hingeLineRotation>12</hingeLineRotation></step>"
    assert hinge_and_angle(written(tmp_path, steps=only), "flap", None)[1] == 12.0
    old = border("inner", 0.25, "") + border("outer", 0.75, "")
    assert Device.read(written(tmp_path, borders=old), "flap").hinge[0, 1] == pytest.approx(0.5)


SHIFTED = STEPS.replace(
    "<hingeLineRotation>30", "<innerHingeTranslation><x>0.1</x></innerHingeTranslation><hingeLineRotation>30"
)
LOCAL = {"parent": "<parentUID>body</parentUID>", "wing": transformation()}
GUIDED = WING["segments"].replace("</segment>", "<guideCurves/></segment>")
WRONG = {
    "'flop' is no trailingEdgeDevice; did you mean flap": ("flop", {}),
    "has the steps -1 .-20 deg., 0 .0 deg., 1 .30 deg.: give angle, or flap=STEP": ("flap", {}),
    "has no step 2": ("flap=2", {}),
    "'down' is no number": ("flap=down", {}),
    "only rotations are read": ("flap=0.5", {"steps": SHIFTED}),
    "relative to body, which is not at the origin": ("flap=1", LOCAL),
    "has no parent nobody": ("flap=1", {**LOCAL, "parent": "<parentUID>nobody</parentUID>"}),
    "is no list of points": ("flap=1", {"profile": "<cst2D/>"}),
    "no list of numbers": ("flap=1", {"profile": WING["profile"].replace("0.06", "thick")}),
    "has guide curves": ("flap=1", {"segments": GUIDED}),
    "no segments lead from element e1 to element e9": ("flap=1", {"last": "e9"}),
    "refers to s1, not to the component segment cs": ("flap=1", {"borders": border("inner", 0.2, "s1")}),
    "etaLE/eta of flap is 1.5; it must be between 0 and 1": ("flap=1", {"borders": border("inner", 1.5)}),
    "lacks path/innerHingePoint/hingeXsi": ("flap=1", {"inner": ""}),
    "hingeXsi of flap is 'half', no number": ("flap=1", {"inner": "<hingeXsi>half</hingeXsi>"}),
    "lead in a circle": ("flap=1", {"positionings": positioning(2, 1.0).replace(">s1<", ">s2<")}),
    "no CPACS file": ("flap=1", {"parent": "<"}),
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_not_read_is_one_sentence(words, tmp_path):
    text, changes = WRONG[words]
    with pytest.raises(InputError, match=words):
        hinge_and_angle(written(tmp_path, **changes), text, None)


def test_settings_take_hinge_and_angle_from_it(tmp_path):
    written(tmp_path)
    (tmp_path / "job.toml").write_text("[[surface]]\npatches = 'a'\ncpacs = 'aircraft.xml'\ndevice = 'flap=-1'\n")
    moving = job_settings(read_job(tmp_path / "job.toml")).jobs()[0].surfaces[0]
    assert moving.amount == -20.0
    assert moving.motion.axis.point == pytest.approx([0.4375, 0.5, 0.0])
    for wrong in (
        {"device": "flap=1"},
        {"cpacs": "x.xml"},
        {"cpacs": "x.xml", "device": "flap", "hinge": [[0, 0], [1, 0]]},
    ):
        with pytest.raises(InputError, match=r"go together|leave out hinge"):
            job_settings({"surface": [{"patches": "a", "angle": 1, **wrong}]}).jobs()[0]
    with pytest.raises(InputError, match="the angle is given already"):
        hinge_and_angle(tmp_path / "aircraft.xml", "flap=1", 3.0)


def test_the_command_and_python_turn_a_surface_about_it(tmp_path):
    """A plate from y = -0.5 to 0.5 turns about its middle, as with the hinge itself."""
    place = transformation((1, 1, 1), (0, 0, 0), (0.75, -1.0, 0.0), "absGlobal")
    middle = "<hingeXsi>0.5</hingeXsi><hingeRelHeight>0.5</hingeRelHeight>"
    cpacs = written(tmp_path, sections=section(1) + section(2), wing=place, inner=middle, outer=middle)
    FORMATS["su2"].write(two_bodies(), tmp_path / "plates.su2")
    words = ["--surface", "right", "--fixed", "left,wall", "--cpacs", cpacs, "--device", "flap=0.2", "--no-report"]
    assert sdm("deflect", tmp_path / "plates.su2", *words, "-q") == 0
    found = sdm_deflect.read(tmp_path / "plates-deflected.su2").points
    plain = sdm_deflect.deflect(two_bodies(), "right", [[1.25, -0.5, 0], [1.25, 0.5, 0]], 6, fixed="left,wall")
    same = sdm_deflect.deflect(two_bodies(), "right", cpacs=str(cpacs), device="flap=0.2", fixed="left,wall")
    assert found == pytest.approx(plain.points, abs=1e-12)
    assert same.points == pytest.approx(plain.points, abs=1e-12)
