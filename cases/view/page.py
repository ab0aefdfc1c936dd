"""The interactive page: state in, scene and texts out."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from trame.app import asynchronous, get_server

from sdm_deflect.cases.view.control import AXES, Control, Wish
from sdm_deflect.cases.view.layout import lay_out
from sdm_deflect.cases.view.pieces import outboard
from sdm_deflect.cases.view.words import about, parsed, worst_place
from sdm_deflect.deform.errors import InputError

INPUTS = ("angle", "axis", "position", "show_sectioned", "show_cut")
SWITCHES = {"show_box": "box", "show_outline": "outline", "show_centres": "centres"}
OBLIQUE = {0: (1.0, 0.5, 0.4), 1: (0.75, 1.0, 0.55), 2: (0.6, 0.9, 0.9)}
"""Where the eye is, for each axis of the section: outboard, aft and above."""

CLOSE = 1.0
"""Height of the first picture over the size of the control surfaces."""


@dataclass(slots=True)
class Page:
    """One page on one server.

    Inputs may arrive faster than they are answered: each round answers the latest, those before it are passed over.
    """

    control: Control
    server: Any = field(default_factory=lambda: get_server(f"view-{perf_counter()}", client_type="vue3"))
    view: Any = None
    _new: bool = True
    _typed: float | None = None
    _due: bool = False
    _task: "asyncio.Task[None] | None" = None

    def __post_init__(self) -> None:
        state, wish = self.server.state, self.control.first()
        state.trame__title = "sdm view"
        state.update({**about(self.control.live), **self._ranges(wish), **self.control.show(wish)})
        state.update({"angle": wish.angle, "angle_text": f"{wish.angle:g}", "axis": wish.axis, "refusal": ""})
        state.update(
            {"position": wish.position, "elapsed": "–", "show_sectioned": wish.sectioned, "show_cut": wish.cut}
        )
        state.update({"show_box": True, "show_outline": True, "show_centres": False})
        self._aim(OBLIQUE[AXES.index(wish.axis)])
        self._switch()
        self.view = lay_out(self.server, self.control.scene.window, self)
        self.server.controller.on_client_connected.add(self._connected)
        state.change(*INPUTS, *SWITCHES)(self._changed)

    def loaded(self) -> None:
        """Send the first camera to a browser that shows its first picture; later ones keep their own."""
        if self._new:
            self._new = False
            self.view.push_camera()

    def accept(self, text: str) -> None:
        """Take the angle that was typed, or say why not."""
        state = self.server.state
        try:
            angle = parsed(text, self.control.spans)
        except ValueError as error:
            state.refusal = str(error)
            return
        self._typed = angle
        state.update({"refusal": "", "angle": angle, "angle_text": f"{angle:g}"})

    def fit(self) -> None:
        """Look at the hexahedra at a slant."""
        self._aim(OBLIQUE[AXES.index(self.server.state.axis)])
        self.view.push_camera()

    def face(self) -> None:
        """Look at the section squarely."""
        axis = AXES.index(self.server.state.axis)
        self._aim(tuple(float(i == axis) for i in range(3)))
        self.view.push_camera()

    def worst(self) -> None:
        """Put the section through the cell of lowest quality."""
        state, control = self.server.state, self.control
        place = worst_place(control.frame, control.live)
        state.update({"position": round(float(place[AXES.index(state.axis)]), 5), "show_sectioned": True})

    def _aim(self, towards: tuple[float, ...]) -> None:
        """Put the eye in a direction from the hexahedra, on the side that is cut away."""
        live = self.control.live
        points = live.mesh.points[live.mesh.on(*(part.surface for part in live.parts))]
        low, high = points.min(axis=0), points.max(axis=0)
        away = np.array(towards) * (1.0, outboard(live), 1.0)
        self.control.scene.look(0.5 * (low + high), away, CLOSE * float(np.linalg.norm(high - low)))

    def _connected(self, **_: Any) -> None:
        self._new = True

    def _changed(self, **_: Any) -> None:
        """Note that the page is out of date and see to it that a round comes."""
        self._due = True
        if self._task is None or self._task.done():
            self._task = asynchronous.create_task(self._rounds())

    async def _rounds(self) -> None:
        while self._due:
            self._due = False
            with self.server.state as state:
                self._round(state)
            await asyncio.sleep(0.005)  # lets the inputs that have arrived since come in

    def _round(self, state: Any) -> None:
        """Answer the latest inputs: compute, send the geometry, and say how long that took."""
        start, wish = perf_counter(), self._wish(state)
        if self.control.shown is not None and wish.axis != self.control.shown.axis:
            low, high = self.control.reach(wish.axis)
            wish = replace(wish, position=round(0.5 * (low + high), 4))
            state.update({**self._ranges(wish), "position": wish.position})
        if wish != self.control.shown:
            if wish.angle not in (self.control.frame.angle, self._typed):  # it came from the slider
                state.update({"angle_text": f"{wish.angle:g}", "refusal": ""})
                self._typed = None
            try:
                state.update(self.control.show(wish))
            except (InputError, ValueError) as error:
                state.refusal = str(error)
        self._switch()
        self.view.update()
        state.elapsed = f"{1e3 * (perf_counter() - start):.0f}"

    def _wish(self, state: Any) -> Wish:
        return Wish(float(state.angle), state.axis, float(state.position), state.show_sectioned, state.show_cut)

    def _switch(self) -> None:
        for key, name in SWITCHES.items():
            self.control.scene.actors[name].SetVisibility(bool(self.server.state[key]))

    def _ranges(self, wish: Wish) -> dict[str, Any]:
        """Return the ends of the sliders and the band of verified angles."""
        possible, verified = self.control.spans.possible, self.control.spans.verified
        low, high = self.control.reach(wish.axis)
        share: Callable[[float], float] = lambda a: 100.0 * (a - possible.low) / (possible.high - possible.low)  # noqa: E731
        start, end = share(verified.low), share(verified.high)
        band = f"#ccc {start:.1f}%,#2e7d32 {start:.1f}%,#2e7d32 {end:.1f}%,#ccc {end:.1f}%"
        return {
            "angle_low": possible.low, "angle_high": possible.high,
            "position_low": low, "position_high": high,
            "band": f"height:4px;margin:0 16px;border-radius:2px;background:linear-gradient(90deg,{band})",
            "band_text": f"{verified.low:+g}° to {verified.high:+g}° are verified (green); positive is "
            + ("to port" if self.control.live.parts[0].surface == "rudder" else "trailing edge down"),
        }  # fmt: skip
