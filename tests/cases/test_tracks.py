"""Turned and shifted surfaces from Python, files and the command line: the same mesh, repeated from the report."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.api import deflect, plan, sweep
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.settings.job_settings import settings_of
from sdm_deflect.deform.surface.tracks import Track, TrackLaw
from sdm_deflect.meshing.formats.registry import FORMATS, read
from sdm_deflect.meshing.mesh.axis import Axis
from tests.deform.plates import plate

HINGE = (0.0, -0.7)
SHIFT = (0.02, -0.03)
ROWS = "parameter,angle,dx,dy\n0,0,0,0\n0.5,-3,0.02,-0.01\n1,-6,0.03,-0.03\n"


def moved(angle, shift):
    """The nodes of the hole after an angle and a shift."""
    mesh, hinge = plate(), Axis(np.array([*HINGE, 0.0]), np.array([0.0, 0.0, 1.0]))
    whole = np.array([*shift, 0.0])
    nodes = mesh.on("hole")
    return nodes, mesh.points[nodes] + TrackLaw(
        Track.straight(hinge, angle, whole, whole), mesh.points[nodes]
    ).displacement(1.0)


def test_an_angle_and_a_shift_from_python():
    result = deflect(plate(), "hole", HINGE, -6.0, shift=SHIFT, margin=0.4)
    nodes, expected = moved(-6.0, SHIFT)
    np.testing.assert_allclose(result.points[nodes], expected, atol=1e-14)
    assert result.passed


def test_places_of_a_track_from_python(tmp_path):
    (tmp_path / "track.csv").write_text(ROWS)
    results = sweep(plate(), "hole", HINGE, (0.5, 1.0), track=str(tmp_path / "track.csv"), margin=0.4)
    for result, (angle, shift) in zip(results, ((-3.0, (0.02, -0.01)), (-6.0, (0.03, -0.03))), strict=True):
        nodes, expected = moved(angle, shift)
        np.testing.assert_allclose(result.points[nodes], expected, atol=1e-14)


@pytest.mark.parametrize("words", [["--angle", "-6", "--shift", "0.02,-0.03"], ["--track", "track.csv"]])
def test_a_report_repeats_a_track(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "track.csv").write_text(ROWS)
    FORMATS["su2"].write(plate(), tmp_path / "plate.su2")
    common = ["deflect", "plate.su2", "--out", "out.su2", "-q"]
    assert (
        cli([*common, "--surface", "hole", "--hinge", "0,-0.7", "--margin", "0.4", *words], standalone_mode=False) == 0
    )
    assert "hole \N{MINUS SIGN}6°, shifted by (0.0" in (tmp_path / "out-report" / "report.html").read_text()
    first = read(tmp_path / "out.su2").points
    assert np.abs(first - plate().points).max() > 0.01
    settings = str(tmp_path / "out-report" / "settings.toml")
    assert cli([*common[:3], "again.su2", "-q", "--no-report", "--config", settings], standalone_mode=False) == 0
    np.testing.assert_allclose(read(tmp_path / "again.su2").points, first, atol=1e-14)


@pytest.mark.parametrize("setting", [{"shift": SHIFT}, {"slot": "rest", "gap": 0.1}])
def test_a_sweep_does_not_replace_the_angle_of_a_setting(setting, tmp_path, capsys):
    """It did: a setting at -6 degrees was made at 1, the largest share, and every check passed."""
    said = "one setting with an angle of its own: for a sweep give the places as a track"
    with pytest.raises(InputError, match=said):
        sweep(plate(), "hole", HINGE, (0.5, 1.0), margin=0.4, **setting)
    with pytest.raises(InputError, match=said):
        sweep(plate(), [{"patches": "hole", "hinge": HINGE, "angle": -6.0, **setting}], None, (0.5, 1.0), margin=0.4)
    FORMATS["su2"].write(plate(), tmp_path / "plate.su2")
    words = "".join(f"{name} = {list(one) if isinstance(one, tuple) else repr(one)}\n" for name, one in setting.items())
    (tmp_path / "job.toml").write_text(f"[[surface]]\npatches = 'hole'\nhinge = [[0, -0.7]]\nangle = -6\n{words}")
    for command in (["deflect", "--angles", "0.5,1"], ["limit"]):
        given = [command[0], str(tmp_path / "plate.su2"), "--config", str(tmp_path / "job.toml"), *command[1:]]
        with pytest.raises(InputError, match=said):
            cli(given, standalone_mode=False)


@pytest.mark.parametrize(("word", "strip"), [("0.1", 0.1), ("auto", 0.0)])
def test_a_strip_is_a_share_or_auto(word, strip):
    settings = settings_of("flap", [[0.7, 0, 0], [0.7, 1, 0]], 5.0, {"motion": "blended", "strip": word})
    assert settings.surface[0].strip == strip
    with pytest.raises(InputError, match="strip = 'wide': must be auto, or a share of the span"):
        settings_of("flap", [[0.7, 0, 0], [0.7, 1, 0]], 5.0, {"motion": "blended", "strip": "wide"})


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"shift": (0.1, 0.0), "track": "track.csv"}, "track and shift: give one of them"),
        ({"shift": (0.1, 0.0), "hinge": None}, "shift: the hinge is missing"),
        ({"shift": (0.1, np.nan)}, "shift"),
        ({"shift": 3.0}, "shift"),
        ({"track": "none.csv"}, r"none\.csv"),
        ({"track": "empty.csv"}, r"empty\.csv"),
        ({"track": "words.csv"}, r"words\.csv"),
        ({"gap": 0.01}, "gap and overlap need slot"),
        ({"overlap": 0.01}, "gap and overlap need slot"),
        ({"slot": "rest", "gap": -1.0}, "gap = -1 must be a positive length"),
        ({"slot": "none", "gap": 0.1}, "slot 'none' is no patch"),
        ({"slot": "rest", "overlap": 90.0}, "no place of the element has them"),
        ({"motion": "blended", "strip": "auto", "angle": 0.0}, "strip = auto: its width follows from the angle"),
    ],
)
def test_tracks_that_cannot_be_are_one_sentence(given, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "track.csv").write_text(ROWS)
    (tmp_path / "empty.csv").write_text("parameter,angle,dx,dy\n")
    (tmp_path / "words.csv").write_text("parameter,angle,dx,dy\n0,0,0,0\n1,a,b,c\n")
    with pytest.raises(InputError, match=said):
        deflect(plate(), "hole", **{"hinge": HINGE, "angle": -6.0, "margin": 0.4, **given})


def test_where_a_slot_fails_the_last_line_says_how_the_mesh_was_made(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    FORMATS["su2"].write(plate(), tmp_path / "plate.su2")
    words = ["deflect", "plate.su2", "--surface", "hole", "--hinge", "0,-0.7", "--margin", "0.4", "--angle", "0"]
    for gap, overlap, code in (("0.7", "1.3", 0), ("0.001", "1.999", 1)):
        setting = ["--fixed", "rest", "--slot", "rest", "--gap", gap, "--overlap", overlap]
        said = cli([*words, *setting, "--no-report", "-q"], standalone_mode=False)
        text = " ".join(capsys.readouterr().out.split())
        assert said == code
        assert text.endswith("the mesh was made at gap 0.75, overlap 1.25") is bool(code)


def test_a_blended_flap_follows_a_track(tmp_path, monkeypatch):
    """Its trailing edge goes where the track says, and the figures have the hinge after the motion."""
    monkeypatch.chdir(tmp_path)
    cli(["example"], standalone_mode=False)
    (tmp_path / "track.csv").write_text("parameter,angle,dx,dy,dz\n0,0,0,0,0\n0.5,4,0,0,-0.001\n1,8,0.001,0,-0.004\n")
    hinge = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]
    options = {"motion": "blended", "fixed": "wing", "track": "track.csv"}
    half, whole = sweep("naca.su2", "flap", hinge, (0.5, 1.0), **options)
    axis = Axis.through(*np.array(hinge))
    for result, angle, shift in ((half, 4.0, (0.0, 0.0, -0.001)), (whole, 8.0, (0.001, 0.0, -0.004))):
        assert result.passed
        own = result.figures()["surfaces"]["flap"]
        np.testing.assert_allclose(own["hinge"], np.add(hinge, shift), atol=1e-15)
        start = result.points - result.displacement
        edge = np.flatnonzero((start[:, 0] > 0.9999) & (np.abs(start[:, 1] - 1.0) < 0.2))
        edge = np.intersect1d(edge, result.plan.mesh.on("flap"))
        assert len(edge) > 4
        expected = axis.rotated(start[edge], angle) + shift
        np.testing.assert_allclose(result.points[edge], expected, atol=1e-12)
    found = plan("naca.su2", "flap", hinge, range=(0, 1), **options)
    assert found.passed(0) == (0.0, 1.0)
