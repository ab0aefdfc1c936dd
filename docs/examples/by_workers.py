"""Deflect a mesh file by workers, from Python: what `sdm deflect --workers` and `--scheduler` do.

Run `python by_workers.py` beside naca15.cgns, or import `deflected`.
"""

from pathlib import Path
from typing import Any

from sdm_deflect.cases.run.cluster import workers
from sdm_deflect.cases.run.deflect_file import Outcome, deflect_file
from sdm_deflect.cases.run.mesh_files import OutputFiles
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.cases.settings.job_settings import JobSettings, settings_of
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.volume.job import pose_of

HINGE = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]


def deflected(source: Path, out: Path, settings: JobSettings, **helpers: Any) -> Outcome:
    """Write the deflected mesh and return what was found: checks, quality, figures."""
    jobs, watch = jobs_of(settings), Stopwatch()
    wanted = OutputFiles.of(source, out, (pose_of(jobs),))
    wanted.check()
    with workers(watch, source, out.absolute().parent, **helpers) as runner:
        return deflect_file(wanted, jobs, watch, runner)


if __name__ == "__main__":  # workers import this file
    flap = settings_of("flap", HINGE, -5.0, {"motion": "blended", "fixed": "wing", "slide": "symmetry:plane"})
    done = deflected(Path("naca15.cgns"), Path("naca10.cgns"), flap, count=2, memory="1.5GB")
    print("all checks passed" if done.passed else "A CHECK FAILED")
