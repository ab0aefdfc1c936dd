"""The general fuse: overlapping parts become disjoint cells that share their faces."""

from collections.abc import Sequence
from dataclasses import dataclass

from cadquery import Shape, Solid
from OCP.BOPAlgo import BOPAlgo_Builder
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.parts import Part


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A piece of the fused volume; `owner` is the position of the first part that contains it."""

    solid: Solid
    owner: int
    patch: str


def general_fuse(parts: Sequence[Part]) -> list[Cell]:
    """Cut all parts at each other's faces, without merging anything.

    Raises
    ------
    CadError
        Where the kernel reports a failure or loses a part.
    """
    builder = BOPAlgo_Builder()
    builder.SetRunParallel(False)
    builder.SetUseOBB(True)  # the same pieces, found in two thirds of the time
    for part in parts:
        builder.AddArgument(part.solid.wrapped)
    builder.Perform()
    if builder.HasErrors():
        raise CadError("the CAD kernel could not fuse the parts; move parts whose edges nearly touch")
    pieces = TopTools_IndexedMapOfShape()
    owners: list[int] = []
    for i, part in enumerate(parts):
        for piece in _images(builder, part.solid.wrapped):
            if pieces.FindIndex(piece) == 0:
                pieces.Add(piece)
                owners.append(i)
    found = [Shape.cast(pieces.FindKey(i + 1)) for i in range(len(owners))]
    return [Cell(solid, owner, parts[owner].patch) for solid, owner in zip(found, owners, strict=True)]


def _images(builder: BOPAlgo_Builder, original: TopoDS_Shape) -> list[TopoDS_Shape]:
    images = builder.Images()
    return list(images.Find(original)) if images.IsBound(original) else [original]
