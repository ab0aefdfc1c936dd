"""What the page says about a frame."""

from typing import Any

import numpy as np

from sdm_deflect.cases.view.live import Frame, Live
from sdm_deflect.cases.view.span import Spans
from sdm_deflect.deform.mesh import FloatArray


def verdict(frame: Frame) -> tuple[str, str]:
    """Return whether the mesh at this angle is verified, as a kind of message and a sentence."""
    residual, tolerance = f"{1e6 * frame.residual:.1f}", f"{1e6 * frame.tolerance:g}"
    count = len(frame.inverted)
    if count:
        cells = "1 inverted cell" if count == 1 else f"{count} inverted cells"
        return "error", f"\N{MULTIPLICATION X} Not verified: {cells}, drawn red; residual {residual} µm."
    if frame.residual >= frame.tolerance:
        return "warning", f"! Not verified: residual {residual} µm, above the run's tolerance of {tolerance} µm."
    return "success", f"\N{CHECK MARK} Verified: residual {residual} µm, below {tolerance} µm; no inverted cell."


def facts(frame: Frame, live: Live) -> list[dict[str, str]]:
    """Return the numbers of a frame as rows of a table; each has an id, a name and a value.

    The middle of the trailing edge tells how far a surface has turned.
    """
    rows = [
        ("shown", "shown at", f"{frame.angle:+g}°"),
        ("residual", "residual at all data sites", f"{1e6 * frame.residual:.2f} µm"),
        ("smallest", "smallest mean ratio", f"{frame.quality.min():.3f}"),
        ("worst", "  in the cell at", _millimetres(worst_place(frame, live))),
        ("inverted", "inverted cells", str(len(frame.inverted))),
    ]
    for part in live.parts:
        point, alone = frame.points[part.trailing], len(live.parts) == 1
        moved = 1e3 * float(np.linalg.norm(point - live.mesh.points[part.trailing]))
        if alone:
            rows.append((f"trailing-{part.surface}", "trailing edge", _millimetres(point)))
        name = "  moved by" if alone else f"{part.surface.replace('_', ' ')} moved by"
        rows.append((f"moved-{part.surface}", name, f"{moved:.3f} mm"))
    return [{"id": key, "name": name, "value": value} for key, name, value in rows]


def worst_place(frame: Frame, live: Live) -> FloatArray:
    """Return the middle (3,) of the cell of lowest quality."""
    return np.asarray(frame.points[live.cells[np.argmin(frame.quality)]].mean(axis=0))


def _millimetres(point: FloatArray) -> str:
    return "(" + ", ".join(f"{1e3 * c:.2f}" for c in point) + ") mm"


def parsed(text: str, spans: Spans) -> float:
    """Return the angle (deg) that a user typed.

    Raises
    ------
    ValueError
        One sentence: what is wrong with it and what would be right.
    """
    span = spans.possible
    try:
        angle = float(text.strip().replace("\N{MINUS SIGN}", "-").removesuffix("°").replace(",", "."))
    except ValueError:
        raise ValueError(f"{text.strip()!r} is not a number of degrees") from None
    if angle not in span:
        reason = span.below if angle < span.low else span.above if angle > span.high else ""
        end = f": {reason}" if reason else ""
        raise ValueError(f"{angle:g}° is outside {span.low:g}° to {span.high:g}°{end}")
    return angle


def about(live: Live) -> dict[str, Any]:
    """Return what the page says once about the run."""
    case, parts = live.case, live.parts
    centres = sum(len(fit.chosen) for part in parts for step in part.known.steps for fit in step.fits.adaptations)
    steps = sum(len(part.known.steps) for part in parts)
    surfaces = [
        part.surface.replace("_", " ") + ("" if part.factor == 1.0 else f" × {part.factor:g}") for part in parts
    ]
    return {
        "run_title": case.title,
        "run_facts": f"{len(live.mesh.points):,} points, {len(live.mesh.tets):,} tetrahedra, of which "
        f"{len(live.cells):,} touch a hexahedron. {centres:,} centres of the run at {case.angle:+g}°"
        + (f", {steps} steps" if steps > len(parts) else "")
        + ". "
        + ("Surfaces: " + ", ".join(surfaces) + "." if len(parts) > 1 else ""),
    }
