"""The CAD of a case and its meshing, needed only if the cache has no mesh of the case."""

from collections.abc import Callable
from functools import partial

from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.geometry.aircraft import background, build, chimera_block
from sdm_deflect.geometry.deflected import CadTurn
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.generate.generation import Finer, Generated, generate
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.mesh.labelled import tets_of

from .case import Case


def undeflected_cad(case: Case) -> CadModel:
    """Build the CAD that is meshed: the aircraft, or the Chimera block."""
    if case.domain == "block":
        return chimera_block(case.fighter, case.block, case.deflections[0].surface)
    return build(case.fighter, notch=case.notch)


def background_cad(case: Case) -> CadModel:
    """Build the CAD that is meshed around a case's Chimera block: the aircraft without its control surface."""
    return background(case.fighter, case.deflections[0].surface)


def deflected_cad(case: Case) -> CadModel:
    """Build the aircraft with its surfaces turned rigidly by the angles of the case."""
    turns = {deflection.surface: CadTurn(deflection.factor * case.angle) for deflection in case.deflections}
    return build(case.fighter, turns, notch=case.notch)


def generate_undeflected(case: Case, watch: Stopwatch) -> Generated:
    """Build and mesh the aircraft, or the Chimera block."""
    return _generate(partial(undeflected_cad, case), case.mesh, watch)


def around_block(case: Case, finer: Finer, watch: Stopwatch) -> Generated:
    """Build and mesh the aircraft that surrounds the Chimera block."""
    return _generate(partial(background_cad, case), case.background, watch, finer)


def _generate(
    built: Callable[[], CadModel], parameters: MeshParameters, watch: Stopwatch, finer: Finer | None = None
) -> Generated:
    with watch.stage("geometry") as progress:
        model = built()
        progress(f"{len(model.faces)} CAD faces", 1.0)
    with watch.stage("mesh") as progress:
        made = generate(model, parameters, progress=progress, finer=finer)
        progress(f"{len(tets_of(made.mesh))} cells in attempt {made.report.attempts}", 1.0)
    return made
