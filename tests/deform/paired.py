"""OpenFOAM cases whose patches bind nodes to one another: cyclic pairs, empty and wedge sides."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from sdm_deflect.meshing.formats.openfoam import BARE, write_files, write_mesh
from sdm_deflect.meshing.formats.openfoam_files import MESH
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Periodic
from sdm_deflect.meshing.mesh.images import THIN
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import FACES, grid


def section(around=64, outwards=14, far=8.0, angle=30.0):
    """Points (N, 2) of an O-grid around an airfoil of chord 1 (Karman and Trefftz), and its quads.

    The trailing edge, at (1, 0), has that angle in degrees, and is the first point of the airfoil.
    """
    n, k = 2.0 - angle / 180.0, 1.0
    phase = 2.0 * np.pi * np.arange(around) / around
    radius = np.geomspace(1.0, far, outwards + 1)
    zeta = (-0.1 + 1.1 * radius[:, None] * np.exp(1j * phase)).ravel()
    up, down = (zeta + k) ** n, (zeta - k) ** n
    z = n * k * (up + down) / (up - down)
    x = np.column_stack([z.real, z.imag])
    x = (x - [x[:around, 0].min(), 0.0]) / np.ptp(x[:around, 0])
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(outwards)))
    ring = (i + 1) % around
    return x, np.column_stack([j * around + i, (j + 1) * around + i, (j + 1) * around + ring, j * around + ring])


def airfoil(layers=4, span=0.4, hinge=0.7, **options):
    """The section along y: patches ``wing``, ``flap`` behind the hinge, ``far``, ``side0``, ``side1``."""
    flat, quads = section(**options)
    n = len(flat)
    points = [np.column_stack([flat[:, 0], np.full(n, y), flat[:, 1]]) for y in np.linspace(0.0, span, layers + 1)]
    cells = np.vstack([np.hstack([quads + (k + 1) * n, quads + k * n]) for k in range(layers)])
    return bounded(np.vstack(points), cells, lambda centre, inner: _parts(centre, inner, hinge, span))


def _parts(centre, inner, hinge, span):
    del inner
    x, y, z = centre.T
    near = np.hypot(x - 0.5, z) < 1.0
    ends = {"side0": np.abs(y) < 1e-9, "side1": np.abs(y - span) < 1e-9}
    rest = ~(ends["side0"] | ends["side1"])
    return {"wing": rest & near & (x < hinge), "flap": rest & near & (x >= hinge), "far": rest & ~near, **ends}


def bounded(points, cells, parts):
    """A mesh of hexahedra, those that are collapsed on an axis as prisms; `parts` sorts faces by where they are."""
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = points[used], cells.reshape(-1, 8)
    _, first, same = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    if len(first) < len(points):  # on the axis
        order = np.argsort(first)
        rank = np.argsort(order)
        points, cells = points[first[order]], rank[same.ravel()][cells]
    flat = cells[:, 0] == cells[:, 4]
    blocks = [Cells("hexahedron", cells[~flat])]
    if flat.any():
        blocks.append(Cells("wedge", cells[flat][:, [0, 7, 3, 1, 6, 2]]))
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[np.sort(first[count == 1])]
    faces = faces[(np.sort(faces, axis=1)[:, 1:] != np.sort(faces, axis=1)[:, :-1]).sum(axis=1) >= 2]
    named = parts(points[faces].mean(axis=1), points)
    patches = []
    for name, own in named.items():
        own = faces[own]
        doubled = own[:, [0, 1, 2, 3]]
        triangle = np.array([len(set(row)) == 3 for row in doubled.tolist()], dtype=bool)
        tri = [list(dict.fromkeys(row)) for row in doubled[triangle].tolist()]
        blocks_of = [Cells("quad", own[~triangle])] if (~triangle).any() else []
        patches.append(Patch(name, (*blocks_of, *([Cells("triangle", np.array(tri))] if tri else []))))
    return Mesh(points, tuple(blocks), tuple(patches))


def body_in(low, high, counts, body, place):
    """A grid of so many cells without those inside a body, two opposite corners, at the places of its points."""
    points, cells = grid(low, high, counts)
    middle = points[cells].mean(axis=1)
    inside = ((middle > body[0]) & (middle < body[1])).all(axis=1)
    return points, place(points), cells[~inside]


def sector(pitch=30.0):
    """A sector of an annulus about x, radii 1 to 1.6, with a blade that touches no wall; ``flap`` is its rear.

    Patches: ``blade``, ``flap`` (x > .5), ``hub``, ``casing``, ``inlet``, ``outlet``, and the pair ``left``, ``right``.
    """
    half = np.radians(pitch / 2.0)
    low, high = np.array([-1.0, -half, 1.0]), np.array([2.0, half, 1.6])
    body = np.array([[0.0, -half / 5, 1.15], [1.0, half / 5, 1.45]])

    def place(points):
        x, phi, r = points.T
        return np.column_stack([x, r * np.sin(phi), r * np.cos(phi)])

    def parts(centre, inner):
        del inner
        x, r, phi = centre[:, 0], np.hypot(centre[:, 1], centre[:, 2]), np.arctan2(centre[:, 1], centre[:, 2])
        found = {"left": phi < -0.99 * half, "right": phi > 0.99 * half, "inlet": x < -0.999, "outlet": x > 1.999}
        found |= {"hub": (r < 1.03) & (np.abs(phi) < 0.99 * half), "casing": r > 1.57}
        rest = np.ones(len(x), dtype=bool)
        for name in found:
            found[name] &= rest
            rest &= ~found[name]
        return {"blade": rest & (x < 0.5), "flap": rest & (x >= 0.5), **found}

    _, points, cells = body_in(low, high, (30, 15, 12), body, place)
    return bounded(points, cells, parts)


def wedge(degrees=5.0, axis=0.0):
    """An axisymmetric case, one cell thick about x, with a ring of rectangular section: ``ring``, ``flap`` its rear."""
    half = np.radians(degrees / 2.0)
    low, high = np.array([-1.0, axis, -half]), np.array([2.0, axis + 1.2, half])
    body = np.array([[0.0, axis + 0.5, -1.0], [1.0, axis + 0.6, 1.0]])

    def place(points):
        x, r, phi = points.T
        return np.column_stack([x, r * np.cos(phi), r * np.sin(phi)])

    def parts(centre, inner):
        del inner
        x, r, phi = centre[:, 0], np.hypot(centre[:, 1], centre[:, 2]), np.arctan2(centre[:, 2], centre[:, 1])
        front, back = phi < -0.99 * half, phi > 0.99 * half
        near = ~front & ~back & (x > -0.5) & (x < 1.5) & (r < axis + 0.9) & (r > axis + 0.3)
        rest = ~front & ~back & ~near
        return {
            "ring": near & (x < 0.6), "flap": near & (x >= 0.6), "far": rest, "front": front, "back": back,
        }  # fmt: skip

    _, points, cells = body_in(low, high, (36, 24, 1), body, place)
    return bounded(points, cells, parts)


def written(mesh, case, types, neighbours=(), more=""):
    """Write a case with these types of patches; `neighbours` are the pairs of cyclic ones, which say `more`."""
    write_mesh(mesh, case / MESH, {"far": "patch", **types})
    boundary = case / MESH / "boundary"
    text = boundary.read_text()
    for one, other in [(a, b) for pair in neighbours for a, b in (pair, pair[::-1])]:
        head = f"{one}\n{{\n    type {types[one]};\n"
        assert head in text
        text = text.replace(head, f"{head}    neighbourPatch {other}; {more}\n")
    boundary.write_text(text)
    write_files(case, BARE)
    return case


def bound(mesh, one, other, rotation=None, shift=(0.0, 0.0, 0.0), constraint=""):
    """The mesh with a pair of two of its patches, whose nodes are matched by where they are."""
    rotation = np.eye(3) if rotation is None else rotation
    nodes = [mesh.patch(name).nodes for name in (one, other)]
    images = mesh.points[nodes[0]] @ rotation.T + shift
    distance, rows = KDTree(mesh.points[nodes[1]]).query(images)
    assert distance.max() < 1e-12
    images = np.column_stack([nodes[0], nodes[1][rows]])
    pair = Periodic(one, (one, other), images, rotation, np.array(shift), constraint in THIN)
    patches = tuple(replace(p, constraint=constraint) if p.name in (one, other) else p for p in mesh.patches)
    return replace(mesh, patches=patches, periodic=(*mesh.periodic, pair))


def about_x(degrees):
    """The rotation about x that brings y to z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
