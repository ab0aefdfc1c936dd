"""Meshes with periodic sides, written by Gmsh."""

from math import cos, radians, sin

import numpy as np

from tests.extras import Library
from tests.meshing.formats.blocks import Block

gmsh = Library("gmsh")

VARIANTS = [(version, binary) for version in (2.2, 4.1) for binary in (0, 1)]
DEGREES = 30.0
SHIFTED = [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
C, S = cos(radians(DEGREES)), sin(radians(DEGREES))
TURNED = [1, 0, 0, 0, 0, C, -S, 0, 0, S, C, 0, 0, 0, 0, 1]


def write_periodic(folder, shape, variants=VARIANTS):
    """Let Gmsh mesh a shape of which the sides ``left`` and ``right`` are periodic, and write it in each variant."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        dimension, first, second, motion = shape()
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setPeriodic(dimension - 1, [second], [first], motion)
        rest = [tag for _, tag in gmsh.model.getEntities(dimension - 1) if tag not in (first, second)]
        for name, tags in (("left", [first]), ("right", [second]), ("rest", rest)):
            gmsh.model.addPhysicalGroup(dimension - 1, tags, name=name)
        gmsh.model.addPhysicalGroup(dimension, [1], name="volume")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.mesh.generate(dimension)
        out = {}
        for version, binary in variants:
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            out[version, binary] = folder / f"{shape.__name__}-{version}-{binary}.msh"
            gmsh.write(str(out[version, binary]))
        return out
    finally:
        gmsh.finalize()


def box():
    """A unit cube, periodic in x."""
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    return 3, 1, 2, SHIFTED


def square():
    """A unit square in the plane, periodic in x."""
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    return 2, 4, 2, SHIFTED


def sector():
    """A part of an annulus about x, periodic by a rotation."""
    face = gmsh.model.occ.addRectangle(0, 1, 0, 1, 1)
    found = gmsh.model.occ.revolve([(2, face)], 0, 0, 0, 1, 0, 0, radians(DEGREES))
    return 3, face, found[0][1], TURNED


def ring_of_blocks(sectors=2, degrees=45.0):
    """Blocks of a part of an annulus about x, one behind another; the end of the last one is the first one's image."""
    found = []
    for k in range(sectors):
        x, r = np.meshgrid(np.linspace(0, 1, 3), np.linspace(1, 2, 4), indexing="ij")
        turn = np.radians(degrees) * (k + np.linspace(0, 1, 4))
        points = np.stack([x[..., None] + 0 * turn, r[..., None] * np.cos(turn), r[..., None] * np.sin(turn)], axis=-1)
        places = np.arange(12).reshape(3, 4, 1) + 12 * ((3 * k + np.arange(4)) % (3 * sectors))
        found.append(Block(f"block{k}", points, places))
    return found


def carried(mesh):
    """The largest distance of a node of a pair from the image of the other."""
    return max(
        float(np.abs(pair.image(mesh.points[pair.nodes[:, 0]]) - mesh.points[pair.nodes[:, 1]]).max())
        for pair in mesh.periodic
    )
