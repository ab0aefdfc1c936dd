"""The interactive page: from what the user sets to the scene and the texts that answer it."""

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isfinite
from time import perf_counter
from typing import Any

import numpy as np
from trame.app import asynchronous, get_server

from sdm_deflect.cases.view.labels import (
    COLOURS,
    about,
    facts,
    grain,
    histogram,
    key,
    mending,
    parsed,
    rounded,
    verdict,
)
from sdm_deflect.cases.view.layout import BOX, NOTES, lay_out
from sdm_deflect.cases.view.pieces import ClipPlane, ViewPiece, ViewPieces, bounds, boxes, outboard, outline
from sdm_deflect.cases.view.run import DeflectedMesh, InteractiveRun, Spans
from sdm_deflect.cases.view.scene import ViewScene
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError

AXES = ("x", "y", "z")
INPUTS = ("angle", "axis", "position", "show_sectioned", "show_cut", "colour")
SWITCHES = {"show_box": "box", "show_outline": "outline", "show_centres": "centres"}
OBLIQUE = {0: (1.0, 0.5, 0.4), 1: (0.75, 1.0, 0.55), 2: (0.6, 0.9, 0.9)}
"""Where the eye is, for each axis of the section: outboard, aft and above."""
ENDED = (
    '<div style="position:fixed;inset:0;overflow:auto;color-scheme:light dark;background:Canvas;color:CanvasText">'
    '<main role="alert" style="max-width:36rem;margin:20vh auto;padding:0 1rem;font:16px/1.5 sans-serif">'
    "<h1 style='font-size:22px'>sdm view has ended</h1><p>The command that served this page was ended, or its machine "
    "cannot be reached. Start <code>sdm view</code> again and open the address that it prints.</p></main></div>"
)
"""What the page shows without its server."""
TURN, STEEPEST = 15.0, 85.0
"""Degrees by which a button turns the picture, and the most that the eye is above or below."""
REST = 0.3
"""Seconds without an input after which the slider rests."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the user has set: the angle, whether it rests, the section, its colours and what else to show."""

    angle: float
    axis: str
    position: float
    sectioned: bool = True
    cut: bool = False
    rests: bool = False
    colour: str = "quality"

    @property
    def plane(self) -> ClipPlane | None:
        """The plane of the section, if one is wanted."""
        return ClipPlane(AXES.index(self.axis), self.position) if self.sectioned else None

    @property
    def cut_plane(self) -> ClipPlane | None:
        """The plane beyond which the walls are left out, if that is wanted."""
        return self.plane if self.cut else None


@dataclass(slots=True)
class Control:
    """A run on display; remembers what is shown, so that only what an input concerns is made and sent again."""

    run: InteractiveRun
    spans: Spans
    pieces: ViewPieces
    scene: ViewScene
    frame: DeflectedMesh
    undeflected: DeflectedMesh
    shown: Wish | None = field(default=None)

    @classmethod
    def of(cls, run: InteractiveRun) -> "Control":
        """Prepare a run for display."""
        undeflected = run.at(0.0)
        return cls(run, Spans.of(run), ViewPieces.of(run), ViewScene(), undeflected, undeflected).for_another_page()

    def for_another_page(self) -> "Control":
        """Return the same run with a scene of its own, in which nothing is shown yet."""
        scene = ViewScene()
        scene.show({"box": boxes(self.run), "outline": outline(self.run)})
        return Control(self.run, self.spans, self.pieces, scene, self.undeflected, self.undeflected)

    def show(self, wish: Wish) -> dict[str, Any]:
        """Bring the scene to what is wanted and return what the page is to say.

        Raises InputError if no surface motion exists at that angle; the scene is then as before.
        """
        before, answer = self.shown, dict[str, Any]()
        if before is None or wish.angle != before.angle or (self.run.repairs and wish.rests != before.rests):
            frame = self.run.at(wish.angle)
            least = float(frame.quality.min(initial=1.0))
            self.frame = self.run.repaired(frame) if wish.rests else frame
            answer = self._said() | {"repair": mending(self.frame, self.run, least)}
        if before is None or (wish.plane, wish.cut, wish.colour) != (before.plane, before.cut, before.colour):
            self.scene.show(self.pieces.standing(wish.plane, wish.cut_plane, wish.colour))
        self.scene.show(self.pieces.moving(self.frame, wish.plane, wish.cut_plane, wish.colour))
        if answer or before is None or wish.colour != before.colour:
            answer |= key(wish.colour, self.run, self.pieces.farthest(self.frame))
        if wish.plane is None:
            self.scene.hide("section", "around")
        self.scene.show({"centres": ViewPiece.dots(self.run.centers(self.frame))})
        self.shown = wish
        return answer

    def first(self) -> Wish:
        """Return what is shown at first: the run's angle, a section across the hinge of a single surface."""
        plan, mesh = self.run.boxes[0].plan, self.run.mesh
        hinge = plan.job.surfaces[0].motion.axis
        points = mesh.points[mesh.on(*self.run.surfaces[0].patches)]
        axis = int(np.argmax(np.ptp(points, axis=0) if hinge is None else np.abs(hinge.direction)))
        middle = 0.5 * float(points[:, axis].min() + points[:, axis].max())
        return Wish(self.run.angle, AXES[axis], rounded(middle, self.run), len(self.run.boxes) == 1, rests=True)

    def reach(self, axis: str) -> tuple[float, float]:
        """Return the positions of the section between which it meets a hexahedron."""
        low, high = (rounded(float(end[AXES.index(axis)]), self.run) for end in bounds(self.run))
        return low, high

    def _said(self) -> dict[str, Any]:
        kind, sentence = verdict(self.frame, self.run)
        weights = self.run.weights
        return {
            "status": sentence,
            "status_style": BOX + NOTES[kind],
            "facts": facts(self.frame, self.run, self.pieces),
            "histogram": histogram(weights * self.frame.quality, weights * self.undeflected.quality, self.run.measure),
        }


@dataclass(slots=True)
class Page:
    """One page on one server.

    Inputs may arrive faster than they are answered: each round answers the latest, those before it are passed over.
    """

    control: Control
    server: Any = field(default_factory=lambda: get_server(f"view-{perf_counter()}", client_type="vue3"))
    view: Any = None
    _towards: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    _new: bool = True
    _typed: float | None = None
    _due: asyncio.Event = field(default_factory=asyncio.Event)
    _task: "asyncio.Task[None] | None" = None

    def __post_init__(self) -> None:
        state, wish = self.server.state, self.control.first()
        state.trame__title = "sdm view"
        state.trame__template_error = state.trame__template_error_reconnect = ENDED
        state.update({**about(self.control.run), **self._ranges(wish), **self.control.show(wish)})
        state.update({"angle": wish.angle, "angle_text": f"{wish.angle:g}", "axis": wish.axis, "refusal": ""})
        state.update(
            {"position": wish.position, "elapsed": "–", "show_sectioned": wish.sectioned, "show_cut": wish.cut}
        )
        state.colour = wish.colour
        state.update({"show_box": True, "show_outline": True, "show_centres": False, "dark": False})
        self._aim(OBLIQUE[AXES.index(wish.axis)])
        self._switch()
        self.view = lay_out(self.server, self.control.scene.window, self)
        self.server.controller.on_client_connected.add(self._connected)
        state.change(*INPUTS, *SWITCHES, "dark")(self._changed)

    def loaded(self) -> None:
        """Send the first camera to a browser that shows its first picture; later ones keep their own."""
        if self._new:
            self._new = False
            self.view.push_camera()

    def accept(self, text: str) -> None:
        """Take the angle that was typed, or say why not."""
        state = self.server.state
        try:
            angle = parsed(text, self.control.spans, self.control.run.unit)
        except ValueError as error:
            state.refusal = str(error)
            return
        self._typed = angle
        state.update({"refusal": "", "angle": angle, "angle_text": f"{angle:g}"})

    def fit(self) -> None:
        """Look at the hexahedra at a slant."""
        self._aim(OBLIQUE[AXES.index(self.server.state.axis)])
        self.view.push_camera()

    def turn(self, about: int, upwards: int) -> None:
        """Turn the picture by steps about the vertical and upwards, from where a button has put the eye last."""
        x, y, z = self._towards
        azimuth = np.arctan2(y, x) + np.radians(TURN * about)
        steep = np.radians(STEEPEST)
        height = np.clip(np.arctan2(z, np.hypot(x, y)) + np.radians(TURN * upwards), -steep, steep)
        self._look(np.array([np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)]))
        self.view.push_camera()

    def face(self) -> None:
        """Look at the section squarely."""
        axis = AXES.index(self.server.state.axis)
        self._aim(tuple(float(i == axis) for i in range(3)))
        self.view.push_camera()

    def worst(self) -> None:
        """Put the section through the cell of lowest quality."""
        state, control = self.server.state, self.control
        if len(control.frame.quality):
            place = float(control.pieces.worst(control.frame)[AXES.index(state.axis)])
            state.update({"position": rounded(place, control.run), "show_sectioned": True})

    def _aim(self, towards: tuple[float, ...]) -> None:
        """Put the eye in a direction from the hexahedra, on the side that is cut away."""
        run = self.control.run
        self._look(np.array((0.0, 0.0, 1.0) if run.mesh.plane else towards) * (1.0, outboard(run), 1.0))

    def _look(self, away: FloatArray) -> None:
        """Put the eye in a direction (3,) from the surfaces that move."""
        self._towards, run = away, self.control.run
        points = run.mesh.points[run.mesh.on(*(name for one in run.surfaces for name in one.patches))]
        low, high = points.min(axis=0), points.max(axis=0)
        up = (0.0, 1.0, 0.0) if run.mesh.plane else (1.0, 0.0, 0.0)
        size = float(np.linalg.norm(high - low))
        self.control.scene.look(0.5 * (low + high), away, 2.0 * size if run.mesh.plane else size, up)

    def _connected(self, **_: Any) -> None:
        self._new = True

    def _changed(self, **_: Any) -> None:
        """Note that the page is out of date and see to it that a round comes."""
        self._due.set()
        if self._task is None or self._task.done():
            self._task = asynchronous.create_task(self._rounds())

    async def _rounds(self) -> None:
        while self._due.is_set():
            self._due.clear()
            with self.server.state as state:
                self._round(state)
            await asyncio.sleep(0.005)  # lets the inputs that have arrived since come in
            shown = self.control.shown
            if self._due.is_set() or not self.control.run.repairs or (shown is not None and shown.rests):
                continue
            with suppress(TimeoutError):
                await asyncio.wait_for(self._due.wait(), REST)
                continue
            with self.server.state as state:
                self._round(state, rests=True)

    def _round(self, state: Any, rests: bool = False) -> None:
        """Answer the latest inputs: compute, send the geometry, and say how long that took.

        At an angle that rests the mesh is the repaired one, until the angle changes.
        """
        start, shown = perf_counter(), self.control.shown
        try:
            wish = self._wish(state)
            wish = replace(wish, rests=rests or (shown is not None and shown.rests and shown.angle == wish.angle))
        except (TypeError, ValueError) as error:
            state.refusal = f"the page sent no usable inputs: {error}"
            return
        if shown is not None and wish.axis != shown.axis:
            low, high = self.control.reach(wish.axis)
            wish = replace(wish, position=rounded(0.5 * (low + high), self.control.run))
            state.update({**self._ranges(wish), "position": wish.position})
        if wish != shown:
            if wish.angle not in (self.control.frame.angle, self._typed):  # it came from the slider
                state.update({"angle_text": f"{wish.angle:g}", "refusal": ""})
                self._typed = None
            try:
                state.update(self.control.show(wish))
            except InputError as error:
                state.refusal = str(error)
        self._switch()
        self.view.update()
        state.elapsed = f"{1e3 * (perf_counter() - start):.0f}"

    def _wish(self, state: Any) -> Wish:
        """Return what the page's inputs say; TypeError or ValueError if they are none."""
        if state.axis not in AXES or not isfinite(float(state.position)):
            raise ValueError(f"a section across {state.axis} at {state.position}")
        if state.colour not in COLOURS:
            raise ValueError(f"colours by {state.colour}")
        place = float(state.position)
        return Wish(float(state.angle), state.axis, place, state.show_sectioned, state.show_cut, colour=state.colour)

    def _switch(self) -> None:
        for switch, name in SWITCHES.items():
            self.control.scene.actors[name].SetVisibility(bool(self.server.state[switch]))
        self.control.scene.darken(bool(self.server.state.dark))

    def _ranges(self, wish: Wish) -> dict[str, Any]:
        """Return the ends of the sliders and the band of verified angles."""
        run, possible, verified = self.control.run, self.control.spans.possible, self.control.spans.verified
        low, high = self.control.reach(wish.axis)
        ends = np.array([verified.low, verified.high])
        start, end = 100.0 * (ends - possible.low) / (possible.high - possible.low)
        rest, good = "var(--range)", "var(--success)"
        band = f"{rest} {start:.1f}%,{good} {start:.1f}%,{good} {end:.1f}%,{rest} {end:.1f}%"
        return {
            "angle_low": possible.low,
            "angle_high": possible.high,
            "angle_step": run.step / 5.0,
            "position_low": low,
            "position_high": high,
            "position_step": grain(run),
            "band": f"height:4px;margin:0 16px;border-radius:2px;background:linear-gradient(90deg,{band})",
            "band_text": f"{verified.low:+g}{run.unit} to {verified.high:+g}{run.unit} are verified (green)"
            + (" without repair" if run.repairs else "")
            + f"; positive is {run.display.positive}",
        }
