"""The engine from Python: what is asked for is done, in the order asked for, or one sentence says why not."""

from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect import Blended, Hexahedron, InputError, OnPatches, Rotation, deflect
from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.mesh.cells import Cells
from tests.limits import limited

HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
BOX = [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]


@pytest.fixture(scope="module")
def turned(block):
    return deflect(block, "body", HINGE, 10.0, box=BOX)


def test_words_of_the_command_give_what_objects_give(inboard_wing):
    w = inboard_wing
    words = deflect(
        w.mesh, "flap_*", w.hinge, 8, motion="blended", held="wing_*", fixed="wing_*", slide="symmetry:plane"
    )
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    objects = deflect(w.mesh, ["flap_*"], None, 8.0, motion=motion, fixed=["wing_*"], slide={"symmetry": "plane"})
    assert np.array_equal(words.points, objects.points)
    assert words.passed
    corners = Hexahedron(words.plan.boxes[0].region.hexahedron.corners)
    given = deflect(w.mesh, "flap_*", None, 8.0, motion=motion, fixed="wing_*", slide="symmetry:plane", box=corners)
    assert given.plan.boxes[0].region.box.why == "corners as given"


@pytest.mark.parametrize("options", [{"tolerance": 2e-4}, {"strategy": "mv"}, {"max_centers": 61}, {"spacing": 0.3}])
def test_every_setting_reaches_the_fit(options, block):
    ((name, value),) = options.items()
    result = deflect(block, "body", HINGE, 10.0, box=BOX, **options)
    assert getattr(result.plan.job.fitting, name) == value
    chosen = [len(fit.chosen) for fit in result.deflection.boxes[0].steps[0].fits.adaptations]
    if name == "tolerance":
        assert result.plan.boxes[0].sites.tolerance == value >= result.deflection.boxes[0].steps[0].error
    if name == "strategy":
        assert len(chosen) == 1
    if name == "max_centers":
        assert max(chosen) == 61
    if name == "spacing":
        assert result.plan.boxes[0].sites.spacing == value


def notes(result):
    return " ".join(result.figures()["notes"])


def test_notes_say_what_a_user_may_not_expect(block, turned):
    assert not turned.figures()["notes"]
    (cells,) = block.cells
    mirrored = replace(block, cells=(Cells("hexahedron", cells.nodes[:, [4, 5, 6, 7, 0, 1, 2, 3]]),))
    assert "left-handed" in notes(deflect(mirrored, "body", HINGE, 10.0, box=BOX))
    points = block.points.copy()
    points[np.argmin(np.linalg.norm(points - [-1.5, -1.5, -1.5], axis=1))] += 0.6  # through the cells beside it
    broken = replace(block, points=points)
    with pytest.raises(InputError, match=r"(\d) of 504 cells \(hexahedron\) are inverted in the file already"):
        deflect(broken, "body", HINGE, 10.0, box=BOX)
    taken = deflect(broken, "body", HINGE, 10.0, box=BOX, allow_inverted=True)
    assert "cells were inverted in the file already" in notes(taken)
    assert taken.passed
    doubled = np.vstack([block.points, block.points[block.on("body")]])
    arrays = (doubled, {"body": np.append(block.on("body"), np.arange(len(block.points), len(doubled)))})
    assert "26 moving nodes coincide with others" in notes(deflect(arrays, "body", HINGE, 10.0, box=BOX))


def test_a_result_says_what_it_is(turned, block):
    assert np.array_equal(turned.displacement, turned.points - block.points)
    assert np.array_equal(turned.mesh.points, turned.points)
    assert turned.passed
    assert repr(turned) == "<Result: body of mesh at +10 deg: all validations passed>"
    verdicts = {check.name: check.verdict for check in turned.checks}
    assert verdicts["fixed_surfaces_moved"] == "not applicable"
    assert "not applicable" in turned._repr_html_()
    assert "at most 0 cells<" in turned._repr_html_()
    (interpolant,) = turned.interpolants
    assert interpolant(block.points[:1]).shape == (1, 3)


@pytest.mark.parametrize("name", ["wing.cgns", "case"])
@pytest.mark.parametrize("held", [0, 1 << 23])
def test_a_plan_of_a_file_is_the_deflection_of_the_whole_to_the_bit(held, name, inboard_wing, tmp_path, monkeypatch):
    limited(monkeypatch, in_memory=held)
    path, wing = tmp_path / name, inboard_wing
    format_of(path).write(wing.mesh, path)
    wanted = {
        "hinge": wing.hinge, "angle": 12, "motion": "blended", "held": "wing_*", "fixed": "wing_*",
        "slide": "symmetry:plane",
    }  # fmt: skip
    whole = deflect(path, "flap_*", **wanted)
    found = sdm_deflect.plan(path, "flap_*", **wanted)
    assert found.on(whole.plan.mesh.points).at((12.0,)).tobytes() == whole.points.tobytes()
    with pytest.raises(InputError, match=r"FAILED: do not use this mesh; .*site_error"):
        sdm_deflect.plan(path, "flap_*", **wanted, max_centers=60)
