"""CGNS files in ADF, made from files in HDF5 node by node."""

from dataclasses import dataclass

import h5py

KINDS = {"int8": "C1", "uint8": "B1", "int32": "I4", "int64": "I8", "float32": "R4", "float64": "R8"}
DATE = b"Mon Jan  1 00:00:00 2024    "


@dataclass(frozen=True)
class Layout:
    """Order of bytes, number of pieces of data (if they are long enough), and whether pointers are in binary."""

    order: str
    pieces: int
    binary: bool

    def pointer(self, place: int) -> bytes:
        """The block of 4096 bytes, 8 digits or bytes, and the place in it, 4 digits or bytes."""
        block, offset = divmod(place, 4096)
        return self.size(block) + (offset.to_bytes(4, self.endian) if self.binary else b"%04X" % offset)

    def size(self, number: int) -> bytes:
        """8 digits, or 8 bytes."""
        return number.to_bytes(8, self.endian) if self.binary else b"%08X" % number

    @property
    def endian(self) -> str:
        return "little" if self.order == "<" else "big"


def in_adf(path, order: str = "<", pieces: int = 1, binary: bool = False) -> bytes:
    """The tree of a file in HDF5, laid out as `Layout` says."""
    how = Layout(order, pieces, binary)
    out = bytearray(186) + b"fCbt" + how.pointer(4096) * 6 + b"Fcte"
    with h5py.File(path) as file:
        root = _node(out, file, b"ADF MotherNode", b"Root Node of ADF File", how)
    end = len(out) - 1
    out += b" " * (-len(out) % 4096)
    letters = b"LB" if order == "<" else b"BB"
    sizes = b"010204080408080808080808"
    version = b"B02012" if binary else b"A02011"
    out[:186] = (
        b"\xc0\xa8\xa3\xa9ADF Database Version " + version + b">AdF0" + DATE + b"AdF1" + DATE + b"AdF2" + letters
        + b"AdF3" + sizes + b"AdF4" + how.pointer(root) + how.pointer(end) + how.pointer(186) + how.pointer(4096)
        + b"AdF5"
    )  # fmt: skip
    return bytes(out)


def _node(out: bytearray, group, name: bytes, label: bytes, how: Layout) -> int:
    place = len(out)
    out += bytes(246)
    found = [(key, node) for key, node in group.items() if isinstance(node, h5py.Group) and "label" in node.attrs]
    table = len(out)
    out += bytes(4 + 12 + 44 * len(found) + 4) if found else b""
    kind, dimensions, values, count, data = b"MT", 0, (), 0, 0
    if " data" in group and "label" in group.attrs and group.name != "/":
        stored = group[" data"][()]
        kind, dimensions, values = KINDS[stored.dtype.name].encode(), stored.ndim, stored.shape[::-1]
        count, data = _data(out, stored.astype(stored.dtype.newbyteorder(how.order)).tobytes(), how)
    entries = b""
    for key, node in found:
        own = _node(out, node, key.encode(), node.attrs["label"], how)
        entries += key.encode().ljust(32) + how.pointer(own)
    if found:
        body = b"SNTb" + how.pointer(table + 16 + len(entries)) + entries + b"snTE"
        out[table : table + len(body)] = body
    sizes = b"".join(map(how.size, values)).ljust(96, b"\0" if how.binary else b"0")
    out[place : place + 246] = (
        b"NoDe" + name.ljust(32) + label.ljust(32) + b"%08X%08X" % (len(found), len(found))
        + (how.pointer(table) if found else how.pointer(4096)) + kind.ljust(32) + b"%02X" % dimensions + sizes
        + b"%04X" % count + (how.pointer(data) if count else how.pointer(4096)) + b"TaiL"
    )  # fmt: skip
    return place


def _data(out: bytearray, data: bytes, how: Layout) -> tuple[int, int]:
    """Write data, and return the number of pieces and where they or their table begin."""
    size = -(-len(data) // (8 * how.pieces)) * 8 if len(data) > 64 else len(data)
    parts = [data[at : at + size] for at in range(0, len(data), size)] or [b""]
    places = []
    for part in parts:
        places.append((len(out), len(out) + 16 + len(part)))
        out += b"DaTa" + how.pointer(places[-1][1]) + part + b"dEnD"
    if len(parts) == 1:
        return 1, places[0][0]
    table, entries = len(out), b"".join(how.pointer(begin) + how.pointer(end) for begin, end in places)
    out += b"DCtb" + how.pointer(table + 16 + len(entries)) + entries + b"dcTE"
    return len(parts), table
