"""The CAD that the validation measures against, as arrays; a child process builds it once, and the cache keeps it.

Building takes seconds, mostly for loading the CAD kernel and fusing the aircraft. It depends on the case alone, so it
goes on while this process reads and deforms the mesh. A later run of the same case reads the arrays.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sdm_deflect import geometry
from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.compiled import default_folder
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.quantity import CadError
from sdm_deflect.meshing.cache import ArrayCache, cache_key
from sdm_deflect.meshing.child import Arrays, MeshingError, serve, start

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadFace

    from .case import Case

# Longest time of the CAD kernel, in seconds.
SECONDS = 600.0
# Deflection (m) of the triangles of curved faces, and of planar ones at curved edges: the kernel's least.
CURVED, EDGE = 1e-5, 1e-7


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
    """The faces of surfaces by name.

    Attributes
    ----------
    undeflected : faces of the moving surfaces before they move, which are turned to make rigid CAD.
    deflected : faces of the moving surfaces in the deflected CAD: blended like the mesh, tails on the fuselage.
    still : faces of the components beside hinged surfaces, which do not move.
    """

    undeflected: dict[str, Faces]
    deflected: dict[str, Faces]
    still: dict[str, Faces]


@contextmanager
def reference(case: Case, cache: bool = True) -> Iterator[Callable[[], Reference]]:
    """Read the CAD of a case from the cache, or begin to build it; the callable waits for it.

    Raises CadError from the callable, if the CAD kernel fails.
    """
    store, key = ArrayCache(default_folder()), f"cad-{cache_key(parameters(case))}"
    kept = None
    with suppress(MeshFileError):  # a damaged entry is built again
        kept = store.read(key) if cache else None
    if kept is not None:
        faces = decode(kept)
        yield lambda: faces
        return
    with start("sdm_deflect.cases.aircraft.reference", question(case)) as pending:

        def wait() -> Reference:
            try:
                arrays = pending.answer(SECONDS)
            except MeshingError as error:
                raise CadError(f"the deflected CAD: {error}") from None
            if cache:
                with suppress(MeshFileError):  # built again by the next run
                    store.write(key, arrays)
            return decode(arrays)

        yield wait


def parameters(case: Case) -> dict[str, object]:
    """Return everything that the CAD of a case depends on, the sources of the geometry included."""
    sources = "".join(path.read_text(encoding="utf-8") for path in sorted(Path(geometry.__path__[0]).glob("*.py")))
    return {"fighter": case.fighter, "notch": case.notch, "turned": surface_turns(case), "sources": sources}


def surface_turns(case: Case) -> dict[str, CadTurn]:
    """Return the turns of the CAD's surfaces: those of the mesh, but tails always turn rigidly."""
    return {
        deflection.surface: CadTurn(deflection.factor * case.angle, "blended", case.blending.strip)
        if case.law(deflection.surface) == "blended"
        else CadTurn(deflection.factor * case.angle)
        for deflection in case.deflections
    }


def question(case: Case) -> Arrays:
    """Return the arrays sent to the process that builds the CAD."""
    packed = pickle.dumps((case.fighter, surface_turns(case), case.notch))
    return {"packed": np.frombuffer(packed, dtype=np.uint8)}


def answer(question: Arrays) -> Arrays:
    """Build the aircraft undeflected and deflected; return the faces' arrays as ``which/surface/number/field``."""
    from sdm_deflect.geometry.aircraft import build  # the CAD kernel: in the process that builds alone

    fighter, turned, notch = pickle.loads(question["packed"].tobytes())
    before, after = build(fighter, notch=notch), build(fighter, turned, notch=notch)
    parts = (("undeflected", before, turned), ("deflected", after, turned), ("still", before, carriers(turned)))
    return {
        f"{which}/{name}/{row}/{field}": array
        for which, model, names in parts
        for name in names
        for row, face in enumerate(model.faces_of(name))
        for field, array in arrays_of(face).items()
    }


def decode(answer: Arrays) -> Reference:
    """Return the reference from the arrays of an answer."""
    faces_by_surface: dict[str, dict[str, list[dict[str, Any]]]] = {field.name: {} for field in fields(Reference)}
    for path, array in answer.items():
        if path.count("/") == 3:
            which, name, row, field = path.split("/")
            faces = faces_by_surface[which].setdefault(name, [])
            if int(row) == len(faces):
                faces.append({})
            faces[-1][field] = array
    return Reference(
        **{
            which: {name: tuple(ReferenceFace(**face) for face in faces) for name, faces in surfaces.items()}
            for which, surfaces in faces_by_surface.items()
        }
    )


def carriers(surfaces: Iterable[str]) -> list[str]:
    """Return the patches to which the hinged surfaces among some surfaces are attached."""
    return [
        "fin" if surface == "rudder" else surface.replace("aileron", "wing") for surface in surfaces if hinged(surface)
    ]


def arrays_of(face: CadFace) -> dict[str, FloatArray | IntArray]:
    """Return the fields of a `ReferenceFace`."""
    points, triangles = face.tessellation(EDGE if face.planar else CURVED)
    normal = face.normal_at(points[:1])[0] if face.planar else np.full(3, np.nan)
    return {"points": points, "triangles": triangles, "normal": normal}


if __name__ == "__main__":
    serve(answer)
