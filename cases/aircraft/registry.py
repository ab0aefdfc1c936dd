"""The cases by name, and changes by users."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sdm_deflect.base.errors import InputError, nearest
from sdm_deflect.cases.settings.conversion import Nested, merge, parse_assignments, read_toml, with_values
from sdm_deflect.geometry.parameters import Aileron, Fighter
from sdm_deflect.meshing.generate.parameters import BACKGROUND_SCALES, BLOCK_SCALES, SCALES

from .case import Case, Confinement, SurfaceTurn, adaptation

# Case 5.1: blended chordwise and, beside the wing, spanwise.
AILERON = Case(
    name="aileron", title="left aileron, no gap (section 5.1)", deflections=(SurfaceTurn("aileron_left"),), angle=-12.0
)

# Case 5.2: behind a spanwise gap, in a Chimera block of its own.
AILERON_CHIMERA = Case(
    name="aileron-chimera",
    title="left aileron with spanwise gap in a Chimera block (section 5.2)",
    deflections=(SurfaceTurn("aileron_left"),),
    domain="block",
    angle=-12.0,
    fighter=Fighter(aileron=Aileron(gap=0.014 * 0.3048)),
    adaptation=adaptation(initial_surface=20, initial_hexahedron=20, n_add=8, spacing_edges=1.2),
)

# No node touches the wing, so that the surface is rigidly rotated CAD to rounding. Both ailerons are free.
AILERON_FREE = Case(
    name="aileron-free",
    title="left aileron with gaps all around, turned rigidly",
    deflections=(SurfaceTurn("aileron_left"),),
    angle=-12.0,
    fighter=Fighter(aileron=Aileron(gap=0.012)),
    notch=0.005,
    confinement=Confinement(ahead=0.005),
)

# Case 5.3: turns on the cylindrical rear fuselage (appendix A).
TAIL = Case(
    name="tail",
    title="left horizontal tail on the fuselage cylinder (section 5.3)",
    deflections=(SurfaceTurn("tail_left"),),
    angle=12.0,
    confinement=Confinement(aft=0.080),
    adaptation=adaptation(initial_surface=100, initial_hexahedron=100, n_add=12, max_centers=2200),
)

# The fin's trailing-edge wedge, treated as an aileron.
RUDDER = Case(
    name="rudder", title="rudder, no gap, trailing edge to port", deflections=(SurfaceTurn("rudder"),), angle=15.0
)

# Every control surface at once, each in a box of its own.
ALL = Case(
    name="all",
    title="both ailerons (-/+), both tails and the rudder at once",
    deflections=(
        SurfaceTurn("aileron_left", -1.0),
        SurfaceTurn("aileron_right", 1.0),
        SurfaceTurn("tail_left", 1.0),
        SurfaceTurn("tail_right", 1.0),
        SurfaceTurn("rudder", 1.25),
    ),
    angle=12.0,
)

CASES: dict[str, Case] = {case.name: case for case in (AILERON_FREE, AILERON, AILERON_CHIMERA, TAIL, RUDDER, ALL)}

# Settings of the interpolation that may be given without the name of their table.
KERNEL = ("kernel", "kernel_radius", "polynomial")
# A name of a case of one's own.
OWN_NAME = re.compile(r"[A-Za-z0-9][\w-]*", re.ASCII)
# Spacing of zero sites, over edges of the moving surface, that gives the paper's meshes its number of sites.
PAPER_SPACING = {"aileron-chimera": 8.0, "tail": 3.25}


def case_named(name: str, scale: str = "small") -> Case:
    """Return a case at a scale; InputError with the nearest name if there is none."""
    for what, given, known in (("case", name, CASES), ("scale", scale, SCALES)):
        if given not in known:
            raise InputError(f"unknown {what} {given!r}; {nearest(given, known, 'there are')}")
    case = CASES[name]
    sizes = BLOCK_SCALES if case.domain == "block" else SCALES
    case = replace(case, scale=scale, mesh=sizes[scale], background=BACKGROUND_SCALES[scale])
    if scale == "paper" and name in PAPER_SPACING:
        case = replace(case, adaptation=replace(case.adaptation, spacing_edges=PAPER_SPACING[name]))
    return case


def resolve(
    name: str, scale: str | None = None, assignments: Sequence[str] = (), config: Path | None = None, **chosen: Any
) -> Case:
    """Return the case: registered defaults, then the configuration file, then options, then assignments.

    `chosen` are the options angle, range, repair and strategy; None if one is not given. A file with a name of its own
    is a case of its own, if it says which surfaces turn.

    Raises InputError: one sentence: what is wrong, which value, what would be right.
    """
    tables, changes = read_toml(config) if config else {}, _move_kernel(parse_assignments(assignments))
    options: Nested = {name: value for name, value in chosen.items() if value is not None}
    if "strategy" in options:
        options["adaptation"] = {"strategy": options.pop("strategy")}
    if "range" in options:
        options["range"] = list(options["range"])
    changes = merge(options, changes)
    name = name or str(tables.get("name", ""))
    if not name:
        raise InputError("no case given; name one (see sdm list), or give the case.toml of a run")
    if changes.get("name", name) != name:
        raise InputError(f"name = {changes['name']!r}: a case keeps its name, {name}")
    size = changes.get("scale", scale)
    if size not in (None, tables.get("scale", size)):
        raise InputError(f"scale = {size!r}: {config} holds the sizes of {tables['scale']}; leave one of them out")
    size = str(size or tables.get("scale", "small"))
    case = own_case(name, tables, size) if config and name not in CASES else case_named(name, size)
    case = with_values(case, merge(tables, changes))

    from .job import check_case  # compiled code: a mistake needs none

    check_case(case)
    return case


def own_case(name: str, tables: Nested, scale: str) -> Case:
    """Return what a case of one's own starts from, given the `tables` of its file: case `aileron`, or its block.

    Raises InputError for a name that is no name of a folder, or if the file does not say which surfaces turn.
    """
    if name != tables.get("name") or "deflections" not in tables:
        raise InputError(
            f"unknown case {name!r}, and its file is none of a case of your own, which has a name and "
            f"`deflections`, as the case.toml of a run has; {nearest(name, CASES, 'there are')}"
        )
    if not OWN_NAME.fullmatch(name):
        raise InputError(f"name = {name!r} must be of letters, digits, '-' and '_': it names the folder of the run")
    base = case_named("aileron-chimera" if tables.get("domain") == "block" else "aileron", scale)
    return replace(base, name=name, title=str(tables.get("title", name)), fighter=Fighter())


def _move_kernel(changes: Nested) -> Nested:
    """Move the kernel to ``adaptation``: users may name it without that table, as for `sdm deflect`."""
    kernel = {name: changes[name] for name in KERNEL if name in changes}
    rest = {name: value for name, value in changes.items() if name not in kernel}
    return merge({"adaptation": kernel} if kernel else {}, rest)
