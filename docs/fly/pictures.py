"""Pictures for the slides: `python -m docs.fly.pictures FOLDER` writes six PNGs.

method_sum.png: one radial function and a sum of three; method_box.png: a field without and with sites on the box;
method_directions.png: centres of SQUV and MV; method_rigid.png: how far a blended aileron is from a rigid one;
method_hinge.png: the aileron by two orders of the hinge's points; fly.png: "Fly the mesh", which needs Chromium.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import sdm_deflect
from docs.fly.facts import KEPT
from docs.fly.figure import draw_field
from docs.fly.page import PAGE
from docs.fly.tail import Tail, fighter, skin
from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.cases.report.colours import DISPLACEMENT, INK, MOVES, SOFT, STAYS, WORSE
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import rigid

# Centres on a line, and their displacements.
PLACES, VALUES = (0.15, 0.5, 0.8), (0.0, 0.1, 0.03)
SIZE = (9.0, 3.6)
# Colours of a PNG: with more a file is larger, and looks the same.
COLOURS = 96
# Plane of the section through wing and aileron: y in metres, in the middle of the aileron.
ACROSS = -0.21


def draw_sum() -> Figure:
    """Draw one radial function about a centre, and three of them whose sum meets three displacements."""
    centers = np.array([[place, 0.0, 0.0] for place in PLACES])
    found = fit(ThinPlateSpline(), centers, np.array(VALUES)[:, None])
    x = np.linspace(0.0, 1.0, 301)
    line = np.column_stack([x, 0.0 * x, 0.0 * x])
    figure = Figure(figsize=SIZE, layout="constrained")
    one, several = figure.subplots(1, 2)
    one.plot(x - 0.5, ThinPlateSpline()((x - 0.5) ** 2), color=MOVES, lw=2.0)
    one.plot(0.0, 0.0, "o", color=INK)
    one.set(title="one radial function, r² ln r, and its centre", xlabel="distance from the centre")
    parts = [
        weight * ThinPlateSpline()((x - place) ** 2) for place, weight in zip(PLACES, found.beta[:, 0], strict=True)
    ]
    for part in parts:
        several.plot(x, part, color=STAYS, lw=1.5)
    plane = found.alpha[0, 0] + found.alpha[1, 0] * x
    several.plot(x, plane, color=SOFT, lw=1.2, ls=":", label="linear part")
    several.plot(x, found(line)[:, 0], color=MOVES, lw=2.0, label="their sum")
    several.plot(PLACES, VALUES, "o", color=INK, label="known displacements")
    several.set(title="three of them, weighted, and a linear part", xlabel="x")
    several.legend(frameon=False, fontsize="small")
    return figure


def draw_box() -> Figure:
    """Draw the field of the fighter's tail without and with sites on the box."""
    tail = Tail.at()
    figure = Figure(figsize=SIZE, layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_field(left, tail, tail.without_box(), held=False)
    draw_field(right, tail, tail.with_all(), held=True)
    return figure


def draw_directions() -> Figure:
    """Draw the centres of each direction by SQUV, and those of MV, for the fighter's surfaces."""
    facts = json.loads(KEPT.read_text(encoding="utf-8"))["strategies"]
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    for place, both in enumerate(facts.values()):
        for k, (count, name) in enumerate(zip(both["squv"]["centres"], "xyz", strict=True)):
            axes.bar(place - 0.3 + 0.2 * k, count, 0.18, color=MOVES, alpha=0.5 + 0.25 * k)
            axes.annotate(name, (place - 0.3 + 0.2 * k, count), ha="center", va="bottom", fontsize="small")
        axes.bar(place + 0.3, both["mv"]["centres"][0], 0.18, color=STAYS)
        axes.annotate("MV", (place + 0.3, both["mv"]["centres"][0]), ha="center", va="bottom", fontsize="small")
    axes.set_xticks(range(len(facts)), [name.replace("_", " ") for name in facts])
    axes.set(ylabel="centres", title="SQUV: centres for x, y and z (blue); MV: one set for all (grey)")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_rigid() -> Figure:
    """Draw the distance of each node of the blended aileron at -12 degrees from the rigidly turned skin."""
    mesh, _ = fighter()
    nodes, faces = mesh.on("aileron_left"), mesh.patch("aileron_left").faces[0].nodes
    hinge = [rigid.FIRST, rigid.SECOND]
    result = sdm_deflect.deflect(mesh, "aileron_left", hinge, rigid.ANGLE, motion="blended", fixed="wing_left")
    skin = rigid.turned(mesh.points)[faces]
    far = np.array([nearest(point, skin) for point in result.points[nodes]])
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    up = np.cross(*(mesh.points[faces[:, k]] - mesh.points[faces[:, 0]] for k in (1, 2)))[:, 2] < 0.0  # out of the flow
    seen = np.searchsorted(nodes, faces[up])
    across, aft = mesh.points[nodes, 1], -mesh.points[nodes, 0]
    drawn = axes.tripcolor(across, aft, seen, 1e3 * far, cmap=DISPLACEMENT, shading="gouraud")
    axes.triplot(across, aft, seen, color=INK, lw=0.3, alpha=0.5)
    worst = int(np.argmax(far))
    axes.annotate(
        f"{1e3 * far.max():.2f} mm: the closed rib stays", (across[worst], aft[worst]), (-70, -30), ha="right",
        textcoords="offset points", arrowprops={"arrowstyle": "-"}, fontsize="small",
    )  # fmt: skip
    figure.colorbar(drawn, ax=axes, label="distance from rigid, mm", shrink=0.8)
    axes.set(aspect="equal", title="Blended aileron from above: distance from the rigid one")
    axes.axis("off")
    return figure


def nearest(point: FloatArray, skin: FloatArray) -> float:
    """Return the distance of a point from the nearest of triangles (F, 3, 3)."""
    order = np.argsort(np.linalg.norm(skin.mean(axis=1) - point, axis=1))
    return min(rigid.distance(point, skin[row]) for row in order[: rigid.NEAR])


def draw_hinge() -> Figure:
    """Draw a section of wing and aileron, before and after 12 degrees by both orders of the hinge's points."""
    mesh, _ = fighter()
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    hinge = [rigid.FIRST, rigid.SECOND]
    for ends in skin(mesh, "wing_left", ACROSS, mesh.points):
        axes.plot(*ends.T, color=INK, lw=2.0)
    poses = {"before": (mesh.points, INK), "outer point first": (turned_by(hinge), MOVES)}
    poses["inner point first"] = turned_by(hinge[::-1]), WORSE
    for text, (points, colour) in poses.items():
        for k, ends in enumerate(skin(mesh, "aileron_left", ACROSS, points)):
            axes.plot(*ends.T, color=colour, lw=2.0, label=None if k else text)
    axes.set(
        aspect="equal",
        xlim=(0.672, 0.706),
        ylim=(-0.0055, 0.0055),
        title="12 degrees, by two orders of the hinge's points",
    )
    axes.legend(frameon=False, loc="center left")
    axes.axis("off")
    return figure


def turned_by(hinge: list[FloatArray]) -> FloatArray:
    """Return the points (N, 3) of the fighter with its left aileron at 12 degrees about a hinge."""
    result = sdm_deflect.deflect(fighter()[0], "aileron_left", hinge, 12.0, motion="blended", fixed="wing_left")
    return result.points


def write_fly(path: Path) -> None:
    """Write a picture of the page's fighter with all surfaces deflected."""
    from playwright.sync_api import sync_playwright
    from screens import SWITCHES

    with sync_playwright() as playwright:
        program = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = playwright.chromium.launch(executable_path=program, args=SWITCHES)
        tab = browser.new_page(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
        tab.goto(f"{PAGE.as_uri()}#step=1&roll=-0.6&yaw=0.6&pitch=0.8&surface=tail_left")
        tab.wait_for_selector("body[data-ready]")
        pixels = BytesIO(tab.locator("#view canvas:not(#section)").screenshot())
        browser.close()
    Image.open(pixels).convert("RGB").quantize(256).save(path, optimize=True)


PICTURES: dict[str, Callable[[], Figure]] = {
    "method_sum": draw_sum, "method_box": draw_box, "method_directions": draw_directions, "method_rigid": draw_rigid,
    "method_hinge": draw_hinge,
}  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path(__file__).parents[1] / "figures")
    folder = parser.parse_args().folder
    for name, draw in PICTURES.items():
        pixels = BytesIO()
        draw().savefig(pixels, dpi=130, facecolor="white")
        Image.open(pixels).convert("RGB").quantize(COLOURS).save(folder / f"{name}.png", optimize=True)
    write_fly(folder / "fly.png")
