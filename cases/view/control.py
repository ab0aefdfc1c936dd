"""From what the user sets to what the page shows: only what an input concerns is computed and sent again."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sdm_deflect.cases.view.histogram import histogram
from sdm_deflect.cases.view.layout import BOX, NOTES
from sdm_deflect.cases.view.live import Frame, Live
from sdm_deflect.cases.view.pieces import Piece, Pieces, bounds, boxes, outline
from sdm_deflect.cases.view.scene import Scene
from sdm_deflect.cases.view.section import Plane
from sdm_deflect.cases.view.span import Spans
from sdm_deflect.cases.view.words import facts, verdict

AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Wish:
    """What the user has set: the angle (deg), the section and what else to show."""

    angle: float
    axis: str
    position: float  # m
    sectioned: bool = True
    cut: bool = False

    @property
    def plane(self) -> Plane | None:
        """The plane of the section, if one is wanted."""
        return Plane(AXES.index(self.axis), self.position) if self.sectioned else None

    @property
    def cut_plane(self) -> Plane | None:
        """The plane beyond which the walls are left out, if that is wanted."""
        return self.plane if self.cut else None


@dataclass(slots=True)
class Control:
    """A run on display; remembers what is shown."""

    live: Live
    spans: Spans
    pieces: Pieces
    scene: Scene
    frame: Frame
    undeflected: Frame
    shown: Wish | None = field(default=None)

    @classmethod
    def of(cls, live: Live) -> "Control":
        """Prepare a run for display."""
        scene, undeflected = Scene(), live.at(0.0)
        scene.show({"box": boxes(live), "outline": outline(live)})
        return cls(live, Spans.of(live), Pieces.of(live), scene, undeflected, undeflected)

    def show(self, wish: Wish) -> dict[str, Any]:
        """Bring the scene to what is wanted and return what the page is to say.

        Raises
        ------
        InputError, ValueError
            If no surface motion exists at that angle; the scene is then as before.
        """
        before, answer = self.shown, dict[str, Any]()
        if before is None or wish.angle != before.angle:
            self.frame = self.live.at(wish.angle)
            answer = self._said()
        if before is None or (wish.plane, wish.cut) != (before.plane, before.cut):
            self.scene.show(self.pieces.standing(wish.plane, wish.cut_plane))
        self.scene.show(self.pieces.moving(self.frame, wish.plane, wish.cut_plane))
        if wish.plane is None:
            self.scene.hide("section", "around")
        self.scene.show({"centres": self.centres()})
        self.shown = wish
        return answer

    def first(self) -> Wish:
        """Return what is shown at first: the run's angle, a section through the middle of a single surface."""
        part = self.live.parts[0]
        axis = 2 if part.surface == "rudder" else 1
        points = self.live.mesh.points[self.live.mesh.on(part.surface)]
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))[axis]
        return Wish(self.live.case.angle, AXES[axis], round(float(middle), 4), sectioned=len(self.live.parts) == 1)

    def reach(self, axis: str) -> tuple[float, float]:
        """Return the positions (m) of the section between which it meets a hexahedron."""
        low, high = bounds(self.live)
        index = AXES.index(axis)
        return round(float(low[index]), 3), round(float(high[index]), 3)

    def centres(self) -> Piece:
        """Return the centres of all directions, those of the surface where it is now."""
        rows = np.vstack([part.centres(self.frame.points) for part in self.live.parts])
        return Piece(rows, (np.arange(len(rows))[:, None],))

    def _said(self) -> dict[str, Any]:
        kind, sentence = verdict(self.frame)
        return {
            "status": sentence,
            "status_style": BOX + NOTES[kind],
            "facts": facts(self.frame, self.live),
            "histogram": histogram(self.frame.quality, self.undeflected.quality),
        }
