"""Donors of a Chimera block at each angle of a sweep: how many nodes need one, and how many find none."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.overset import Donors, donors, hole
from sdm_deflect.cases.aircraft.pipeline import background_mesh, meshed
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.meshing.mesh import tets_of, touching

ANGLES = tuple(float(angle) for angle in range(-30, 31, 5))
"""Degrees of a sweep if no others are asked for."""


@dataclass(frozen=True, slots=True)
class Position:
    """One angle (degrees): the smallest mean ratio in the hexahedron, and the donors; or why there is no mesh."""

    angle: float
    quality_min: float = 0.0
    donors: Donors = field(default_factory=lambda: Donors(0, 0, 0, 0, 0))
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether there is a mesh without inverted cells, and no node is an orphan."""
        return not self.reason and self.quality_min > 0.0 and self.donors.orphans == 0


def donors_at(case: Case, angles: Sequence[float], watch: Stopwatch, cache: bool = True) -> tuple[Position, ...]:
    """Return the donors at each angle: one block, one background and one hole, that of the largest angle, serve all.

    Raises InputError for a case without a Chimera block.
    """
    if case.domain != "block":
        raise InputError(f"case {case.name}: has no Chimera block; aileron-chimera has")
    largest = replace(case, angle=max(angles, key=abs))
    mesh, background, (low, high) = meshed(case, watch, cache)[0], background_mesh(largest, watch, cache), hole(largest)
    found = []
    with watch.stage("donors") as progress:
        for k, angle in enumerate(angles):
            progress(f"{angle:+g} deg", k / len(angles))
            turned = replace(case, angle=angle)
            try:
                plan = plan_of(turned, mesh)
                moved = mesh.with_points(deflect(plan).points)
            except InputError as error:
                found.append(Position(angle, reason=str(error)))
                continue
            inside = tets_of(moved)[touching(mesh, plan.boxes[0].region.inside)]
            quality = float(mean_ratio(moved.points, inside).min())
            found.append(Position(angle, quality, donors(moved, background, low, high)))
        progress(f"{sum(one.donors.orphans for one in found)} orphans at {len(found)} angles", 1.0)
    return tuple(found)


def write_donors(case: Case, positions: Sequence[Position], folder: Path) -> str:
    """Write donors-CASE.md and .csv into `folder`; return the former's text."""
    text = "\n".join([f"# Donors of the {case.name} case", "", *_words(case, positions), "", *_table(positions), ""])
    (folder / f"donors-{case.name}.md").write_text(text, encoding="utf-8")
    names = ["angle", "quality_min", *(one.name for one in fields(Donors)), "reason"]
    rows = [row_of(one) for one in positions]
    write_table(folder / f"donors-{case.name}.csv", [names, *([row[name] for name in names] for row in rows)])
    return text


def row_of(position: Position) -> dict[str, float | int | str]:
    """Return the numbers of one angle, flat."""
    own = {"angle": position.angle, "quality_min": position.quality_min, "reason": position.reason}
    return {**own, **asdict(position.donors)}


def _words(case: Case, positions: Sequence[Position]) -> Iterator[str]:
    total = sum(one.donors.faces + one.donors.fringe for one in positions)
    without = sum(one.donors.orphans for one in positions)
    yield (
        f"Scale `{case.scale}`. The nodes on the block's outer faces seek a donor cell in the mesh of the aircraft, "
        "the nodes of that around its hole seek theirs in the deflected block. "
        f"At {len(positions)} angles {total:,} nodes seek a donor, and {without:,} find none."
    )


def _table(positions: Sequence[Position]) -> Iterator[str]:
    yield (
        "| angle, deg | nodes of the block's faces | without donor | nodes in the hole | around the hole "
        "| without donor | smallest mean ratio in the hexahedron |"
    )
    yield "| ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    for one in positions:
        found = one.donors
        yield f"| {one.angle:+g} | " + (
            f"{one.reason} | | | | | |"
            if one.reason
            else f"{found.faces:,} | {found.faces_without:,} | {found.off:,} | {found.fringe:,} "
            f"| {found.fringe_without:,} | {one.quality_min:.3f} |"
        )
