"""Every picture of a run, with what it shows in words."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from sdm_deflect.cases.report import cad_map, figures, slices
from sdm_deflect.cases.report.before_after import before_after
from sdm_deflect.cases.report.compose import Picture, assembled
from sdm_deflect.cases.report.offscreen import Image, RenderError, rendering
from sdm_deflect.cases.report.png import write_sharp_png
from sdm_deflect.cases.report.story import Outcome, Story

Drawn = tuple[str, str, Figure, str]
"""Part of the page, name, figure, and what it shows in words."""


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A picture in a file: the part of the page it belongs to, and what it shows in words."""

    part: str
    path: Path
    alternative: str


@dataclass(frozen=True, slots=True)
class Gallery:
    """All pictures, and why some could not be drawn (empty if all were)."""

    exhibits: tuple[Exhibit, ...]
    missing: str

    def of(self, part: str) -> list[Exhibit]:
        """Return the pictures of one part of the page."""
        return [one for one in self.exhibits if one.part == part]


def drawn(outcome: Outcome, folder: Path) -> Gallery:
    """Draw every picture that needs no validation into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [before_after(outcome, turn) for turn in outcome.turns]
    missing = ""
    with rendering(tuple(view for picture in pictures for view in picture.views)) as images:
        exhibits = [_saved(folder, *plot) for plot in plots(outcome)]
        try:
            exhibits += [_saved(folder, *one) for one in renderings(outcome, pictures, images())]
        except RenderError as error:
            missing = str(error)
    return Gallery(tuple(exhibits), missing)


def compared(story: Story, folder: Path) -> list[Exhibit]:
    """Draw the distances from the CAD that the validation found into `folder`."""
    maps = ((f"cad_map_{turn.surface}", *cad_map.cad_map(story, turn)) for turn in story.turns)
    return [_saved(folder, "cad_map", *one) for one in maps]


def plots(outcome: Outcome) -> Iterator[Drawn]:
    """Yield each plot that needs no graphics library."""
    yield "convergence", "convergence", *figures.convergence(outcome)
    yield "quality", "quality", *figures.quality(outcome)
    for turn in outcome.turns:
        yield "slices", f"slices_{turn.surface}", *slices.slices(outcome, turn)


def renderings(outcome: Outcome, pictures: Sequence[Picture], images: Sequence[Image]) -> Iterator[Drawn]:
    """Yield the pictures of each control surface, put together from the images of their views."""
    rest = iter(images)
    for turn, picture in zip(outcome.turns, pictures, strict=True):
        figure = assembled(picture, [next(rest) for _ in picture.views])
        yield "before_after", f"before_after_{turn.surface}", figure, picture.alternative


def _saved(folder: Path, part: str, name: str, figure: Figure, alternative: str) -> Exhibit:
    path = folder / f"{file_name(name)}.png"
    write_sharp_png(figure, path)
    return Exhibit(part, path, alternative)


def file_name(name: str) -> str:
    """Return a name without characters that mean something in a path."""
    return re.sub(r"[^\w.+-]", "_", name)
