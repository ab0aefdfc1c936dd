"""The fused aircraft and the Chimera block: names, closedness, symmetry, volume, variants."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.geometry.aircraft import build, chimera_block
from sdm_deflect.geometry.assemble import preflight
from sdm_deflect.geometry.confinement import BlockParameters, block_corners, gap_faces
from sdm_deflect.geometry.datum import ends
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.fuse import fuselage_parts
from sdm_deflect.geometry.parameters import (
    HINGE_LOWER,
    HINGE_UPPER,
    TE,
    Aileron,
    Fighter,
    Fin,
    Fuselage,
    Inlet,
    Pedestal,
    Rudder,
    Strake,
    Tail,
    VentralFin,
    Wing,
)
from sdm_deflect.geometry.polyhedra import ventral_polyhedron
from sdm_deflect.geometry.quantity import CadError

SIDED = ("fuselage_panel", "strake", "wing", "aileron", "tail", "ventral")
CENTRED = ("fuselage", "fuselage_rear", "canopy", "inlet", "pedestal", "fin", "rudder")
PATCHES = {*CENTRED, *(f"{name}_{side}" for name in SIDED for side in ("left", "right"))}
SHORT = Fighter(aileron=Aileron(gap=0.004, y_outboard=0.22))


def euler_characteristic(model):
    """V - E + F less the holes in faces: 2 for a surface like a sphere's."""
    holes = sum(len(face.shape.innerWires()) for face in model.faces)
    return len(model.vertices) - len(model.edges) + len(model.faces) - holes


def wedge_volume(sections):
    """Volume between two parallel, similar triangles: h (A + B + sqrt(A B)) / 3."""
    areas = [0.5 * np.linalg.norm(np.cross(s[TE] - s[HINGE_UPPER], s[HINGE_LOWER] - s[HINGE_UPPER])) for s in sections]
    height = abs(sections[1][TE, 1] - sections[0][TE, 1])
    return height * (sum(areas) + np.sqrt(np.prod(areas))) / 3.0


@pytest.mark.parametrize("cant", [0.0, 25.0, 40.0])
def test_a_ventral_fin_is_a_plate_of_its_thickness_at_its_cant(cant):
    fighter = Fighter(ventral=VentralFin(cant=cant))
    right, left, *_ = ventral_polyhedron(fighter.ventral, fighter.fuselage)
    normal = np.array([0.0, np.cos(np.radians(cant)), np.sin(np.radians(cant))])
    half = 0.5 * fighter.ventral.thickness
    np.testing.assert_allclose([right @ normal, left @ normal], [np.full(4, half), np.full(4, -half)], atol=1e-15)


@pytest.mark.parametrize("name", ["plain_model", "gapped_model", "rigid_model", "blended_model"])
def test_every_face_has_a_name_of_the_contract(request, name):
    model = request.getfixturevalue(name)
    assert set(model.patches) == PATCHES
    assert not model.fluid_inside


@pytest.mark.parametrize("name", ["plain_model", "gapped_model", "blended_model", "background_model"])
def test_the_skin_is_one_closed_surface(request, name):
    """Two faces at each edge, and Euler's formula: gaps and slots add no handle."""
    model = request.getfixturevalue(name)
    assert euler_characteristic(model) == 2
    assert all(len(set(edge.faces)) == 2 for edge in model.edges)
    assert min(len(faces) for faces in model.vertex_faces) >= 2


def test_two_builds_give_the_same_model_in_the_same_order(fighter, plain_model):
    again = build(fighter)
    assert [face.patch for face in again.faces] == [face.patch for face in plain_model.faces]
    assert [edge.faces for edge in again.edges] == [edge.faces for edge in plain_model.edges]
    assert [edge.vertices for edge in again.edges] == [edge.vertices for edge in plain_model.edges]
    assert np.abs(again.vertices - plain_model.vertices).max() < 1e-12
    centres = [np.array([f.shape.Center().toTuple() for f in m.faces + m.sheets]) for m in (again, plain_model)]
    assert np.abs(centres[0] - centres[1]).max() < 1e-12


def test_left_mirrors_right(plain_model):
    def described(side, sign):
        faces = [face for face in plain_model.faces if face.patch.endswith(side)]
        centres = [np.array(face.shape.Center().toTuple()) * [1, sign, 1] for face in faces]
        keys = [(f.patch.removesuffix(side), *np.round(c, 6).tolist()) for f, c in zip(faces, centres, strict=True)]
        areas = {key: face.area for key, face in zip(keys, faces, strict=True)}
        assert len(areas) == len(faces)
        return areas

    left, right = described("_left", -1), described("_right", 1)
    assert left == pytest.approx(right, rel=1e-6)


def test_the_fuselage_s_volume_is_that_of_ogive_and_cylinder(fighter):
    f = fighter.fuselage
    rho = (f.radius**2 + f.nose_length**2) / (2 * f.radius)
    length, sagitta = f.nose_length, rho - f.radius
    ogive = np.pi * (
        length * rho**2
        - length**3 / 3
        + length * sagitta**2
        - sagitta * (length * np.sqrt(rho**2 - length**2) + rho**2 * np.arcsin(length / rho))
    )
    cylinder = np.pi * f.radius**2 * (f.length - f.nose_length)
    parts = sum(part.solid.Volume() for part in fuselage_parts(f))
    assert parts == pytest.approx(ogive + cylinder, rel=1e-6)


def test_leaving_an_aileron_out_takes_exactly_its_volume(gapped, gapped_model, background_model):
    assert "aileron_left" not in background_model.patches
    assert "aileron_right" in background_model.patches
    difference = gapped_model.solid.Volume() - background_model.solid.Volume()
    # The kernel integrates the free-form nose to 4e-8 of the whole volume, which is 6e-5 of an aileron's.
    assert difference == pytest.approx(wedge_volume(ends(gapped, "aileron_left")), rel=2e-4)


def test_the_gaps_take_exactly_their_volume(gapped, plain_model, gapped_model):
    """Without a gap the wing fills up to the aileron: two wedges from the kink to the aileron's end."""
    inner = np.array(ends(replace(gapped, aileron=Aileron(y_inboard=gapped.wing.y_kink)), "aileron_left"))[0]
    wedge = wedge_volume([inner, ends(gapped, "aileron_left")[0]])
    difference = plain_model.solid.Volume() - gapped_model.solid.Volume()
    assert difference == pytest.approx(2 * wedge, rel=1e-4)


def test_control_surfaces_and_panels_have_exact_faces(plain_model):
    for face in plain_model.faces:
        if face.patch.split("_")[0] in ("wing", "aileron", "tail", "fin", "rudder", "strake", "ventral", "pedestal"):
            assert face.planar, face.patch
        if face.patch.startswith("fuselage_panel"):
            assert not face.planar
            assert not face.free_form
    counts = Counter(face.patch for face in plain_model.faces)
    assert counts["aileron_left"] == counts["rudder"] == 3
    assert counts["tail_left"] == 7
    assert counts["fuselage_panel_left"] == 1


def test_the_panel_ends_at_its_borders(plain_model, fighter):
    (panel,) = plain_model.faces_of("fuselage_panel_left")
    points = panel.tessellation(1e-4)[0]
    polar = np.degrees(np.arctan2(points[:, 2], -points[:, 1]))
    f = fighter.fuselage
    assert [points[:, 0].min(), points[:, 0].max()] == pytest.approx([f.panel_front, f.panel_rear], abs=1e-12)
    assert [polar.min(), polar.max()] == pytest.approx([-f.panel_angle, f.panel_angle], abs=1e-9)
    assert np.hypot(points[:, 1], points[:, 2]) == pytest.approx(f.radius, abs=1e-12)


VARIANTS = {
    "wide": Fighter(wing=Wing(half_span=0.40)),
    "narrow, thick": Fighter(wing=Wing(half_span=0.28, thickness_ratio=0.06)),
    "small gap": Fighter(aileron=Aileron(gap=0.002)),
    "two gaps": Fighter(aileron=Aileron(gap=0.004, y_inboard=0.15, y_outboard=0.25)),
    "two ribs, no gap": Fighter(aileron=Aileron(y_inboard=0.15, y_outboard=0.25)),
    "dihedral tail": Fighter(tail=Tail(anhedral=-10.0, le_sweep=30.0)),
    "level tail": Fighter(tail=Tail(anhedral=0.0, x_te=0.915), fuselage=Fuselage(panel_angle=45.0)),
    "fin": Fighter(fin=Fin(le_sweep=40.0), rudder=Rudder(z_inboard=0.12, z_outboard=0.18)),
    "strake, ventral": Fighter(strake=Strake(thickness=0.006), ventral=VentralFin(cant=35.0)),
}


@pytest.mark.parametrize(
    "variant",
    [
        pytest.param(name, marks=() if name in ("two gaps", "two ribs, no gap", "fin") else pytest.mark.nightly)
        for name in VARIANTS
    ],
)
def test_other_geometries_build_and_can_be_meshed(variant):
    model = build(VARIANTS[variant])
    assert set(model.patches) == PATCHES
    assert euler_characteristic(model) == 2


def test_preflight_names_what_is_missing_behind_a_weak_crease(plain_model):
    with pytest.raises(CadError, match=r"crease of 0 deg with no face behind it between \w+ and \w+ at .* more"):
        preflight(replace(plain_model, sheets=()))


def test_preflight_names_short_edges(plain_model):
    with pytest.raises(CadError, match=r"an edge 3 mm short between aileron_left and wing_left at \(0.6918"):
        preflight(plain_model, min_edge=0.0032)


def test_a_geometry_that_cannot_be_meshed_is_refused():
    with pytest.raises(CadError, match=r"an edge 2.3 mm short between aileron_left and wing_left"):
        build(Fighter(wing=Wing(thickness_ratio=0.03)))


def test_unknown_surfaces_are_named(fighter):
    with pytest.raises(ValueError, match="no control surface 'flap'; there are aileron_left"):
        build(fighter, {"flap": CadTurn(5.0)})


@pytest.fixture(scope="module")
def short_block():
    return chimera_block(SHORT, BlockParameters(), "aileron_right")


def body_volume(fighter, y):
    """Volume of wing and aileron between two stations inside the block's plan, by Simpson's rule (exact: cubic)."""
    w, p, a = fighter.wing, BlockParameters(), fighter.aileron

    def box_area(station):
        chord = w.root_chord + (w.tip_chord - w.root_chord) * station / w.half_span
        return w.thickness_ratio * chord * p.ahead

    def wedge_area(station):
        chord = w.root_chord + (w.tip_chord - w.root_chord) * station / w.half_span
        return 0.5 * w.thickness_ratio * chord * w.bevel_ratio * chord

    def integral(area, low, high):
        return (high - low) / 6 * (area(low) + 4 * area(0.5 * (low + high)) + area(high))

    inboard, outboard = w.y_kink + a.gap, a.y_outboard or w.half_span
    return integral(box_area, y[0], min(y[1], w.half_span)) + integral(wedge_area, inboard, outboard)


def hexahedron_volume(fighter, surface):
    corners = block_corners(fighter, BlockParameters(), surface)
    y = corners[[0, 2], 1]
    lengths = np.abs([corners[1, 0] - corners[0, 0], corners[3, 0] - corners[2, 0]])
    return lengths.mean() * abs(y[1] - y[0]) * (corners[4, 2] - corners[0, 2])


def test_the_block_s_volume_is_the_hexahedron_less_wing_and_aileron(gapped, block):
    y = np.sort(np.abs(block_corners(gapped, BlockParameters(), "aileron_left")[[0, 2], 1]))
    expected = hexahedron_volume(gapped, "aileron_left") - body_volume(gapped, y)
    assert block.solid.Volume() == pytest.approx(expected, rel=1e-9)


def test_the_block_with_two_gaps_too(short_block):
    y = np.sort(np.abs(block_corners(SHORT, BlockParameters(), "aileron_right")[[0, 2], 1]))
    expected = hexahedron_volume(SHORT, "aileron_right") - body_volume(SHORT, y)
    assert short_block.solid.Volume() == pytest.approx(expected, rel=1e-9)


def test_names_and_the_side_of_the_flow(block, short_block):
    assert set(block.patches) == {"chimera", "wing_left", "aileron_left"}
    assert set(short_block.patches) == {"chimera", "wing_right", "aileron_right"}
    assert block.fluid_inside
    assert all(face.planar for face in block.faces + short_block.faces)


def test_normals_point_out_of_the_flow(block, gapped):
    """On the block's outside away from its centre, on the wing's upper side downwards into the wing."""
    centre = block_corners(gapped, BlockParameters(), "aileron_left").mean(axis=0)
    for face in block.faces:
        middle = np.array([face.shape.Center().toTuple()])
        normal = face.normal_at(middle)[0]
        if face.patch == "chimera":
            assert normal @ (middle[0] - centre) > 0.0
        elif abs(normal[2]) > 0.5:
            assert normal[2] * middle[0, 2] < 0.0


@pytest.mark.parametrize(("surface", "fighter"), [("aileron_left", None), ("aileron_right", SHORT)])
def test_faces_in_the_gaps_are_perpendicular_to_y_and_60_percent_of_the_gap_away(request, gapped, surface, fighter):
    fighter = fighter or gapped
    model = request.getfixturevalue("block" if fighter is gapped else "short_block")
    stations = gap_faces(fighter, BlockParameters(), surface)
    assert len(stations) == (1 if fighter is gapped else 2)
    for station in stations:
        found = [f for f in model.faces_of("chimera") if abs(f.shape.Center().y - station) < 1e-9]
        assert len(found) == 1
        points = found[0].tessellation(1e-4)[0]
        assert np.all(points[:, 1] == pytest.approx(station, abs=1e-15))


def test_a_coplanar_crease_at_the_tip_has_a_sheet_behind_it(block, short_block):
    assert len(block.sheets) == 1
    assert len(short_block.sheets) == 0


def test_no_gap_no_block(fighter, gapped):
    with pytest.raises(ValueError, match=r"aileron.gap is 0"):
        chimera_block(fighter, BlockParameters())
    with pytest.raises(ValueError, match=r"surrounds an aileron, not 'rudder'"):
        chimera_block(gapped, BlockParameters(), "rudder")


@pytest.mark.parametrize(
    ("fighter", "words"),
    [
        (Fighter(pedestal=Pedestal(x_apex=0.0)), r"with pedestal\.x_apex = 0 \("),
        (
            Fighter(inlet=Inlet(z_side_2=0.0), wing=Wing(half_span=0.31)),
            r"inlet\.z_side_2 = 0, wing\.half_span = 0\.31 \(",
        ),
        (
            Fighter(fuselage=Fuselage(radius=0.02985, panel_angle=55.0)),
            r"with fuselage\.radius = 0\.02985, fuselage\.panel_angle = 55 \(",
        ),
    ],
)
def test_what_the_kernel_cannot_build_is_named_by_its_parameters(fighter, words):
    with pytest.raises(CadError, match=words) as caught:
        build(fighter)
    assert "\n" not in str(caught.value)
