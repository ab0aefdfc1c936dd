"""Jobs for the engine in the few words that tests need."""

from dataclasses import replace

import numpy as np

from sdm_deflect.deform.box.automatic import Automatic, Given
from sdm_deflect.deform.options import Repair
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Moving, Rotation
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job, Sliding
from sdm_deflect.deform.volume.plan import Plan

Y_AXIS = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
FLAP = ("flap_*",)
WING = ("wing_*", "flap_*")


def job(patches, hinge=Y_AXIS, angle=10.0, motion=None, slide=None, box=None, repair="off", force=True, **more):
    """Patches that turn about a hinge (2, 3), however far; `box`: a rule, or corners; repaired only if asked."""
    moving = Moving(tuple(patches), motion or Rotation.about(*hinge), angle)
    slides = tuple(Sliding(patch, shape) for patch, shape in (slide or {}).items())
    rule = Automatic() if box is None else Given.at(np.array(box, dtype=float)) if isinstance(box, list) else box
    return Job((moving,), slides=slides, box=rule, repair=Repair(repair), force=force, **more)


def box_plan(mesh, wanted, angles=()):
    """Plan the one box of a job."""
    return Plan.of(mesh, [wanted], [(angle,) for angle in angles]).boxes[0]


def turn(mesh, patches=("body",), hinge=Y_AXIS, angle=10.0, **more):
    """Plan one angle and bring the mesh to it."""
    return deflect(Plan.of(mesh, [job(patches, hinge, angle, **more)]), (angle,))


def sensitivity(one):
    """Return the derivative (N, 3) of a deflection of a single surface."""
    (rate,) = one.sensitivity().values()
    return rate


def placed(one, points):
    """Return the deflection of one box with other points."""
    return replace(one, boxes=(replace(one.boxes[0], exact=points),))


def blended(w, **more):
    """Settings of the flap of a wing: blended, the wing fixed, the symmetry plane sliding."""
    motion = Blended(Rotation.about(*w.hinge), held=OnPatches(("wing_*",)))
    return {"motion": motion, "fixed": ("wing_*",), "slide": {"symmetry": "plane"}, **more}
