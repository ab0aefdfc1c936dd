"""Donors of the Chimera block over the angle, and the block and its background as one case of OpenFOAM."""

from dataclasses import replace

import pytest

from sdm_deflect.cases.aircraft.job import BLOCK, plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.meshing.formats.openfoam_files import MESH, open_foam, parse
from sdm_deflect.meshing.mesh import tets_of
from studies.donors import donors_at, write_donors
from studies.flow import overset
from studies.flow.setup import Setup


def test_an_angle_without_a_mesh_says_why(chimera_run, tmp_path):
    case, watch = chimera_run[0].case, Stopwatch()
    small = replace(case, confinement=replace(case.confinement, up=0.005))
    found = donors_at(small, [-30.0], watch)
    assert "leave the box at -30" in found[0].reason
    assert not found[0].passed
    assert found[0].reason in write_donors(small, found, tmp_path)


def test_a_case_without_a_block_has_no_donors():
    with pytest.raises(InputError, match="case tail: has no Chimera block; aileron-chimera has"):
        donors_at(case_named("tail"), [12.0], Stopwatch())


def test_block_and_background_are_one_overset_case(chimera_run, tmp_path):
    run, _ = chimera_run
    case = replace(run.case, angle=-12.0)
    plan = plan_of(case, run.mesh)
    block = run.mesh.with_points(deflect(plan).points)
    folder = tmp_path / "overset"
    overset.write_overset(block, run.background, BLOCK, Setup(), folder)
    types = {patch.name: patch.type for patch in parse(open_foam(folder / MESH, "boundary").text())}
    assert next(iter(types)) == "chimera"  # OpenFOAM wants the overset patch first
    assert [name for name, kind in types.items() if kind == "overset"] == ["chimera"]
    assert {name for name, kind in types.items() if kind == "symmetry"} == {"background_wing_left", "block_wing_left"}
    assert (types["far_field"], types["aileron_left"]) == ("patch", "wall")
    zones = (folder / "0" / "zoneID").read_text().split("(\n")[1].split("\n)")[0].split()
    assert [zones.count(zone) for zone in "01"] == [len(tets_of(run.background)), len(tets_of(run.mesh))]
