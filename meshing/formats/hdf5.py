"""Files in HDF5: errors of their damage, and whether they store what they claim."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py

from sdm_deflect.deform.reading import check_unpacked
from sdm_deflect.meshing.formats.format import FULL, MeshFileError

DAMAGE = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError, zlib.error)
"""What h5py raises for a damaged file."""
FILTERS = (h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32)
"""What may be done to data as they are stored; each only once, and in this order."""


@contextmanager
def damage() -> Iterator[None]:
    """Say in one sentence what h5py finds wrong: MeshFileError; errors of a full disk pass."""
    try:
        yield
    except MeshFileError:
        raise
    except DAMAGE as error:
        if isinstance(error, OSError) and error.errno in FULL:
            raise
        reason = " ".join(str(error).split())
        raise MeshFileError(f"the file is truncated or damaged ({reason})") from error


def check_stored(stored: Any, name: str) -> None:
    """Refuse (MeshFileError) a dataset that would take too much memory, or that the file holds only in part."""
    length = stored.file.id.get_filesize()
    largest = max(stored.size * max(stored.dtype.itemsize, 8), prod(stored.chunks or ()) * stored.dtype.itemsize)
    check_unpacked(largest, length, f"the data of {name}")
    if stored.chunks:
        _check_chunks(stored, name, length)
    elif stored.id.get_storage_size() != stored.nbytes:
        raise MeshFileError(f"{name} holds no data, or not all; the file is damaged")


def is_real(stored: Any) -> bool:
    """Whether a dataset holds real numbers of a kind that NumPy has."""
    return stored.dtype.kind == "f" and bool(h5py.h5t.py_create(stored.dtype) == stored.id.get_type())


def filters(stored: Any) -> list[int]:
    """Return what is done to the data of a dataset as they are stored."""
    properties = stored.id.get_create_plist()
    return [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]


def _check_chunks(stored: Any, name: str, length: int) -> None:
    """Refuse (MeshFileError) missing chunks, and such as are packed otherwise than known, or unpack to more."""
    chunks: list[Any] = []
    used = filters(stored)
    if used != [known for known in FILTERS if known in used]:
        suffix = Path(stored.file.filename).suffix
        raise MeshFileError(
            f"{name} is packed in a way that is not known; run `h5repack -f NONE IN{suffix} OUT{suffix}`"
        )
    stored.id.chunk_iter(chunks.append)
    expected = prod(-(-size // chunk) for size, chunk in zip(stored.shape, stored.chunks, strict=True))
    if len(chunks) < expected or any(chunk.size > length for chunk in chunks):
        raise MeshFileError(f"{name} holds {len(chunks)} of {expected} parts of its data; the file is damaged")
    if h5py.h5z.FILTER_DEFLATE not in used:
        return
    skipped, room = 1 << used.index(h5py.h5z.FILTER_DEFLATE), prod(stored.chunks) * stored.dtype.itemsize
    for chunk in chunks:
        if not chunk.filter_mask & skipped:
            _, packed = stored.id.read_direct_chunk(chunk.chunk_offset)
            if len(zlib.decompressobj().decompress(packed, room + 1)) > room:  # HDF5 unpacks without a limit
                raise MeshFileError(f"a part of {name} unpacks to more than its {room} bytes; the file is damaged")
