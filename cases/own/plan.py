"""All that is decided before anything is fitted: what `--dry-run` shows."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.cases.own.boundary import Boundary
from sdm_deflect.cases.own.job import TOLERANCE_EDGES, Job
from sdm_deflect.cases.own.region import Region
from sdm_deflect.cases.own.sites import Sites
from sdm_deflect.cases.progress import Stopwatch
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.touched import TouchedCells


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The nodes that move, the box, the sites and the cells touched, for all angles of a job."""

    boundary: Boundary
    region: Region
    sites: Sites
    touched: TouchedCells
    angles: tuple[float, ...]

    @property
    def subject(self) -> Mesh:
        """The mesh."""
        return self.boundary.subject

    @property
    def job(self) -> Job:
        """What is asked."""
        return self.boundary.job

    @property
    def walls(self) -> IndexArray:
        """Sorted indices of the moving and fixed nodes inside."""
        return np.union1d(self.sites.nodes, self.sites.still)


def planned(subject: Mesh, job: Job, angles: tuple[float, ...], watch: Stopwatch) -> Plan:
    """Decide motion, box and sites, and judge the mesh as it is.

    Raises
    ------
    InputError
        If the job does not suit the mesh.
    """
    with watch.stage("plan") as report:
        report("surfaces", float("nan"))
        boundary = Boundary.of(subject, job)
        report("box", float("nan"))
        region = Region.of(boundary, angles)
        sites = Sites.of(boundary, region, TOLERANCE_EDGES)
    with watch.stage("cells") as report:
        report("inverted cells", float("nan"))
        touched = TouchedCells.of(subject, region.inside)
        touched.check(job.allow_inverted)
    return Plan(boundary, region, sites, touched, angles)
