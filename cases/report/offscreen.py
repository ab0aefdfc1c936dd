"""Pictures drawn in another process, so that a missing graphics library is a message and not the end."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.scene import View, encoded, legible
from sdm_deflect.meshing.child import started
from sdm_deflect.meshing.errors import MeshingError

Image = NDArray[np.uint8]

SECONDS = 300.0
LOG_PREFIX = re.compile(r"\x1b\[[0-9;]*m|\d{4}-\d\d-\d\d [^|]*\| ")
"""Colours and the place in VTK's source that its last words begin with."""
NEEDS = "rendering needs OpenGL libraries (on Debian: apt-get install libgl1 libegl1 libopengl0)"


class RenderError(RuntimeError):
    """A picture could not be drawn."""


@contextmanager
def rendering(
    views: tuple[View, ...], module: str = "sdm_deflect.cases.report.render"
) -> Iterator[Callable[[], tuple[Image, ...]]]:
    """Begin to draw views; the callable waits for the images (H, W, 3).

    Raises
    ------
    RenderError
        From the callable, if the drawing process fails; says what that most likely needs.
    """
    with started(module, encoded(tuple(map(legible, views)))) as pending:

        def wait() -> tuple[Image, ...]:
            try:
                answer = pending.answer(SECONDS)
            except MeshingError as error:
                raise RenderError(f"{LOG_PREFIX.sub('', str(error))}; {NEEDS}") from None
            return tuple(answer[str(i)].astype(np.uint8) for i in range(len(views)))

        yield wait


def rendered(views: tuple[View, ...], module: str = "sdm_deflect.cases.report.render") -> tuple[Image, ...]:
    """Return the images (H, W, 3) of views.

    Raises
    ------
    RenderError
        If the drawing process fails.
    """
    with rendering(views, module) as images:
        return images()
