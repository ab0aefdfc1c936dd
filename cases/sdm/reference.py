"""The deflected CAD that the validation measures against, reduced to arrays; a process of its own builds it.

Building takes seconds, most of them for loading the CAD kernel and fusing the aircraft, and depends on the case alone:
it goes on while this process reads the mesh and deforms it.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sdm_deflect.geometry.datum import hinged
from sdm_deflect.geometry.deflected import Deflection
from sdm_deflect.geometry.errors import CadError
from sdm_deflect.meshing.child import Arrays, serve, started
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from sdm_deflect.cases.sdm.case import Case
    from sdm_deflect.geometry.model import CadFace
    from sdm_deflect.geometry.parameters import Fighter

Mode = Literal["rigid", "blended"]
Deflections = Mapping[str, Deflection]

SECONDS = 600.0
"""Time that the CAD kernel may take."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceFace:
    """A trimmed CAD face: points (P, 3) and outward triangles (T, 3), exact on a plane.

    Attributes
    ----------
    normal : outward unit normal (3,) of a plane, nan on any other surface.
    """

    points: FloatArray
    triangles: IntArray
    normal: FloatArray


Faces = tuple[ReferenceFace, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The faces of the deflected surfaces, by surface: turned rigidly, and blended (the same for a tail)."""

    rigid: dict[str, Faces]
    blended: dict[str, Faces]


@contextmanager
def reference(case: Case) -> Iterator[Callable[[], Reference]]:
    """Begin to build the deflected CAD of a case; the callable waits for it.

    Raises
    ------
    CadError
        From the callable, if the CAD kernel fails.
    """
    question = np.frombuffer(pickle.dumps((case.fighter, variants(case))), dtype=np.uint8)
    with started("sdm_deflect.cases.sdm.reference", {"question": question}) as pending:

        def wait() -> Reference:
            try:
                return decoded(pending.answer(SECONDS))
            except MeshingError as error:
                raise CadError(f"the deflected CAD: {error}") from None

        yield wait


def variants(case: Case) -> tuple[Deflections, ...]:
    """Return how the surfaces turn in the rigid CAD and, if that is another, in the blended one."""
    rigid, blended = turned(case, "rigid"), turned(case, "blended")
    return (rigid,) if rigid == blended else (rigid, blended)


def turned(case: Case, mode: Mode) -> dict[str, Deflection]:
    """Return by how much the CAD's surfaces turn, and how; tails can only turn rigidly."""
    return {
        one.surface: Deflection(one.factor * case.angle, mode if hinged(one.surface) else "rigid")
        for one in case.deflections
    }


def encoded(built: list[dict[str, Faces]]) -> Arrays:
    """Return the faces of each variant as arrays by name."""
    return {
        f"{variant}/{surface}/{i}/{part}": getattr(face, part)
        for variant, found in enumerate(built)
        for surface, faces in found.items()
        for i, face in enumerate(faces)
        for part in ReferenceFace.__slots__
    }


def decoded(arrays: Arrays) -> Reference:
    """Return the reference that these arrays encode."""
    parts: dict[str, dict[str, dict[str, dict[str, np.ndarray]]]] = {}
    for name, array in arrays.items():
        variant, *path = name.split("/")
        if path:
            surface, i, part = path
            parts.setdefault(variant, {}).setdefault(surface, {}).setdefault(i, {})[part] = array
    built = [
        {surface: tuple(ReferenceFace(**face) for face in faces.values()) for surface, faces in found.items()}
        for found in parts.values()
    ]
    return Reference(built[0], built[-1])


def reduced(fighter: Fighter, variants: Iterable[Deflections]) -> list[dict[str, Faces]]:
    """Build the aircraft once for each variant and keep the faces of the surfaces that turn."""
    from sdm_deflect.geometry.aircraft import build  # the CAD kernel: in the process that builds alone

    models = ((build(fighter, turned), turned) for turned in variants)
    return [{name: tuple(map(arrays_of, model.faces_of(name))) for name in turned} for model, turned in models]


def arrays_of(face: CadFace) -> ReferenceFace:
    """Return a face as arrays."""
    points, triangles = face.tessellation()
    normal = face.normal_at(points[:1])[0] if face.planar else np.full(3, np.nan)
    return ReferenceFace(points, triangles, normal)


def answer(question: Arrays) -> Arrays:
    """Return the faces that a question asks for."""
    return encoded(reduced(*pickle.loads(question["question"].tobytes())))  # this program's own


if __name__ == "__main__":
    serve(answer)
