"""The page of `sdm view`, and the answers to what it asks."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.cases.report.data import MESH_UNITS, METRES, ReportData, diagonal
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.report.page import HERE, picture, templates
from sdm_deflect.cases.report.turnable import indices_of, turnable
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.mesh import Mesh

from .run import DeflectedMesh, InteractiveRun, Spans

MOST_CELLS, MOST_TRIANGLES = 150_000, 100_000
"""A page of this machine may hold more than one that is sent to others."""
HALF = 0.5
"""Patches that reach over more of the mesh are hidden at first, if others remain: they are far fields."""


def html(data: ReportData, scene: Json, live: Json | None, cells: int, port: int) -> str:
    """Return the page of a mesh of so many cells; its script may ask the server at `port` alone."""
    connected = f"ws://127.0.0.1:{port} ws://localhost:{port}"
    shown = picture(data, {**scene, "live": live}, MOST_CELLS, connected)
    template = templates("sdm_deflect.cases.view", HERE).get_template("view.html")
    return template.render(shown, live=live, cells=cells, patches=list(_patches(data)))


def _patches(data: ReportData) -> Iterator[tuple[str, int, int, str, str]]:
    """Yield name, numbers of points and faces, and both corners of the extents of each patch."""
    for patch in data.mesh.patches:
        places = data.length.factor * data.mesh.points[patch.nodes]
        ends = (places.min(axis=0), places.max(axis=0)) if len(places) else ((), ())
        low, high = (", ".join(f"{c:.5g}" for c in end) for end in ends)
        yield patch.name, len(places), len(patch), low, high


def of_mesh(mesh: Mesh, port: int) -> str:
    """Return the page of a mesh that has not been deflected."""
    size = {patch.name: diagonal(mesh.points[patch.nodes]) for patch in mesh.patches if len(patch.nodes)}
    near = [name for name, one in size.items() if one <= HALF * diagonal(mesh.points)]
    shown = tuple(near or size)
    data = ReportData(
        title=mesh.name,
        facts=(),
        mesh=mesh,
        points=mesh.points,
        boxes=(),
        length=MESH_UNITS,
        settings="",
        settings_file="",
        repeat="",
        tables={},
        middle=mesh.points.mean(axis=0),
        drawn=shown,
        hidden=tuple(name for name in mesh.names if name not in shown),
    )
    return html(data, turnable(data, MOST_CELLS, MOST_TRIANGLES), None, sum(mesh.cell_counts), port)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A finished run on display.

    Attributes
    ----------
    finished, run : the run, and the same ready to turn.
    data, scene : what its page shows.
    parts : nodes of each part of the scene that moves; of cells also their rows among those that touch a box.
    """

    finished: FinishedRun = field(repr=False)
    run: InteractiveRun
    data: ReportData = field(repr=False)
    scene: Json = field(repr=False)
    parts: tuple[tuple[IntArray, IntArray | None], ...] = field(repr=False)

    @classmethod
    def of(cls, finished: FinishedRun) -> "View":
        """Prepare a run for display."""
        run, data = InteractiveRun.of(finished), replace(finished.report_data().near, interpolated=None)
        scene = turnable(data, MOST_CELLS, MOST_TRIANGLES)
        moving = [one for one in scene["patches"] if one["moved"]]
        parts = tuple(
            (indices_of(one["nodes"]), indices_of(one["rows"]) if "rows" in one else None)
            for one in (*moving, *scene["cells"]["groups"])
        )
        return cls(finished, run, data, scene, parts)

    def html(self, port: int) -> str:
        """Return the page."""
        live = {
            "angle": self.run.angle,
            "step": self.run.step / 5.0,
            "unit": self.run.unit.strip(),
            "positive": self.run.display.positive,
            "repairs": self.run.repairs,
            "command": self.finished.command,
        }
        return html(self.data, self.scene, live, sum(self.run.mesh.cell_counts), port)

    def spans(self) -> Json:
        """Return the ends of the slider, and the angles that fit, in words too."""
        run, spans = self.run, Spans.of(self.run)
        low, high = spans.fits.low, spans.fits.high
        sentence = f"from {low:+g}{run.unit} to {high:+g}{run.unit} the centres of the run fit and no cell inverts"
        sentence += " without repair" if run.repairs else ""
        return {
            "low": spans.possible.low,
            "high": spans.possible.high,
            "fits": [low, high],
            "sentence": f"{sentence}; positive is {run.display.positive}",
        }

    def answer(self, wish: Json, frame: DeflectedMesh | None) -> tuple[Json | bytes, DeflectedMesh | None]:
        """Return what is said to a page that shows a frame, and the frame that it shows then.

        A page wishes an ``angle``, a number or a text, and whether it ``rests`` and is to be repaired. The answer is a
        sentence, ``said``; or, as bytes: the length of a JSON text, this text, and in single precision the points of
        each part of the scene that moves, after those of a group of cells their qualities.
        """
        try:
            angle, rests = parsed(str(wish.get("angle")), self.run.unit), bool(wish.get("rests"))
            moving = frame if frame and frame.angle == angle and frame.repaired is None else self.run.at(angle)
            shown = self.run.repaired(moving) if rests else moving
        except (InputError, ValueError) as error:
            return {"said": str(error)}, frame
        words = {
            "angle": angle,
            "rests": rests,
            "status": verdict(shown, self.run),
            "fits": shown.fits,
            "notes": [*self._moved(shown), mending(shown, self.run, float(moving.quality.min(initial=1.0)))],
        }
        text = json.dumps(words).encode()
        text += b" " * (-len(text) % 4)
        values = b"".join(np.ascontiguousarray(one, dtype="<f4").tobytes() for one in self._values(shown))
        return len(text).to_bytes(4, "little") + text + values, shown

    def _values(self, frame: DeflectedMesh) -> Iterator[FloatArray]:
        for nodes, rows in self.parts:
            yield frame.points[nodes]
            if rows is not None:
                yield frame.quality[rows]

    def _moved(self, frame: DeflectedMesh) -> Iterator[str]:
        """Yield the amount of each surface, and where the node is that moves farthest."""
        length = self.run.display.length
        for one in self.run.surfaces:
            point = frame.points[one.node]
            travel = float(np.linalg.norm(point - self.run.mesh.points[one.node]))
            place = ", ".join(f"{length.factor * c:.5g}" for c in point)
            amount = f"{one.factor * frame.angle:+.4g}{self.run.unit}"
            yield f"{one.name} by {amount}: {one.place} at ({place}), moved by {length.text(travel)}."


def parsed(text: str, unit: str) -> float:
    """Return the angle that a user typed; ValueError if it is none."""
    try:
        return float(text.strip().replace("\N{MINUS SIGN}", "-").removesuffix(unit).replace(",", "."))
    except ValueError:
        raise ValueError(f"{text.strip()[:40]!r} is not a number" + (" of degrees" if unit[0] != " " else "")) from None


def verdict(frame: DeflectedMesh, run: InteractiveRun) -> str:
    """Return whether the centres of the run fit this angle and no further cell inverts; there are more checks."""
    residual, tolerance = (_small(one, run) for one in (frame.residual, frame.tolerance))
    count = len(frame.inverted)
    if frame.further:
        cells = "1 inverted cell" if count == 1 else f"{count} inverted cells"
        cells += f" ({frame.further} of them not before)" if frame.further < count else ""
        remedy = "" if run.repairs else " Run it at this angle with repair, or turn it less."
        return f"\N{MULTIPLICATION X} {cells}; residual {residual}.{remedy}"
    if frame.residual >= frame.tolerance:
        return f"! Residual {residual}, above the run's tolerance of {tolerance}. Run it at this angle."
    known = f"{count} inverted cells as before" if count else "no inverted cell"
    least = float(frame.quality.min(initial=1.0))
    return f"\N{CHECK MARK} Residual {residual}, below {tolerance}; {known}; least quality {least:.3f}."


def mending(frame: DeflectedMesh, run: InteractiveRun, before: float) -> str:
    """Return what the repair has done to a frame, given the least quality of the interpolant's mesh."""
    if not run.repairs:
        return "Repair: off in this run; the mesh is the interpolant's."
    if frame.repaired is None:
        return "Repair: once the slider rests; the mesh is the interpolant's."
    if not frame.repaired:
        return "Repair: none was needed."
    nodes = "1 node" if frame.repaired == 1 else f"{frame.repaired:,} nodes"
    now = float(frame.quality.min())
    return f"Repaired: {nodes} moved, least quality {before:.3f} \N{RIGHTWARDS ARROW} {now:.3f}."


def _small(length: float, run: InteractiveRun) -> str:
    """Return a length about as large as a residual."""
    return f"{1e6 * length:.1f} µm" if run.display.length is METRES else f"{length:.2e}"
