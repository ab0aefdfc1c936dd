"""The process that builds the deflected CAD, started by `sdm_deflect.cases.reference`."""

import pickle
from collections.abc import Iterable

import numpy as np

from sdm_deflect.cases.reference import Deflections, Faces, ReferenceFace, encoded
from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.model import CadFace
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.child import Arrays, serve


def reduced(fighter: Fighter, variants: Iterable[Deflections]) -> list[dict[str, Faces]]:
    """Build the aircraft once for each variant and keep the faces of the surfaces that turn."""
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
