from dataclasses import asdict, fields

import pytest

from sdm_deflect.meshing.generate.parameters import BACKGROUND_SCALES, BLOCK_SCALES, COMPONENTS, SCALES, MeshParameters


def test_every_component_is_a_field_and_left_and_right_are_alike() -> None:
    parameters = MeshParameters()
    assert set(COMPONENTS) < {field.name for field in fields(MeshParameters)}
    assert parameters.edge_length("wing_left") == parameters.edge_length("wing_right") == parameters.wing
    assert parameters.edge_length("fuselage_panel_left") == parameters.fuselage_panel


def test_unknown_patches_and_values_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match="patch 'propeller'"):
        MeshParameters().edge_length("propeller")
    with pytest.raises(ValueError, match=r"^wing = -1 m must be a number from 0.0001 to 1 m"):
        MeshParameters(wing=-1.0)
    with pytest.raises(ValueError, match="aim = nan must"):
        MeshParameters(aim=float("nan"))


def test_scaling_changes_lengths_only() -> None:
    half, whole = asdict(MeshParameters().scaled(0.5)), asdict(MeshParameters())
    changed = {name for name in whole if half[name] != whole[name]}
    assert changed == {*COMPONENTS, "corner", "envelope"}
    assert all(half[name] == 0.5 * whole[name] for name in changed)


def test_finer_scales_have_shorter_edges() -> None:
    finest = {name: scale.wing / 2**scale.refinements for name, scale in SCALES.items()}
    assert finest["medium"] < finest["small"]
    assert SCALES["small"].far_field == 10.0


def test_every_scale_has_sizes_for_aircraft_block_and_background() -> None:
    assert list(SCALES) == list(BLOCK_SCALES) == list(BACKGROUND_SCALES)


def test_a_block_is_finer_around_its_aileron_than_the_aircraft() -> None:
    for name, block in BLOCK_SCALES.items():
        assert block.aileron < SCALES[name].aileron
        assert block.gap_cells > SCALES[name].gap_cells


def test_the_papers_aileron_is_coarse_and_its_tail_fine() -> None:
    paper, medium = SCALES["paper"], SCALES["medium"]
    assert paper.tail < medium.tail
    assert medium.aileron < paper.aileron


def test_a_refined_mesh_may_be_a_little_worse() -> None:
    for name, sizes in SCALES.items():
        assert (sizes.accept_min < SCALES["small"].accept_min) == (sizes.refinements > 0), name
