"""What to try where a check of a deflected mesh fails, or the mesh is usable and no more."""

from collections.abc import Iterable, Iterator, Sequence

from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Motion
from sdm_deflect.deform.surface.tail_root import Root
from sdm_deflect.deform.volume.plan import Plan

# Stands for the widths of the surfaces that are blended.
WIDER = "wider"
# A limit is what `sdm limit` finds; on README's half wing at 60 degrees a wider strip helps, and a larger box does not.
SMALLER, LARGER_BOX = "a smaller angle (`sdm limit` finds the largest)", "a larger --margin"
# What to try, by the cause of a check or its name.
REMEDIES = {
    "inverted_cells": (WIDER, SMALLER, LARGER_BOX),
    "surfaces_crossed": (SMALLER, "a hinge farther from the other surface"),
    "quality_min": (WIDER, SMALLER, LARGER_BOX),
    "non_orthogonality_max": (SMALLER, LARGER_BOX),
    "skewness_max": (SMALLER, LARGER_BOX),
    "shear": (WIDER, SMALLER),
    "gap": (SMALLER, "thinner layers", "an overset block"),
    "repair": ("--repair off",),
    "following": ("near_wall = true",),
}
# What helps where settings, patches or the file are why a check fails.
OTHERS = {
    "left_behind": "Name the other patch or zone, too.",
    "nodes_parted": "Name both patches in fixed, or pair them by --periodic.",
    "site_error": "Raise max_centers, or the tolerance.",
    "rounding": "Write a format of double precision.",
}
# Factors of the widths to try, of a tail's panel and of a strip; a strip is at most half of the span. On README's half
# wing strips of .08 in place of .2 turn by 90 % of the angle on average.
PANEL, STRIP, WIDEST, NARROW = 2.0, 1.5, 0.5, 0.4


def strip_of(motion: Motion, plane: bool) -> float:
    """Return the width of the strips over which a surface is blended, by its span; 0 without one that a user sets."""
    return motion.rib.share if isinstance(motion, Blended) and not motion.rib.turn and not plane else 0.0


def wider_setting(motion: Motion, plane: bool) -> str:
    """Return the setting that blends a surface over a larger width, such as ``--strip 0.3``; empty without one."""
    if isinstance(motion, Root):
        return f"--panel {PANEL * motion.width:.3g}"
    share = strip_of(motion, plane)
    return f"--strip {min(STRIP * share, WIDEST):.3g}" if 0.0 < share < WIDEST else ""


def narrower_setting(motion: Motion, plane: bool) -> str:
    """Return the setting that blends a surface over a smaller width, such as ``--strip 0.08``; empty without one."""
    share = strip_of(motion, plane)
    return f"--strip {NARROW * share:.3g}" if share else ""


def wider_settings(plan: Plan) -> tuple[str, ...]:
    """Return `wider_setting` of the surfaces of a plan, each once."""
    settings = (wider_setting(moving.motion, plan.mesh.plane) for moving, _ in plan.moving)
    return tuple(dict.fromkeys(filter(None, settings)))


def advice(checks: Iterable[Check], wider: Sequence[str], moved: bool) -> Iterator[str]:
    """Yield sentences on what to try for the checks that failed or have a reservation.

    `wider` are settings of larger widths. Of an undeflected mesh (not `moved`) no setting of the motion helps.
    """
    told = [check for check in checks if not check.passed or check.reservation]
    names = [check.cause or check.name.partition(":")[0] for check in told]
    words = [word for name in names if moved for word in REMEDIES.get(name, ())]
    options = list(dict.fromkeys(text for word in words for text in (wider if word == WIDER else [word])))
    if options:
        yield f"Try {', '.join(options[:-1])}{' or ' if options[1:] else ''}{options[-1]}."
    yield from dict.fromkeys(OTHERS[name] for name in names if name in OTHERS)
