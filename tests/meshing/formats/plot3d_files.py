"""PLOT3D grids in every variant, and blocks of grids that fit together."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.meshing.formats.plot3d import Plot3dFile

# (I, J, K, 3) points of a block.
Block = NDArray[np.float64]
# Byte order and type of coordinates, whether there are Fortran records and IBLANK.
BINARY = tuple(
    f"{order}{real}{records}{blanked}"
    for order in "<>"
    for real in ("f4", "f8")
    for records in ("", "r")
    for blanked in ("", "b")
)
VARIANTS = (*BINARY, "text", "textb")


def written(
    path: Path, blocks: list[Block], variant: str = "<f8", counted: bool = True, style: str = "%r", axes: int = 3
) -> Path:
    """Write a grid, of two coordinates if `axes` is 2; `style` is that of the coordinates of a text."""
    heads = [np.array([len(blocks)])] * counted + [np.array([n for block in blocks for n in block.shape[:axes]])]
    bodies = [[block[..., axis].ravel(order="F") for axis in range(axes)] for block in blocks]
    for block, body in zip(blocks, bodies, strict=True):
        if variant.endswith("b"):
            body.append(np.arange(block[..., 0].size) % 3 - 1)
    if variant.startswith("text"):
        words = [" ".join(map(str, head.tolist())) for head in heads]
        for body in bodies:
            for values in body:
                form = style if values.dtype.kind == "f" else "%d"
                rows = [values[i : i + 4].tolist() for i in range(0, len(values), 4)]
                words += [" ".join(form % value for value in row) for row in rows]
        path.write_text("\n".join(words) + "\n")
        return path
    order, real = variant[0], np.dtype(variant[:3])
    whole = np.dtype(f"{order}i4")
    records = [head.astype(whole).tobytes() for head in heads]
    for body in bodies:
        records.append(b"".join(v.astype(real if v.dtype.kind == "f" else whole).tobytes() for v in body))
    marks = [np.array(len(one), whole).tobytes() if "r" in variant[3:] else b"" for one in records]
    path.write_bytes(b"".join(mark + one + mark for mark, one in zip(marks, records, strict=True)))
    return path


def box(size: tuple[int, int, int] = (5, 4, 3), wobble: float = 0.02) -> Block:
    """A block from 0 to 1 whose points are off the lattice, right-handed."""
    axes = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in size), indexing="ij")
    points = np.stack(axes, axis=-1)
    return points + wobble * np.sin(7.0 * points[..., [1, 2, 0]])


def cut(block: Block, axis: int, at: int) -> list[Block]:
    """Cut a block in two, that have the points numbered `at` along an axis in common."""
    return [block.take(range(at + 1), axis), block.take(range(at, block.shape[axis]), axis)]


def ring(size: tuple[int, int, int] = (17, 4, 3)) -> Block:
    """A block around the z axis whose first and last points along i are at the same places."""
    along = (np.linspace(0.0, 2.0 * np.pi, size[0]), np.linspace(1.0, 2.0, size[1]), np.linspace(0.0, 1.0, size[2]))
    angle, radius, height = np.meshgrid(*along, indexing="ij")
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    points[-1] = points[0]
    return points


def with_body(n: int = 6) -> list[Block]:
    """The 26 blocks of one cell each way around a cube, as large as those of a lattice of n cells, from -1 to 1."""
    ends = (0, n // 3, n - n // 3, n)
    whole = 2.0 * box((n + 1, n + 1, n + 1), 0.0) - 1.0
    parts = [(i, j, k) for k in range(3) for j in range(3) for i in range(3) if (i, j, k) != (1, 1, 1)]
    return [whole[tuple(slice(ends[a], ends[a + 1] + 1) for a in part)] for part in parts]


SIDES = {f"block1/{axis}{end}" for axis in "ijk" for end in ("min", "max")}
# Numbers of a block's faces in a neutral map file.
FACES = {"kmin": 1, "kmax": 2, "imin": 3, "imax": 4, "jmin": 5, "jmax": 6}
# The faces of the blocks of `with_body` that are on the cube.
BODY = (
    ("block5", "kmax"), ("block11", "jmax"), ("block13", "imax"), ("block14", "imin"), ("block16", "jmin"),
    ("block22", "kmin"),
)  # fmt: skip


def head(blocks: list[Block]) -> str:
    """The sizes of blocks, as a neutral map file begins."""
    rows = [f"{i} {' '.join(map(str, block.shape[:3]))}" for i, block in enumerate(blocks, 1)]
    return "# Block# IDIM JDIM KDIM\n\n" + "\n".join([str(len(blocks)), "", *rows, "# Type B1 F1 S1 E1 S2 E2 Swap", ""])


def whole_face(block: Block, number: int, face: str) -> str:
    """The numbers of a block, one of its faces, and the range of all of it."""
    axis = "ijk".index(face[0])
    first, second = block.shape[(axis + 1) % 3], block.shape[(axis + 2) % 3]
    return f"{number} {FACES[face]} 1 {first} 1 {second}"


def stored(path: Path) -> NDArray[np.float64]:
    """Coordinates of all points of a file, block after block."""
    with path.open("rb") as file:
        return Plot3dFile.open(file, lambda _: None).points()
