"""Ailerons with a gap on every side: solids of their own, which turn rigidly without touching the wing."""

from dataclasses import replace

import cadquery as cq
import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.assemble import assemble
from sdm_deflect.geometry.datum import hinge_edges, hinge_line
from sdm_deflect.geometry.deflected import CadTurn, rotate
from sdm_deflect.geometry.parameters import Aileron, Fighter
from sdm_deflect.geometry.quantity import CadError

FREE, NOTCH = Fighter(aileron=Aileron(gap=0.012)), 0.005


@pytest.fixture(scope="module")
def free_model():
    return build(FREE, notch=NOTCH)


def test_both_ailerons_are_solids_of_their_own(free_model):
    solids = free_model.solid.Solids()
    assert len(solids) == 3
    assert all(solid.Volume() > 0.0 for solid in solids)
    small = sorted(solids, key=lambda solid: solid.Volume())[:2]
    assert small[0].Volume() == pytest.approx(small[1].Volume(), rel=1e-12)
    for edge in free_model.edges:
        patches = {free_model.faces[face].patch for face in edge.faces}
        assert len(patches) == 1 or not any("aileron" in name for name in patches)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_gaps_are_as_wide_as_asked(free_model, side):
    """At the rib the gap is that of the aileron; at the hinge it is the notch, across a swept hinge line."""
    wing, aileron = (
        cq.Compound.makeCompound([face.shape for face in free_model.faces_of(f"{name}_{side}")])
        for name in ("wing", "aileron")
    )
    first, second = hinge_edges(FREE, f"aileron_{side}")[0]
    along = (second - first) / np.linalg.norm(second - first)
    assert wing.distance(aileron) == pytest.approx(NOTCH * abs(along[1]), rel=0.01)
    walls = [face for face in free_model.faces_of(f"wing_{side}") if abs(abs(face.shape.normalAt().y) - 1.0) < 1e-9]
    ribs = [abs(face.shape.Center().y) for face in walls if face.shape.Center().x > 0.68]
    assert ribs == pytest.approx([FREE.wing.y_kink])


@pytest.mark.parametrize("angle", [-30.0, 15.0])
def test_the_turned_aileron_is_the_undeflected_one_rotated(free_model, angle):
    """No ridge closes a slot: there is none."""
    turned, axis = build(FREE, {"aileron_left": CadTurn(angle)}, notch=NOTCH), hinge_line(FREE, "aileron_left")
    before, after = (model.faces_of("aileron_left") for model in (free_model, turned))
    assert len(before) == len(after) == 5
    corners = np.vstack([rotate(face.tessellation()[0], axis, angle) for face in before])
    found = np.vstack([face.tessellation()[0] for face in after])
    assert max(np.linalg.norm(found - corner, axis=1).min() for corner in corners) < 1e-15
    assert max(np.linalg.norm(corners - corner, axis=1).min() for corner in found) < 1e-15
    assert len(turned.faces_of("wing_left")) == len(free_model.faces_of("wing_left"))


def test_a_step_file_has_the_three_solids(free_model, tmp_path):
    free_model.write(tmp_path / "sdm.step")
    read = cq.importers.importStep(str(tmp_path / "sdm.step"))
    assert len(read.solids().vals()) == 3
    assert sum(one.Volume() for one in read.solids().vals()) == pytest.approx(1e9 * free_model.solid.Volume(), rel=1e-6)


@pytest.mark.parametrize(
    ("fighter", "notch", "message"),
    [
        (Fighter(), 0.005, r"notch = 0.005 m frees the ailerons at their hinges alone; set aileron.gap too"),
        (FREE, 0.0004, r"notch = 0.0004 m is too narrow for any mesh; it must be 0 or at least 0.0005 m"),
        (FREE, 0.08, r"notch = 0.08 m reaches the wing's front bevel; at most 0.0\d+ m fit"),
    ],
)
def test_an_impossible_notch_is_refused(fighter, notch, message):
    for made in (
        lambda: build(fighter, notch=notch),
        lambda: replace(case_named("aileron"), fighter=fighter, notch=notch),
    ):
        with pytest.raises(ValueError, match=message):
            made()


def test_a_block_has_no_notch():
    with pytest.raises(ValueError, match=r"notch = 0.005 m in a Chimera block; the whole aircraft alone can have one"):
        replace(case_named("aileron-chimera"), notch=0.005)


def test_a_body_that_nobody_asked_for_is_named(free_model):
    with pytest.raises(CadError, match=r"^the skin comes in 3 separate pieces instead of 1$"):
        assemble(free_model.faces, (), fluid_inside=False)
