"""Inputs that once did harm: each is tried as it is, and damaged further."""

import gzip
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import h5py
import numpy as np

from tests.fuzz.inputs import Input

# Sound inputs by their main file; the first of each name.
Sound = Mapping[str, Input]


def of(target: str, sound: Sequence[Input]) -> list[Input]:
    """Return what once did harm to a target, made of sound inputs."""
    by_name: dict[str, Input] = {}
    for one in sound:
        by_name.setdefault(one.main, one)
    return list(MAKERS[target](by_name)) if target in MAKERS else []


def _with(one: Input, name: str, old: bytes, new: bytes) -> Input:
    """Return an input with the first match of a pattern replaced in a file."""
    data, count = re.subn(old, lambda _: new, one.files[name], count=1, flags=re.DOTALL)
    assert count, (name, old)
    return one.with_file(name, data)


def su2(sound: Sound) -> Iterator[Input]:
    """No content, huge counts, coordinates that are not finite, faces on no patch."""
    tet = sound["tet.su2"]
    for text in (b"", b"\n", b"NDIME= 3\n", b"% only a comment\n"):
        yield tet.with_file("tet.su2", text)
    for key in (b"NPOIN", b"NELEM", b"NMARK", b"MARKER_ELEMS"):
        for number in (b"99999999999", b"-1", b"nan", b"", b"1e3", b"9" * 5000):
            yield _with(tet, "tet.su2", key + rb"= *\d+", key + b"= " + number)
    for number in (b"inf", b"nan", b"1e300", b"1e999"):
        yield _with(tet, "tet.su2", rb"\n0\.0 ", b"\n" + number + b" ")
    lines = tet.files["tet.su2"].split(b"\n")
    short = [line for i, line in enumerate(lines) if i != len(lines) - 2]
    yield tet.with_file("tet.su2", b"\n".join(short).replace(b"MARKER_ELEMS= 6", b"MARKER_ELEMS= 5"))
    yield _with(tet, "tet.su2", rb"MARKER_TAG= wall", b"MARKER_TAG= \x1b[31mwall\x07")


def gmsh(sound: Sound) -> Iterator[Input]:
    """Announced numbers that are huge or negative."""
    for version in ("410", "411", "220", "221"):
        name = f"gmsh{version}.msh"
        for section in (b"Nodes", b"Elements"):
            for number in (b"1 999999999999 1 999999999999", b"-5", b"999999999999", b"nan 1 1 1"):
                yield _with(
                    sound[name], name, rb"\$" + section + rb"\n[^\n]*\n", b"$" + section + b"\n" + number + b"\n"
                )
    for name in ("square-2.2-0.msh", "square-2.2-1.msh", "square-4.1-0.msh"):
        for number in (b"-5", b"999999999999", b"nan", b"", b"1\n2 2 1\n99999999999"):
            yield _with(sound[name], name, rb"\$Periodic\n[^\n]*\n", b"$Periodic\n" + number + b"\n")
    for numbers in (b"-5 0 0 0", b"0 -5 0 0", b"999999999999 0 0 0", b"1e300 0 0 0"):
        yield _with(sound["gmsh410.msh"], "gmsh410.msh", rb"\$Entities\n[^\n]*\n", b"$Entities\n" + numbers + b"\n")


def ugrid(sound: Sound) -> Iterator[Input]:
    """Counts that are huge or negative, a NaN that signals, names of surfaces without end or twice."""
    for name, order in (("mix.b8.ugrid", "big"), ("mix.lr4.ugrid", "little")):
        data, first = sound[name].files[name], 4 * ("r" in name)
        for count in range(7):
            at = first + 4 * count
            for number in (-1, 2**31 - 1):
                word = number.to_bytes(4, order, signed=True)  # type: ignore[arg-type]
                yield sound[name].with_file(name, data[:at] + word + data[at + 4 :])
    data = sound["mix.lb4.ugrid"].files["mix.lb4.ugrid"]
    yield sound["mix.lb4.ugrid"].with_file("mix.lb4.ugrid", data[:28] + b"\1\0\xa0\x7f" + data[32:])
    tet = sound["tet.ugrid"]
    for text in (
        b"",
        b"-1\n",
        b"999999999\n",
        b"9" * 5000,
        b"2\n1 4000 a\n1 4000 b\n",
        b"1\n1 4000 \x1b[31m\xff\n",
        b"1\n1 4000 \0a\n",
    ):
        yield tet.with_file("tet.mapbc", text)
    for counts in (b"5 6 0 2 0 0", b"-5 6 0 2 0 0 0", b"5 6 0 999999999999999999 0 0 0", b"9" * 5000):
        yield _with(tet, "tet.ugrid", rb"\A[^\n]*", counts)


def fluent(sound: Sound) -> Iterator[Input]:
    """Numbers of cells, faces and nodes that are not there, and ranges of sections that are huge or backward."""
    for name in ("tet_solver.cas.h5", "plane_meshing.cas.h5"):
        one = sound[name]
        for place in (
            "faces/c0/1",
            "faces/c1/1",
            "faces/nodes/1/nodes",
            "faces/nodes/1/nnodes",
            "faces/zoneTopology/maxId",
        ):
            for number in (0, 99, 2**31 - 1):
                yield one.with_file(name, _in_hdf5(one.files[name], f"meshes/1/{place}", number))
        shadows = "meshes/1/faces/zoneTopology/shadowZoneId"
        yield one.with_file(name, _in_hdf5(one.files[name], shadows, 2**31 - 1))
        for place in ("nodes/coords/1", "faces/c0/1", "faces/nodes/1"):
            for key, number in (("maxId", 2**62), ("maxId", 0), ("minId", 2**62), ("minId", 2)):
                yield one.with_file(name, _in_hdf5(one.files[name], f"meshes/1/{place}", number, key))
        for key in ("nodeCount", "faceCount", "cellCount"):
            yield one.with_file(name, _in_hdf5(one.files[name], "meshes/1", 2**62, key))


def _in_hdf5(data: bytes, place: str, number: int, attribute: str = "") -> bytes:
    """Return a file with another number first in a dataset, or as an attribute."""
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        if attribute:
            file[place].attrs[attribute] = np.array([number], "u8")
        else:
            file[place][0] = np.array(number).astype(file[place].dtype)
    return buffer.getvalue()


def plot3d(sound: Sound) -> Iterator[Input]:
    """Plane cells beyond all range, counts that are huge, maps of another grid and without end."""
    flat, cut, names = sound["flat_text.x"], sound["cut_text.xyz"], "cut_text.nmf"
    yield _with(flat, "flat_text.x", rb"\n\S+ ", b"\n1e300 ")
    for number in (b"-1", b"0", b"99999999999", b"1e9", b"nan", b"3*1"):
        yield _with(cut, "cut_text.xyz", rb"\A\d+", number)
    for text in (b"", b"\0", b"9" * 5000, b"1\n" * 5000, b"#" * 5000, b"wall " * 5000):
        yield cut.with_file(names, text)
    for line in (
        b"wall 9 1 1 2 1 2",
        b"wall 1 9 1 2 1 2",
        b"wall 1 1 0 99999 1 2",
        b"one_to_one 1 1 1 2 1 2 1 2 1 2 1 2 X",
    ):
        yield cut.with_file(names, cut.files[names] + line)


def openfoam(sound: Sound) -> Iterator[Input]:
    """A list of one value told often, what unpacks to very much, braces without end, types of no length."""
    case = sound["tet"]
    place = "tet/constant/polyMesh/"
    head = re.compile(rb".*?\}", re.DOTALL).match(case.files[place + "owner"])
    assert head
    text = head[0].replace(b"binary", b"ascii")
    for content in (b"900000000{0}", b"99999999999999999999{0}", b"-1(0)", b"5{}", b"3(0 1", b"{" * 5000):
        yield case.with_file(place + "owner", text + b"\n" + content + b"\n")
    rest = {name: data for name, data in case.files.items() if name != place + "points"}
    yield Input({**rest, place + "points.gz": gzip.compress(bytes(200_000_000), 9, mtime=0)})
    yield case.with_file(place + "points", b"FoamFile{" * 100_000)
    yield case.with_file(place + "boundary", text + b"1(" + b"wall{" * 5000)
    for arch in (b"label=128;scalar=64", b"label=32;scalar=8", b"label=0;scalar=0", b"label=7;scalar=1000000"):
        yield _with(case, place + "owner", rb'arch +"[^"]*"', b'arch "LSB;' + arch + b'"')
        yield _with(case, place + "points", rb'arch +"[^"]*"', b'arch "LSB;' + arch + b'"')
    for key, number in ((b"startFace", b"0"), (b"startFace", b"99999999999"), (b"nFaces", b"-1"), (b"nFaces", b"2")):
        yield _with(case, place + "boundary", key + rb"\s+\d+", key + b" " + number)


def vtu(sound: Sound) -> Iterator[Input]:
    """Sizes that a file cannot hold."""
    for name in ("tet.vtu", "polyhedra.vtu"):
        for key, number in (
            (b"NumberOfPoints", b"99999999999"), (b"NumberOfPoints", b"-5"), (b"NumberOfCells", b"-5"),
            (b"NumberOfComponents", b"4000000000"), (b"NumberOfComponents", b"-3"), (b"offset", b"99999999999"),
        ):  # fmt: skip
            yield _with(sound[name], name, key + rb'="[^"]*"', key + b'="' + number + b'"')


def tau(sound: Sound) -> Iterator[Input]:
    """Lengths, counts and offsets that cannot be; names of patches that command a terminal."""
    tet = sound["tet.grid"]
    data = tet.files["tet.grid"]
    for at in range(4, data.index(b"points_zc"), 4):
        if data[at - 4 : at].isalnum() or not at % 16:
            yield tet.with_file("tet.grid", data[:at] + b"\x7f\xff\xff\xff" + data[at + 4 :])
    for start in (b"", b"CDF", b"CDF\1", b"CDF\5", b"\x89HDF\r\n\x1a\n", b"CDF\2" + bytes(28)):
        yield tet.with_file("tet.grid", start)
    for name in (b"\x1b[31mwall\x07", b"w\0\0\0"):
        yield Input({**tet.files, "tet.bmap": b"Markers: 1\nName: " + name + b"\nblock end"})


ZONE = "Base/Zone"
GRID = f"{ZONE}/GridCoordinates"
AXIS = f"{GRID}/CoordinateX"


def cgns(sound: Sound) -> Iterator[Input]:
    """Links out of the file, data outside it or not in it, sizes and ranges that cannot be."""
    plain = sound["tet.cgns"]
    with h5py.File(io.BytesIO(plain.files["tet.cgns"])) as file:
        names: list[str] = []
        file.visit(names.append)
    ranges = [name for name in names if name.rpartition("/")[2] in ("PointRange", "PointList", "ElementRange")]
    rows = ([[9], [3]], [[1], [2**31 - 1]], [[-4], [3]], [[0], [0]], [[3]], [])
    for change in (_external_link, _external_data, _soft_link, _cycle):
        yield _changed(plain, change)
    for name, given in (
        (AXIS, {"shape": (10**9,), "dtype": "f8", "chunks": (1000,)}), (AXIS, {"data": h5py.Empty("f8")}),
        (AXIS, {"data": np.array([np.inf, 0, 0, 0, 1])}), (AXIS, {"data": np.zeros(5, "c16")}), (AXIS, {"data": 1.0}),
        (ZONE, {"data": np.zeros((0, 3), "i4")}), (ZONE, {"data": np.zeros((3, 0), "i4")}),
        (ZONE, {"data": np.array([[2**31 - 1], [2], [0]], "i4")}), (ZONE, {"data": np.array([[-5], [2], [0]], "i4")}),
        *((name, {"data": np.array(values, dtype="i4")}) for name in ranges for values in rows),
        *((name, {"data": h5py.Empty("i4")}) for name in ranges),
    ):  # fmt: skip
        yield _changed(plain, partial(_replace, name=name, given=given))
    yield Input({"tet.cgns": b"ADF Database Version A02011>" + bytes(4096)})
    side = "Base/Zone/ZoneGridConnectivity/Periodic 1 to"
    motion = f"{side}/GridConnectivityProperty/Periodic"
    for name, values in (
        (f"{motion}/RotationAngle", np.array([np.nan, np.inf, 1e38], "f4")),
        (f"{motion}/Translation", np.ones(9, "f4")), (f"{motion}/RotationAngle", np.full(3, 1e30, "f4")),
        (f"{motion}/RotationCenter", np.full(3, 3e38, "f4")),
        (f"{side}/PointList", np.full((9, 1), 2**31 - 1, "i4")), (f"{side}/PointList", np.array([[1], [1]], "i4")),
    ):  # fmt: skip
        for one in ("turn.cgns", "motion.cgns"):
            yield _changed(sound[one], partial(_replace, name=name, given={"data": values}))


def _changed(one: Input, change: Callable[[Any], None]) -> Input:
    buffer = io.BytesIO(one.files[one.main])
    with h5py.File(buffer, "r+") as file:
        change(file)
    return one.with_file(one.main, buffer.getvalue())


def _replace(file: Any, name: str, given: dict[str, Any]) -> None:
    del file[name][" data"]
    file[name].create_dataset(" data", **given)


def _external_link(file: Any) -> None:
    del file[GRID]
    file[GRID] = h5py.ExternalLink("master.cgns", f"/{GRID}")


def _external_data(file: Any) -> None:
    del file[AXIS][" data"]
    file[AXIS].create_dataset(" data", (5,), "f8", external=[("values.raw", 0, 40)])


def _soft_link(file: Any) -> None:
    del file[GRID]
    file[GRID] = h5py.SoftLink("/")


def _cycle(file: Any) -> None:
    file[f"{ZONE}/Zone"] = file[ZONE]
    file[f"{GRID}/again"] = file["Base"]


MAKERS: dict[str, Callable[[Sound], Iterator[Input]]] = {
    "su2": su2, "gmsh": gmsh, "ugrid": ugrid, "tau": tau, "fluent": fluent, "plot3d": plot3d,
    "openfoam": openfoam, "vtu": vtu, "cgns": cgns,
}  # fmt: skip
