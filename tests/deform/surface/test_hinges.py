"""Hinges that follow from the mesh: of sealed flaps alone, and of a device that is cut from a clean wing."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.api import deflect
from sdm_deflect.cases.settings.job_settings import settings_of
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.surface.hinges import candidates, device, ends_text
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.job import prepare
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh, Warned
from tests.deform.blocks import two_bodies
from tests.deform.plates import plate


def lattice(points):
    """Quadrilaterals of a lattice (m, n, 3), numbered row by row."""
    at = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    return np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)


def skins(across):
    """A tapered wing of two skins, straight lines from nose to tail, with its flap between stations 1 and 3.

    `across` is the index of the vertical axis; the flow is along x.
    """
    share, span = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 4.0, 17)
    u, s = np.meshgrid(np.concatenate([share, share[-2:0:-1]]), span, indexing="ij")
    height = np.where(np.arange(len(u)) <= 20, 1.0, -1.0)[:, None] * 0.06 * np.minimum(u, 3.0 * (1.0 - u) / 7.0)
    chord = 1.0 - 0.1 * s
    points = np.zeros((*u.shape, 3))
    points[..., 0], points[..., across], points[..., 3 - across] = 0.1 * s + u * chord, height * chord, s
    points = np.concatenate([points, points[:1]])
    faces = lattice(points) % (u.size)
    flat = points[:-1].reshape(-1, 3)
    centre = (np.concatenate([u, u[:1]])[:-1, :-1] + np.roll(u, -1, 0)[:, :-1]).ravel() / 2.0
    middle = np.broadcast_to((span[1:] + span[:-1]) / 2.0, (len(u), 16)).ravel()
    return flat, faces, (centre > 0.7) & (middle > 1.0) & (middle < 3.0)


def winged(across, cut=True):
    points, faces, flap = skins(across)
    parts = {"flap": faces[flap], "wing": faces[~flap]} if cut else {"wing": faces}
    patches = tuple(Patch(name, (Cells("quad", nodes),)) for name, nodes in parts.items())
    return Mesh(points, (), patches, name="wing")


EXPECTED = np.array([[0.1 + 0.7 * 0.9, 0.0, 1.0], [0.3 + 0.7 * 0.7, 0.0, 3.0]])


@pytest.mark.parametrize("across", [1, 2])
def test_a_sealed_flap_has_the_line_where_it_meets_its_wing(across):
    (found,) = candidates(winged(across), ["flap"])
    found = found[:, [0, across, 3 - across]]
    np.testing.assert_allclose(found, EXPECTED, atol=0.01)
    np.testing.assert_allclose(np.cross(found - EXPECTED[0], EXPECTED[1] - EXPECTED[0]), 0.0, atol=1e-12)
    assert list(candidates(winged(across), ["wing"])) == []


def test_what_meets_nothing_smoothly_has_none():
    for name in ("left", "right"):
        assert list(candidates(two_bodies(), [name])) == []
    assert list(candidates(plate(), ["hole"])) == []
    points, faces, flap = skins(2)
    folded = points.copy()
    folded[np.unique(faces[flap])] += [0.0, 0.0, 0.3]  # a step all around
    patches = (Patch("flap", (Cells("quad", faces[flap]),)), Patch("wing", (Cells("quad", faces[~flap]),)))
    assert list(candidates(Mesh(folded, (), patches), ["flap"])) == []


def test_a_flap_in_the_plane_turns_about_the_middle_of_its_ends():
    points = np.array([[0, 0, 0], [0.7, 0.05, 0], [1, 0, 0], [0.7, -0.03, 0]], dtype=float)
    lines = {"wing": [[3, 0], [0, 1]], "flap": [[1, 2], [2, 3]]}
    patches = tuple(Patch(name, (Cells("line", np.array(nodes)),)) for name, nodes in lines.items())
    (found,) = candidates(Mesh(points, (), patches), ["flap"])
    np.testing.assert_allclose(found, [[0.7, 0.01, 0.0]] * 2, atol=1e-15)


@pytest.mark.parametrize("across", [1, 2])
def test_a_device_is_cut_behind_a_share_of_the_chord(across):
    mesh = winged(across, cut=False)
    hinge, cut, note = device(mesh, "tab", "wing", (0.26, 0.74), 0.72)
    along = "xyz"[3 - across]
    assert note == (
        f"tab: ETA 0 of wing is at {along} = 0 and ETA 1 at {along} = 4; {along} from 1.04 to 2.96 was asked, and "
        "96 faces from 1 to 3 were cut, with 117 nodes"
    )
    assert not isinstance(note, Warned)
    stations = np.array([1.0, 3.0])
    expected = np.column_stack([0.1 * stations + 0.72 * (1.0 - 0.1 * stations), [0.0, 0.0], stations])
    np.testing.assert_allclose(hinge[:, [0, across, 3 - across]], expected, atol=1e-12)
    patch, (part,) = cut.parts(mesh)
    assert (patch, part.name) == ("wing", "tab")
    centres = part.centres
    assert (np.abs(centres[:, 3 - across] - 2.0) < 0.96).all()
    assert (centres[:, 0] > 0.1 * centres[:, 3 - across] + 0.72 * (1.0 - 0.1 * centres[:, 3 - across])).all()
    assert ends_text(hinge).count(",") == 4


@pytest.mark.parametrize("across", [1, 2])
@pytest.mark.parametrize("stations", [(0.0, 0.74), (0.26, 1.0), (0.0, 1.0)])
def test_stations_0_and_1_are_the_ends_of_the_wing(across, stations):
    hinge, cut, _ = device(winged(across, cut=False), "tab", "wing", stations, 0.72)
    at = np.round(4.0 * 4.0 * np.array(stations)) / 4.0  # the nearest stations: they are a quarter apart
    expected = np.column_stack([0.1 * at + 0.72 * (1.0 - 0.1 * at), [0.0, 0.0], at])
    np.testing.assert_allclose(hinge[:, [0, across, 3 - across]], expected, atol=1e-12)
    _, (part,) = cut.parts(winged(across, cut=False))
    along = part.centres[:, 3 - across]
    assert along.min() == pytest.approx(at[0] + 0.125, abs=0.13)
    assert along.max() == pytest.approx(at[1] - 0.125, abs=0.13)


@pytest.mark.parametrize(("way", "vertical"), [([1, 1, 1], "z"), ([1, -1, 1], "z"), ([1, 1, -1], "z")])
def test_a_device_has_one_sign_on_both_sides_and_goes_down(way, vertical):
    """On a port wing the angle of a starboard one went up, and down was refused."""
    mesh = winged(2, cut=False)
    mesh = mesh.with_points(mesh.points * way)
    low = {}
    for given in ({"angle": 5.0}, {"down": 5.0}, {"up": -5.0}):
        settings = settings_of("tab", None, None, {"device": "wing,0.26,0.74,0.72", "vertical": vertical, **given})
        cut, (job,) = prepare(mesh, jobs_of(settings))
        (moving,) = job.surfaces
        assert moving.motion.axis.direction[1] > 0.9
        surface = Surface.of(cut, moving.patches)
        low[moving.amount] = moving.motion.law(surface).displacement(moving.amount)[:, 2].min()
    assert [*low] == [5.0]
    assert low[5.0] == pytest.approx(-np.sin(np.radians(5.0)) * 0.28 * 0.896, rel=0.1)


def test_a_device_on_a_fin_has_no_down():
    mesh = winged(1, cut=False)
    settings = settings_of("tab", None, None, {"device": "wing,0.26,0.74,0.72", "down": 5.0})
    with pytest.raises(InputError, match="the hinge lies along z, or along the flow, x: set vertical = y"):
        prepare(mesh, jobs_of(settings))


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ("wing,0.5,0.2,0.7", "must ascend from 0 to 1"),
        ("wing,0.1,0.4,1.7", "must ascend from 0 to 1"),
        ("wing,0.1,nan,0.7", "nan is not a finite number"),
        ("wing,0.1,0.4", "must be WING,ETA1,ETA2,XSI"),
        ("wing,0.1,0.4,x", "must be a patch, two shares of its span and one of its chord"),
        ("sail,0.1,0.4,0.7", "device 'sail' is no patch"),
    ],
)
def test_what_is_no_device_is_one_sentence(given, complaint):
    with pytest.raises(InputError, match=complaint):
        deflect(winged(2, cut=False), "tab", None, 5.0, device=given, fixed="wing")


def test_a_missing_hinge_is_offered():
    with pytest.raises(InputError, match=r"the hinge is missing: .* it may be 0\.73,1,0 0\.79019,3\.00629,0$"):
        deflect(winged(2), "flap", None, 5.0, motion="blended", fixed="wing")
    with pytest.raises(InputError, match="it may be none: no other patch goes on smoothly from left"):
        deflect(two_bodies(), "left", None, 5.0)
