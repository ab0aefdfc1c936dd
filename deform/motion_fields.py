"""A plan as point fields of an OpenFOAM case, which the motion solver in `solvers/openfoam` adds up at each time.

Coordinates are X0 + sum of f_k(amount) F_k over all surfaces. For a hinge, F_1 and F_2 are called S and V, and the
functions are sin a and 1 - cos a.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.files import replacing_together

from .surface.motions import Fixed, Powers, Turn
from .volume.controls import ControlRange

# Rows of a table of functions between the stops of a track: cubics between them are exact to 1e-15.
ROWS = 2000
HEADER = """FoamFile
{{
    version 2.0; format {}; arch "LSB;label=32;scalar=64"; class {}; location "{}"; object {};
}}
// Written by sdm-deflect.
"""
# OpenFOAM takes a patch's own type where `calculated` is not allowed, as on planes of symmetry.
FIELD = """dimensions [0 1 0 0 0 0 0];
boundaryField
{
    ".*" { type calculated; }
}
internalField nonuniform List<vector> """
SOLVER = """dynamicFvMesh dynamicMotionSolverFvMesh;
motionSolverLibs ("libsdmMotion.so");
solver sdmMotion;
sdmMotionCoeffs
{
"""


def write_motion(
    case: Path, start: FloatArray, surfaces: Iterable[tuple[ControlRange, IntArray, FloatArray]]
) -> tuple[Path, ...]:
    """Write X0 and F_k into ``case/0``, and functions and ranges into ``constant/sdmMotion``; return all files.

    If there is no ``constant/dynamicMeshDict``, one is written in which all amounts are 0. All files appear, or none.

    Parameters
    ----------
    case : The folder of the case.
    start : (N, 3) undeflected coordinates of its nodes.
    surfaces : Each surface with the nodes (M,) that it moves and their fields (k, M, 3).

    Raises InputError for a folder that is no case, a plan of one amount, or names of surfaces that are one in OpenFOAM.
    """
    if not (case / "constant").is_dir():
        raise InputError(f"{case}: is no case of OpenFOAM: it has no folder constant")
    moving = list(surfaces)
    names, constant = _names([control for control, _, _ in moving]), case / "constant"
    files: dict[Path, Path] = {}
    with replacing_together(case) as (folder, moves):

        def write(path: Path, kind: str, content: str, values: FloatArray | None = None) -> None:
            files[path] = folder / str(len(files))
            form = "ascii" if values is None else "binary"
            with files[path].open("wb") as file:
                file.write((HEADER.format(form, kind, path.parent.name, path.name) + content).encode())
                if values is not None:
                    file.writelines((b"%d\n(" % len(values), np.ascontiguousarray(values, "<f8").data, b");\n"))

        write(case / "0" / "X0", "pointVectorField", FIELD, start)
        entries = []
        for name, (control, rows, fields) in zip(names, moving, strict=True):
            labels = [f"{name}.{_letters(control, k)}" for k in range(len(fields))]
            for label, field in zip(labels, fields, strict=True):
                whole = np.zeros_like(start)
                whole[rows] = field
                write(case / "0" / label, "pointVectorField", FIELD, whole)
            entries.append(f"{name}\n{{\n    fields ({' '.join(labels)});\n{_functions(control)}}}\n")
        write(constant / "sdmMotion", "dictionary", "".join(entries))
        if not (amounts := constant / "dynamicMeshDict").exists():
            write(amounts, "dictionary", SOLVER + "".join(f"    {name} table ((0 0));\n" for name in names) + "}\n")
        if (older := constant / "sdmMotion").exists():  # without functions no solver adds up fields of two plans
            moves[older] = folder / "older"
        (case / "0").mkdir(exist_ok=True)
        moves |= {beside: path for path, beside in files.items()}
    return tuple(files)


def _names(controls: Sequence[ControlRange]) -> list[str]:
    names = [re.sub(r"[^\w.]|^(?=\d)", "_", control.name) for control in controls]
    if len(set(names)) < len(names):
        raise InputError(f"two surfaces are called {max(names, key=names.count)} in OpenFOAM; rename one")
    return names


def _letters(control: ControlRange, k: int) -> str:
    """Return the end of the name of a field: S, V, S2, V2 and so on for a turn, else its number from 1."""
    if not isinstance(control.functions, Turn):
        return str(k + 1)
    return "SV"[k % 2] + (str(k // 2 + 1) if k > 1 else "")


def _functions(control: ControlRange) -> str:
    """Return the dictionary entries of a surface's functions; InputError for a plan of one amount."""
    functions, text = control.functions, f"    range ({control.low:.17g} {control.high:.17g});\n"
    if isinstance(functions, Fixed):
        raise InputError(f"{control.name}: the plan is of {functions.amount:g} alone; make one with a range")
    if isinstance(functions, Turn):
        return f"{text}    functions turn;  // sin(k a), 1 - cos(k a)\n"
    if isinstance(functions, Powers):
        return f"{text}    functions powers;\n    scale {functions.scale:.17g};\n"
    stops = np.unique(np.clip([control.low, *functions.stops, control.high], control.low, control.high))
    rows = [np.linspace(low, high, ROWS + 1) for low, high in pairwise(stops)]
    before = np.nextafter(stops[1:-1], -np.inf)  # a track may have a kink at a stop: rates on both sides
    amounts = np.unique(np.concatenate([*rows, before]))
    values, rates = (_list(function(amount) for amount in amounts) for function in (functions.values, functions.rates))
    return f"{text}    functions table;\n    amounts {_list(amounts)};\n    values {values};\n    rates {rates};\n"


def _list(rows: Iterable[FloatArray]) -> str:
    texts = (f"{row:.17g}" if np.ndim(row) == 0 else _list(row) for row in rows)
    return f"({' '.join(texts)})"
