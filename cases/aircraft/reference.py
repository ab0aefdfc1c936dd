"""The deflected CAD that the validation measures against, reduced to arrays; a process of its own builds it.

Building takes seconds, most of them for loading the CAD kernel and fusing the aircraft, and depends on the case alone:
it goes on while this process reads the mesh and deforms it.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.geometry.datum import SURFACES, hinged
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.errors import CadError
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.files.child import Arrays, serve, started

if TYPE_CHECKING:
    from sdm_deflect.cases.aircraft.case import Case
    from sdm_deflect.geometry.model import CadFace

SECONDS = 600.0
"""Time that the CAD kernel may take."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceFace:
    """A trimmed CAD face: points (P, 3) and outward triangles (T, 3), exact on a plane.

    `normal` is the outward unit normal (3,) of a plane, nan on any other surface.
    """

    points: FloatArray
    triangles: IntArray
    normal: FloatArray


Faces = tuple[ReferenceFace, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The faces of the deflected surfaces, by surface: turned rigidly, and blended (the same for a tail).

    Those of the components beside hinged ones are in `still`, by patch: they have not moved.
    """

    rigid: dict[str, Faces]
    blended: dict[str, Faces]
    still: dict[str, Faces]


@contextmanager
def reference(case: Case) -> Iterator[Callable[[], Reference]]:
    """Begin to build the deflected CAD of a case; the callable waits for it.

    Raises CadError from the callable, if the CAD kernel fails.
    """
    with started("sdm_deflect.cases.aircraft.reference", question(case)) as pending:

        def wait() -> Reference:
            try:
                return decoded(pending.answer(SECONDS))
            except MeshingError as error:
                raise CadError(f"the deflected CAD: {error}") from None

        yield wait


def variants(case: Case) -> tuple[dict[str, CadTurn], ...]:
    """Return how the surfaces turn in the rigid CAD and, if that is another, in the blended one."""
    rigid, blended = turned(case, "rigid"), turned(case, "blended")
    return (rigid,) if rigid == blended else (rigid, blended)


def turned(case: Case, mode: Literal["rigid", "blended"]) -> dict[str, CadTurn]:
    """Return by how much the CAD's surfaces turn, and how; tails can only turn rigidly."""
    return {
        one.surface: CadTurn(one.factor * case.angle, mode if hinged(one.surface) else "rigid")
        for one in case.deflections
    }


def question(case: Case) -> Arrays:
    """Return what the process that builds is asked."""
    return packed((case.fighter, variants(case)))


def answer(question: Arrays) -> Arrays:
    """Build the aircraft once for each variant and return the faces of the surfaces that turn."""
    from sdm_deflect.geometry.aircraft import build  # the CAD kernel: in the process that builds alone

    fighter, variants = unpacked(question)
    built = []
    for turned in variants:
        model = build(fighter, turned)
        names = (*turned, *carriers(turned))
        built.append({name: [arrays_of(face) for face in model.faces_of(name)] for name in names})
    return packed(built)


def decoded(answer: Arrays) -> Reference:
    """Return the reference that an answer holds."""
    built = [
        {surface: tuple(ReferenceFace(*parts) for parts in faces) for surface, faces in found.items()}
        for found in unpacked(answer)
    ]
    beside = {name: faces for name, faces in built[-1].items() if name not in SURFACES}
    rigid, blended = ({name: faces for name, faces in one.items() if name in SURFACES} for one in (built[0], built[-1]))
    return Reference(rigid, blended, beside)


def carriers(surfaces: Iterable[str]) -> list[str]:
    """Return the patches that carry the hinged ones of some surfaces."""
    return ["fin" if one == "rudder" else one.replace("aileron", "wing") for one in surfaces if hinged(one)]


def arrays_of(face: CadFace) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the fields of a `ReferenceFace`."""
    points, triangles = face.tessellation()
    return points, triangles, face.normal_at(points[:1])[0] if face.planar else np.full(3, np.nan)


def packed(value: object) -> Arrays:
    """Return a value as the array of its bytes; only this program's own are unpacked."""
    return {"packed": np.frombuffer(pickle.dumps(value), dtype=np.uint8)}


def unpacked(arrays: Arrays) -> Any:
    """Return the value that was packed."""
    return pickle.loads(arrays["packed"].tobytes())


if __name__ == "__main__":
    serve(answer)
