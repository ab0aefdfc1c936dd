"""What is done once for every point or cell: seconds for a million."""

from collections.abc import Iterator

import numpy as np

from benchmarks.measure import side_by_side, warm
from benchmarks.results import Result
from benchmarks.workloads import points_around, tail
from sdm_deflect.base.arrays import first_coincident
from sdm_deflect.meshing.mesh.quality import mean_ratio

MILLION = 1_000_000
# Tolerance (m) of the fit.
TOLERANCE = 1e-9


def results(rounds: int) -> Iterator[Result]:
    """Yield seconds per million of filter, sites, duplicates and quality."""
    region = tail().region
    points = points_around(region, MILLION // 8, MILLION - MILLION // 8)
    spacing = 0.00031
    sites = len(region.face_sites(spacing))
    tets = np.random.default_rng(0).integers(0, MILLION, (MILLION, 4))
    actions = {
        "filter": lambda: region.contains(points),
        "sites": lambda: region.face_sites(spacing),
        "duplicates": lambda: first_coincident(points, TOLERANCE),
        "quality": lambda: mean_ratio(points, tets),
    }
    warm(actions)
    times = side_by_side(actions, rounds)
    for name, count, note in (
        ("filter", MILLION, "points, confinement filter"),
        ("sites", sites, "sites on the hexahedron's faces, each once"),
        ("duplicates", MILLION, "points, search for coinciding ones"),
        ("quality", MILLION, "cells in random order, mean ratio"),
    ):
        yield Result(f"{name}_per_million", times.median(name) * MILLION / count, "s", rounds, note)
