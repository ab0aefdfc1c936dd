"""Damage within files of HDF5 and NumPy's archives, so that what opens them is not the only thing that is tried."""

import io
import warnings
import zipfile
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

import h5py
import numpy as np

from sdm_deflect.deform.base.reading import DAMAGED
from tests.fuzz.mutation import REAL, WHOLE, Damage

KINDS = ("i1", "u1", "i2", "i4", "u4", "i8", "u8", "f4", "f8", ">i4", ">f8", "c16", "?", "S5", "V8")
SHAPES = ((), (0,), (1,), (3, 2), (2, 3), (1, 1, 1), (0, 3), (7,), (8, 3), (4, 0))
HUGE = ((10**9,), (10**5, 10**5), (10**12,), (2**40, 3), (2**62,))
NAMES = (
    " data",
    "label",
    "name",
    "type",
    "flags",
    "new",
    "GridCoordinates",
    "Zone",
    "ZoneBC",
    "PointList",
    "PointRange",
)
TEXTS = (
    b"", b"MT", b"I4", b"R4", b"R8", b"C1", b"LK", b"X4", b"U8", b"Zone_t", b"Elements_t", b"BC_t", b"CGNSBase_t",
    b"DataArray_t", b"IndexRange_t", b"NGON_n", b"\xff\xfe", b"Structured", b"Vertex", b"FaceCenter",
    b"FamilySpecified",
)  # fmt: skip

Change = Callable[[Random, Any], None]


def damaged_hdf5(random: Random, data: bytes, damage: Damage) -> bytes:
    """Return the file with other nodes, types, shapes, values or links; then, sometimes, with other bytes too."""
    if random.random() < 0.3:
        return damage.of(data)
    buffer = io.BytesIO(data)
    try:
        with h5py.File(buffer, "r+") as file:
            for _ in range(random.choice((1, 1, 1, 2, 3))):
                _change_node(random, file)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, AttributeError, OverflowError, MemoryError):
        return damage.of(data)
    new = buffer.getvalue()
    return damage.of(new) if random.random() < 0.15 else new


def _change_node(random: Random, file: Any) -> None:
    names: list[str] = []
    file.visit(names.append)
    if not names:
        return
    node = file[random.choice(names)]
    change = random.choice(OF_DATA if isinstance(node, h5py.Dataset) else OF_GROUPS)
    change(random, node)


def _replaced(node: Any, **given: Any) -> None:
    parent, name, attributes = node.parent, node.name.rpartition("/")[2], dict(node.attrs)
    del parent[name]
    new = parent.create_dataset(name, **given)
    for key, value in attributes.items():
        new.attrs[key] = value


def _values(random: Random, node: Any) -> None:
    values = np.atleast_1d(node[()]).copy()
    if not values.size:
        return
    for _ in range(random.choice((1, 1, 4, values.size))):
        at = random.randrange(values.size)
        with np.errstate(all="ignore"):
            if values.dtype.kind == "f":
                values.flat[at] = random.choice(REAL)
            elif values.dtype.kind in "iu":
                near = int(values.flat[at]) + random.choice((-1, 1, 10))
                size = 8 * values.dtype.itemsize
                values.flat[at] = np.array(random.choice((near, *WHOLE)) % 2**size, "u8").astype(values.dtype)
    node[...] = values.reshape(node.shape)


def _kind(random: Random, node: Any) -> None:
    values = np.asarray(node[()])
    kind = random.choice(KINDS)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # complex values lose their imaginary parts
        new = values.astype(kind) if kind[0] not in "SV" else np.zeros(values.shape, kind)
    _replaced(node, data=new)


def _shape(random: Random, node: Any) -> None:
    values = np.asarray(node[()])
    shapes = [(values.size,), (values.size, 1), (1, values.size), values.shape[::-1], *SHAPES]
    shape = random.choice(shapes)
    _replaced(node, data=np.resize(values, shape) if values.size else np.zeros(shape, values.dtype))


def _length(random: Random, node: Any) -> None:
    values = np.asarray(node[()]).ravel()
    _replaced(node, data=np.resize(values, max(0, len(values) + random.choice((-1, 1, -3, 5)))))


def _huge(random: Random, node: Any) -> None:
    kind = node.dtype if random.random() < 0.7 else random.choice(KINDS)
    shape = random.choice(HUGE)
    _replaced(node, shape=shape, dtype=kind, chunks=tuple(min(n, 1000) for n in shape))


def _packed(random: Random, node: Any) -> None:
    values = np.atleast_1d(node[()])
    packing = random.choice(({"compression": "gzip"}, {"shuffle": True}, {"fletcher32": True}, {"compression": "lzf"}))
    big = np.zeros(2_000_000, values.dtype) if random.random() < 0.2 else values
    _replaced(node, data=big, chunks=True, **packing)


def _absent(random: Random, node: Any) -> None:
    _replaced(node, data=h5py.Empty(random.choice(("f8", "i4", "S3"))))


def _odd(random: Random, node: Any) -> None:
    texts = np.array([b"abc", b""], dtype=h5py.string_dtype())
    pairs = np.zeros(3, dtype=[("a", "i4"), ("b", "f8")])
    rows = np.empty(1, dtype=object)
    rows[0] = np.arange(3, dtype="i4")
    kind = random.randrange(4)
    if kind == 3:
        _replaced(node, data=rows, dtype=h5py.vlen_dtype(np.dtype("i4")))
    else:
        _replaced(node, data=(texts, pairs, np.array([node.ref], dtype=h5py.ref_dtype))[kind])


def _outside(random: Random, node: Any) -> None:
    shape, kind = node.shape or (1,), node.dtype
    if random.random() < 0.5:
        _replaced(node, shape=shape, dtype=kind, external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)])
        return
    parent, name = node.parent, node.name.rpartition("/")[2]
    layout = h5py.VirtualLayout(shape=shape, dtype=kind)
    layout[...] = h5py.VirtualSource("other.h5", "data", shape=shape)
    del parent[name]
    parent.create_virtual_dataset(name, layout)


def _attribute(random: Random, node: Any) -> None:
    name = random.choice([*node.attrs, *NAMES[1:5]])
    texts = [np.bytes_(text) for text in TEXTS]
    value = random.choice([*texts, *texts, 5, 1.5, np.zeros(4), np.zeros((0,)), h5py.Empty("S1"), "text"])
    if name in node.attrs and random.random() < 0.2:
        del node.attrs[name]
    else:
        node.attrs[name] = value


def _remove(random: Random, node: Any) -> None:
    del node.parent[node.name.rpartition("/")[2]]


def _rename(random: Random, node: Any) -> None:
    parent, name = node.parent, node.name.rpartition("/")[2]
    parent.move(name, random.choice((*NAMES, "x" * 300, "ü\x1b[31m", ".")))


def _copy(random: Random, node: Any) -> None:
    node.parent.copy(node, f"{node.name.rpartition('/')[2]}{random.randrange(9)}")


def _link(random: Random, node: Any) -> None:
    parent, name = node.parent, node.name.rpartition("/")[2]
    links = (
        h5py.ExternalLink("other.cgns", "/Base"),
        h5py.SoftLink(node.name),
        h5py.SoftLink("/"),
        node.file["/"],
        parent,
    )
    if random.random() < 0.5:
        name += "2"
    else:
        del parent[name]
    parent[name] = random.choice(links)


def _swap_kind(random: Random, node: Any) -> None:
    parent, name, attributes = node.parent, node.name.rpartition("/")[2], dict(node.attrs)
    group = isinstance(node, h5py.Group)
    del parent[name]
    new = parent.create_dataset(name, data=np.zeros(3)) if group else parent.create_group(name)
    for key, value in attributes.items():
        new.attrs[key] = value


OF_BOTH: tuple[Change, ...] = (_attribute, _attribute, _remove, _rename, _copy, _link, _swap_kind)
OF_DATA: tuple[Change, ...] = (
    _values, _values, _values, _values, _kind, _shape, _length, _length, _huge, _packed, _absent, _odd, _outside,
    *OF_BOTH,
)  # fmt: skip
OF_GROUPS = OF_BOTH


def damaged_npz(random: Random, data: bytes, damage: Damage) -> bytes:
    """Return an archive of arrays with other arrays or headers, its checksums right; or with other bytes."""
    if random.random() < 0.3:
        return damage.of(data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except (OSError, ValueError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, KeyError):
        return damage.of(data)
    for _ in range(random.choice((1, 1, 2))):
        if members:
            _change_member(random, members, damage)
    out = io.BytesIO()
    with zipfile.ZipFile(
        out, "w", random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA))
    ) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def _change_member(random: Random, members: dict[str, bytes], damage: Damage) -> None:
    name = random.choice(list(members))
    kind = random.randrange(6)
    if kind == 0:
        members[random.choice(("new.npy", "../up.npy", "points", "centers_x.npy"))] = members.pop(name)
    elif kind == 1:
        members.pop(name)
    elif kind == 2:
        members[name] = damage.of(members[name])
    elif kind == 3:
        head = members[name][:128]
        members[name] = damage.of(head) + members[name][128:]
    else:
        members[name] = npy(_other(random, members[name]))


def _other(random: Random, data: bytes) -> Any:
    """Return an array with other values, of another type or shape."""
    try:
        with warnings.catch_warnings(action="ignore"):
            values = np.load(io.BytesIO(data), allow_pickle=False)
    except DAMAGED:
        return np.zeros(3)
    choices: Sequence[Any] = (
        values.astype("c16") if values.dtype.kind in "fiu" else values,
        np.array([{"a": 1}], dtype=object),
        np.zeros(random.choice(SHAPES), random.choice(KINDS)),
        values.ravel()[: random.randint(0, values.size)],
        values[:0] if values.ndim else values,
        np.array("text"),
        np.zeros(4_000_000),
    )
    if values.size and values.dtype.kind in "fiu" and random.random() < 0.6:
        values = values.copy()
        limits = REAL if values.dtype.kind == "f" else (np.iinfo(values.dtype).min, np.iinfo(values.dtype).max, 0)
        for _ in range(random.choice((1, 3, values.size))):
            values.flat[random.randrange(values.size)] = random.choice(limits)
        return values
    return random.choice(choices)


def npy(values: Any) -> bytes:
    """Return an array as a file of NumPy."""
    out = io.BytesIO()
    np.save(out, values, allow_pickle=True)
    return out.getvalue()
