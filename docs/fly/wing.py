"""What README's command says and does on the half wing of `sdm example`, by its angle and by its strip."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import sdm_deflect
from docs.fly.texts import Facts
from sdm_deflect.base.numbers import percent

HINGE = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]
COMMAND = (
    "deflect naca.su2 --surface flap --fixed wing --hinge 0.7,0.6,0 0.7,1.4,0 --motion blended --no-report --quiet "
    "--out out.su2"
)
# Angles (degrees) of which the guide has the last line: one that passes, one that is usable, and one that fails.
ANGLES = (15, 60, 85)
# Ends of a plan's range, and an amount within it (degrees).
RANGE, AMOUNT = 25.0, 12.0
# Angles and strips of the table, as `--angle` and `--strip` take them.
STRIPS = ((15, "0.2"), (15, "0.08"), (15, "auto"), (5, "auto"))


def wing() -> Facts:
    """Return the last lines, and how far the flap turns with each strip."""
    with TemporaryDirectory() as scratch:
        _sdm(scratch, "example")
        said = {str(angle): _sdm(scratch, *COMMAND.split(), "--angle", str(angle)).splitlines()[-1] for angle in ANGLES}
        path = Path(scratch, "naca.su2")
        return {"said": said, "strips": [*strips(path)], "plan": plan(path)}


def _sdm(folder: str, *words: str) -> str:
    """Run a command in a folder; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", "sdm_deflect", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def plan(path: Path) -> Facts:
    """Return how far (chords) a plan's mesh is from that of `deflect` at the same angle, within the flow."""
    mesh = sdm_deflect.read(path)
    settings = {"motion": "blended", "fixed": "wing"}
    by_plan = sdm_deflect.plan(mesh, "flap", HINGE, range=(-RANGE, RANGE), **settings).at(AMOUNT)
    points = sdm_deflect.deflect(mesh, "flap", HINGE, AMOUNT, **settings).points
    moved = (by_plan != mesh.points).any(axis=1) | (points != mesh.points).any(axis=1)
    moved[mesh.on(*mesh.names)] = False
    apart = np.linalg.norm(by_plan - points, axis=1)[moved]
    largest = np.linalg.norm((points - mesh.points)[mesh.on("flap")], axis=1).max()
    return {"most": float(apart.max()), "median": float(np.median(apart)), "moves": float(largest)}


def strips(path: Path) -> Iterator[Facts]:
    """Yield the share of the span that turns by the full angle, the mean share of the angle, and the worst cell."""
    mesh = sdm_deflect.read(path)
    for angle, strip in STRIPS:
        given = strip if strip == "auto" else float(strip)
        result = sdm_deflect.deflect(mesh, "flap", HINGE, angle, motion="blended", fixed="wing", strip=given)
        (box,) = result.deflection.boxes
        ((_, share),) = box.plan.boundary.reaches(box.amounts)
        least = min(one.min for one in result.quality)
        yield {"angle": angle, "strip": strip, "full": percent(share.full), "mean": percent(share.mean), "least": least}
