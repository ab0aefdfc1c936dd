"""Modes of a structure from Nastran's files: `python nastran_modes.py naca.su2` plans three of each for that wing.

`sdm example` writes the mesh. Its structure is made here, once as a plate of shells and once as a beam, and written as
Nastran writes it. `read` takes files of your own. An .op2 is read by pyNastran instead, in an environment of its own,
as it needs NumPy 1: `read_op2("wing.op2").eigenvectors[1].data` has T1 to R3 of the nodes in subcase 1.
"""

import re
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

import sdm_deflect

CHORD, SPAN = 1.0, 2.0
# Half a wing of solid aluminium, m, N and kg. Without lateral contraction a plate bends as a beam does.
THICKNESS, YOUNG, SHEAR, DENSITY = 0.02, 70e9, 35e9, 2700.0
MODES = 3
# Points and weights of Gauss on the unit interval, exact for the plate's polynomials.
GAUSS = [((1.0 + x) / 2.0, w / 2.0) for x, w in zip(*np.polynomial.legendre.leggauss(4), strict=True)]
# Exponents of x and y in the deflection of a rectangular plate of twelve degrees of freedom.
POWERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 1), (1, 3)]


def number(text: str) -> float:
    """Return a number as Nastran writes it: ``1.5-3`` is .0015, and nothing is 0."""
    return float(re.sub(r"(?<=[\d.])([+-])", r"e\1", text.strip().upper().replace("D", "E")) or 0.0)


def read(stem: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return points (P, 3) of a .bdf, and T1 to R3 (M, P, 6) of the modes in the .f06, all in basic coordinates."""
    places, modes, mode = {}, {}, None
    for line in stem.with_suffix(".bdf").read_text().splitlines():
        if re.match(r"GRID[ ,]", line, re.IGNORECASE):
            fields = line.split(",") if "," in line else [line[i : i + 8] for i in range(0, 48, 8)]
            places[int(fields[1])] = [number(text) for text in fields[3:6]]
    for line in stem.with_suffix(".f06").read_text().splitlines():
        if re.search(r"[A-Z] [A-Z] [A-Z]", line):  # the title of a table
            title = re.search(r"E I G E N V E C T O R   N O \.\s+(\d+)", line)
            mode = modes.setdefault(int(title[1]), {}) if title else None
        elif mode is not None and (row := re.match(r"\s*(\d+)\s+G" + r"\s+(\S+)" * 6, line)):
            mode[int(row[1])] = [number(text) for text in row.groups()[1:]]
    return np.array([places[i] for i in places]), np.array([[modes[k][i] for i in places] for k in sorted(modes)])


def write(stem: Path, points: np.ndarray, frequencies: np.ndarray, modes: np.ndarray) -> None:
    """Write points (P, 3) as GRIDs, and T1 to R3 (M, P, 6) as the tables of an .f06."""
    grids = [f"GRID    {i:8d}        " + "".join(f"{x:8.5f}" for x in point) for i, point in enumerate(points, 1)]
    stem.with_suffix(".bdf").write_text("BEGIN BULK\n" + "\n".join(grids) + "\nENDDATA\n")
    with stem.with_suffix(".f06").open("w") as file:
        for k, (cycles, mode) in enumerate(zip(frequencies, modes, strict=True), 1):
            file.write(f"      EIGENVALUE = {(2.0 * np.pi * cycles) ** 2:13.6E}\n")
            file.write(
                f"          CYCLES = {cycles:13.6E}         R E A L   E I G E N V E C T O R   N O . {k:10d}\n \n"
            )
            file.write(
                "      POINT ID.   TYPE"
                + "".join(f"{name:>15}" for name in ("T1", "T2", "T3", "R1", "R2", "R3"))
                + "\n"
            )
            file.writelines(
                f"{i:14d}      G  " + "".join(f"{x:15.6E}" for x in row) + "\n" for i, row in enumerate(mode, 1)
            )


def solved(
    elements: list[tuple[np.ndarray, np.ndarray, np.ndarray]], points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest frequencies (M,) in 1/s, and modes (M, P, 6), of nodes with T3, R1 and R2, clamped at y = 0.

    Each element has its nodes, its stiffness and its mass. The largest component of a mode is 1, as by NORM=MAX.
    """
    stiffness, mass = np.zeros((2, 3 * len(points), 3 * len(points)))
    for nodes, one, other in elements:
        at = (3 * nodes[:, None] + np.arange(3)).ravel()
        stiffness[np.ix_(at, at)] += one
        mass[np.ix_(at, at)] += other
    free = np.flatnonzero(np.repeat(points[:, 1] > 0.0, 3))
    squares, vectors = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], subset_by_index=[0, MODES - 1])
    modes = np.zeros((MODES, len(points), 6))
    for mode, vector in zip(modes, vectors.T, strict=True):
        mode[:, 2:5].flat[free] = vector
        mode /= mode.flat[np.abs(mode).argmax()]
    return np.sqrt(squares) / (2.0 * np.pi), modes


def terms(x: float, y: float, by_x: int = 0, by_y: int = 0) -> np.ndarray:
    """Return a derivative of the plate's polynomials (12,) at a point."""

    def factor(power: int, order: int) -> float:
        return float(np.prod(np.arange(power, power - order, -1)))

    return np.array([
        factor(i, by_x) * factor(j, by_y) * x ** max(i - by_x, 0) * y ** max(j - by_y, 0) for i, j in POWERS
    ])  # fmt: skip


def plate(chordwise: int = 8, spanwise: int = 16) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points, frequencies and modes of a plate of thin rectangular shells."""
    a, b = CHORD / chordwise, SPAN / spanwise
    corners = [(0.0, 0.0), (a, 0.0), (a, b), (0.0, b)]
    to_terms = np.linalg.inv(
        np.vstack([[terms(*at), terms(*at, by_y=1), -terms(*at, by_x=1)] for at in corners])
    )  # T3, R1 = dT3/dy and R2 = -dT3/dx
    stiffness, mass = np.zeros((2, 12, 12))
    rigidity = YOUNG * THICKNESS**3 / 12.0
    for (x, u), (y, v) in ((one, other) for one in GAUSS for other in GAUSS):
        at = (a * x, b * y)
        bend = [terms(*at, by_x=2), terms(*at, by_y=2), np.sqrt(2.0) * terms(*at, by_x=1, by_y=1)]
        stiffness += u * v * a * b * rigidity * sum(np.outer(row, row) for row in bend)
        mass += u * v * a * b * DENSITY * THICKNESS * np.outer(terms(*at), terms(*at))
    element = to_terms.T @ stiffness @ to_terms, to_terms.T @ mass @ to_terms
    y, x = np.divmod(np.arange((chordwise + 1) * (spanwise + 1)), chordwise + 1)
    points = np.column_stack([a * x, b * y, np.zeros(len(x))])
    first = np.flatnonzero((x < chordwise) & (y < spanwise))
    elements = [(i + np.array([0, 1, chordwise + 2, chordwise + 1]), *element) for i in first]
    return points, *solved(elements, points)


def beam(count: int = 17) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points, frequencies and modes of a beam in the middle of the chord, with the plate's section."""
    points = np.column_stack([np.full(count, 0.5 * CHORD), np.linspace(0.0, SPAN, count), np.zeros(count)])
    area, inertia, h = CHORD * THICKNESS, CHORD * THICKNESS**3 / 12.0, SPAN / (count - 1)
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    bend = np.vstack([bend, -bend[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) * YOUNG * inertia / h**3
    sway = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]])
    sway = np.vstack([sway, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
    stiffness, mass = np.zeros((2, 6, 6))
    up, turn = np.ix_([0, 1, 3, 4], [0, 1, 3, 4]), np.ix_([2, 5], [2, 5])  # T3 and R1, and R2
    stiffness[up], mass[up] = bend, sway * DENSITY * area * h / 420.0
    stiffness[turn] = SHEAR * 4.0 * inertia / h * np.array([[1, -1], [-1, 1]])
    mass[turn] = DENSITY * area * (CHORD**2 + THICKNESS**2) / 12.0 * h / 6.0 * np.array([[2, 1], [1, 2]])
    elements = [(np.array(pair), stiffness, mass) for pair in pairwise(range(count))]
    return points, *solved(elements, points)


def tables(stem: Path, turns: bool) -> dict[str, sdm_deflect.Table]:
    """Return a table for each mode of Nastran's files; with the rotations of a beam, or the shells' displacements."""
    points, modes = read(stem)
    return {
        f"{stem.name} {k}": sdm_deflect.Table(points, mode[:, :3], rotations=mode[:, 3:] if turns else None)
        for k, mode in enumerate(modes, 1)
    }


def main(mesh: Path) -> None:
    """Write both structures, and a plan with an amount for each mode, beside a mesh; judge it at some amounts."""
    warp = sdm_deflect.surface_map(mesh, ["wing", "flap"], largest=0.3, slide="symmetry:plane")
    for name, structure, turns in (("plate", plate, False), ("beam", beam, True)):
        points, frequencies, modes = structure()
        write(mesh.with_name(name), points, frequencies, modes)
        plan = warp.modes(tables(mesh.with_name(name), turns), ends=(-0.2, 0.2))
        plan.save(mesh.with_name(f"{name}-modes.npz"))
        failed = [check.name for check in plan.check((0.15, -0.05, 0.03)) if not check.passed]
        cycles = ", ".join(f"{f:.1f}" for f in frequencies)
        sys.stdout.write(f"{name}: modes of {cycles} Hz; checks that failed: {', '.join(failed) or 'none'}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
