"""CAD models and a real mesh around one of them, shared by the tests of mesh generation."""

from dataclasses import replace

import cadquery as cq
import numpy as np
import pytest

from sdm_deflect.geometry.assemble import assemble
from sdm_deflect.geometry.fuse import NamedSolid, general_fuse, partitions, skin, solid, walls
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.geometry.polyhedra import prism
from sdm_deflect.meshing.generate.generation import Generated, generate
from sdm_deflect.meshing.generate.parameters import MeshParameters

COARSE = replace(
    MeshParameters(),
    fuselage=0.04,
    wing=0.03,
    chimera=0.06,
    corner=0.03,
    growth=0.6,
    far_field=1.0,
    envelope=4e-4,
    accept_mean=0.8,
    accept_below=0.01,
)


def half_cylinder() -> cq.Solid:
    """Half a cylinder about x, radius 0.1 m, from x = 0 to 0.5 m, on the side of positive y."""
    outline = cq.Workplane("YZ").moveTo(0.0, -0.1).threePointArc((0.1, 0.0), (0.0, 0.1)).close()
    return outline.extrude(0.5).val()


def diamond(y: float, leading: float, chord: float) -> np.ndarray:
    """A thick diamond section (4, 3) at station y."""
    x, z = leading + chord * np.array([0.0, 0.5, 1.0, 0.5]), 0.15 * chord * np.array([0.0, 1.0, 0.0, -1.0])
    return np.stack([x, np.full(4, y), z], axis=1)


@pytest.fixture(scope="session")
def body() -> CadModel:
    """Half a cylinder with a stub wing: planes, a cylinder, curved intersection lines."""
    wing = solid(prism(diamond(0.05, 0.12, 0.25), diamond(0.25, 0.2, 0.15)))
    found = walls(general_fuse([NamedSolid("fuselage", half_cylinder()), NamedSolid("wing_right", wing)]))
    return assemble(skin(found), partitions(found), fluid_inside=False)


@pytest.fixture(scope="session")
def chamber(body: CadModel) -> CadModel:
    """The flow in a box around the stub wing, cut off from the cylinder."""
    wing = solid(prism(diamond(0.05, 0.12, 0.25), diamond(0.25, 0.2, 0.15)))
    box = cq.Workplane("XY").box(0.6, 0.3, 0.3).translate((0.25, 0.25, 0.0)).val()
    found = walls(general_fuse([NamedSolid("wing_right", wing), NamedSolid("chimera", box)]))
    return assemble(skin(found, "chimera"), [], fluid_inside=True)


@pytest.fixture(scope="session")
def coarse() -> MeshParameters:
    """Sizes for meshes of a few thousand cells."""
    return COARSE


@pytest.fixture(scope="session")
def made(body: CadModel, coarse: MeshParameters) -> Generated:
    """A real mesh around the body."""
    return generate(body, coarse)
