from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.cases.aircraft.cad import undeflected_cad
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.generate.sizing import size_field, sources


def test_each_patch_is_covered_with_its_own_length(body: CadModel, coarse: MeshParameters) -> None:
    points, lengths = sources(body, replace(coarse, turn=90.0, gap_cells=0.5))
    for face in body.faces:
        spots, triangles = face.tessellation(1e-3)
        centres = spots[triangles].mean(axis=1)
        size = coarse.edge_length(face.patch)
        field = size_field(points, lengths, 0.3, 1.0)
        assert (field(centres) <= 1.3 * size).all()
        assert (field(centres) >= 0.5 * size).all()


def test_a_curved_face_never_turns_more_than_asked_along_an_edge(body: CadModel, coarse: MeshParameters) -> None:
    points, lengths = sources(body, replace(coarse, turn=10.0, corner=0.001))
    field = size_field(points, lengths, 0.3, 1.0)
    round_face = next(face for face in body.faces if not face.planar)
    spots, triangles = round_face.tessellation(1e-3)
    wanted = np.deg2rad(10.0) * 0.1
    assert field(spots[triangles].mean(axis=1)).max() < 1.5 * wanted


def test_gaps_get_their_cells(chamber: CadModel, coarse: MeshParameters) -> None:
    wide = replace(coarse, wing=0.2, chimera=0.2, corner=0.2, turn=90.0)
    at_tip = np.array([[0.275, 0.25, 0.0]])
    for cells, expected in ((4.0, (0.4 - 0.25) / 4.0), (2.0, (0.4 - 0.25) / 2.0)):
        field = size_field(*sources(chamber, replace(wide, gap_cells=cells)), 0.3, 1.0)
        assert 0.7 * expected < field(at_tip)[0] < 1.3 * expected


def test_sources_are_the_same_every_time(body: CadModel, coarse: MeshParameters) -> None:
    first, again = sources(body, coarse), sources(body, coarse)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    distance, _ = cKDTree(first[0]).query(body.vertices)
    assert distance.max() < 0.03


def test_several_cells_lie_between_the_end_of_a_trailing_edge_and_the_border_of_its_face() -> None:
    case = case_named("tail")
    panel = case.fighter.fuselage.panel_rear
    model = undeflected_cad(case)
    field = size_field(*sources(model, replace(case.mesh, corner=0.02, fuselage_panel=0.02, tail=0.02)), 0.3, 1.0)
    ends = model.vertices[(np.abs(model.vertices - [0.9225, 0.0, -0.0116]) < [1e-3, 0.07, 1e-3]).all(axis=1)]
    assert len(ends) == 2
    assert (field(ends) <= (panel - ends[:, 0]) / 2.5).all()
