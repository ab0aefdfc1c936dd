"""CGNS files in ADF, made from files in HDF5 node by node."""

import h5py

KINDS = {"int8": "C1", "uint8": "B1", "int32": "I4", "int64": "I8", "float32": "R4", "float64": "R8"}
DATE = b"Mon Jan  1 00:00:00 2024    "
FREE = b"fCbt" + b"000000001000" * 6 + b"Fcte"


def pointer(place: int) -> bytes:
    """8 digits for a block of 4096 bytes, 4 for a place in it."""
    return b"%08X%04X" % divmod(place, 4096)


def in_adf(path, order: str = "<", pieces: int = 1) -> bytes:
    """The tree of a file in HDF5 with data in an order of bytes, each in as many pieces (if it is long enough)."""
    out = bytearray(186) + FREE
    with h5py.File(path) as file:
        root = _node(out, file, b"ADF MotherNode", b"Root Node of ADF File", order, pieces)
    end = len(out) - 1
    out += b" " * (-len(out) % 4096)
    letters = b"LB" if order == "<" else b"BB"
    sizes = b"010204080408080808080808"
    out[:186] = (
        b"\xc0\xa8\xa3\xa9ADF Database Version A02011>AdF0" + DATE + b"AdF1" + DATE + b"AdF2" + letters + b"AdF3"
        + sizes + b"AdF4" + pointer(root) + pointer(end) + pointer(186) + b"000000001000" + b"AdF5"
    )  # fmt: skip
    return bytes(out)


def _node(out: bytearray, group, name: bytes, label: bytes, order: str, pieces: int) -> int:
    place = len(out)
    out += bytes(246)
    found = [(key, node) for key, node in group.items() if isinstance(node, h5py.Group) and "label" in node.attrs]
    table = len(out)
    out += bytes(4 + 12 + 44 * len(found) + 4) if found else b""
    kind, dimensions, values, count, data = b"MT", 0, (), 0, 0
    if " data" in group and "label" in group.attrs and group.name != "/":
        stored = group[" data"][()]
        kind, dimensions, values = KINDS[stored.dtype.name].encode(), stored.ndim, stored.shape[::-1]
        count, data = _data(out, stored.astype(stored.dtype.newbyteorder(order)).tobytes(), pieces)
    entries = b""
    for key, node in found:
        own = _node(out, node, key.encode(), node.attrs["label"], order, pieces)
        entries += key.encode().ljust(32) + pointer(own)
    if found:
        body = b"SNTb" + pointer(table + 16 + len(entries)) + entries + b"snTE"
        out[table : table + len(body)] = body
    sizes = b"".join(b"%08X" % value for value in values).ljust(96, b"0")
    out[place : place + 246] = (
        b"NoDe" + name.ljust(32) + label.ljust(32) + b"%08X%08X" % (len(found), len(found))
        + (pointer(table) if found else b"000000001000") + kind.ljust(32) + b"%02X" % dimensions + sizes
        + b"%04X" % count + (pointer(data) if count else b"000000001000") + b"TaiL"
    )  # fmt: skip
    return place


def _data(out: bytearray, data: bytes, pieces: int) -> tuple[int, int]:
    """Write data, and return the number of pieces and where they or their table begin."""
    size = -(-len(data) // (8 * pieces)) * 8 if len(data) > 64 else len(data)
    parts = [data[at : at + size] for at in range(0, len(data), size)] or [b""]
    places = []
    for part in parts:
        places.append((len(out), len(out) + 16 + len(part)))
        out += b"DaTa" + pointer(places[-1][1]) + part + b"dEnD"
    if len(parts) == 1:
        return 1, places[0][0]
    table, entries = len(out), b"".join(pointer(begin) + pointer(end) for begin, end in places)
    out += b"DCtb" + pointer(table + 16 + len(entries)) + entries + b"dcTE"
    return len(parts), table
