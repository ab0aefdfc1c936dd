"""The figures of a run, as the contract names them."""

import resource
from dataclasses import asdict
from importlib.metadata import version
from math import isfinite
from typing import Any

from sdm_deflect.cases.confine import DIRECTIONS
from sdm_deflect.cases.deflect import Deflected, inside_quality
from sdm_deflect.cases.run import Run
from sdm_deflect.deform.quality import Quality, mean_ratio, summarise

Json = dict[str, Any]


def metrics(run: Run) -> Json:
    """Return the content of metrics.json (SI units, degrees)."""
    case, first = run.case, run.deflections[0]
    before, after = (summarise(mean_ratio(mesh.points, mesh.tets)) for mesh in (run.mesh, run.deflected))
    return {
        "case": case.name,
        "scale": case.scale,
        "angle_deg": case.angle,
        "strategy": case.strategy,
        "version": version("sdm-deflect"),
        "mesh": _mesh(run, before),
        **_surface(run, first),
        "evaluation": _evaluation(run),
        "quality": {"before": _quality(before), "after": _quality(after), "inverted": after.inverted},
        "validation": {
            "checks": [
                {"name": c.name, "value": c.value if isfinite(c.value) else None, "limit": c.limit,
                 "passed": c.passed, "unit": c.unit, "where": c.where}
                for c in run.checks
            ],
            "passed": run.passed,
        },
        "deflections": {d.turn.surface: {"angle_deg": d.turn.angle, **_surface(run, d)} for d in run.deflections},
        "timings": run.seconds,
        "total_seconds": sum(run.seconds.values()),
        "peak_rss_bytes": peak_rss_bytes(),
    }  # fmt: skip


def peak_rss_bytes() -> int:
    """Largest resident memory of this process or of any subprocess that has ended."""
    return 1024 * max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def _mesh(run: Run, before: Quality) -> Json:
    mesh = run.mesh
    return {
        "points": len(mesh.points),
        "cells": len(mesh.tets),
        "patches": {
            name: {"points": len(mesh.on(name)), "triangles": len(mesh.triangles_of(name))}
            for name in mesh.names[1:]
        },
        "quality_min": before.min,
        "boundary_to_cad_max": run.origin.boundary_to_cad_max,
    }


def _surface(run: Run, one: Deflected) -> Json:
    """Confinement, sites and adaptation of one control surface."""
    region = one.turn.region
    return {
        "confinement": {
            "corners": region.hexahedron.corners.tolist(),
            "inside": len(region.inside),
            "filter_seconds": region.filter_seconds,
            "spacing": region.spacing,
        },
        "sites": {
            "surface": len(one.turn.motion.nodes),
            "hexahedron": {d: region.zero_sites(c) for c, d in enumerate(DIRECTIONS)},
        },
        "adaptation": _adaptation(one),
        "quality_inside": {
            "before": asdict(inside_quality(run.mesh, region, run.mesh.points)),
            "after": asdict(inside_quality(run.mesh, region, run.deflected.points)),
            **({"after_pinned": asdict(run.pinned)} if run.pinned else {}),
        },
        "steps": len(one.steps),
        "largest_correction": max(step.correction for step in one.steps),
    }


def _adaptation(one: Deflected) -> Json:
    """Per direction, summed over steps: centres of the largest step, its error, seconds of all."""
    table: Json = {}
    for fits in zip(*(step.fits for step in one.steps), strict=True):
        entry = {
            "centers": max(len(fit.chosen) for fit in fits),
            "iterations": sum(fit.history[-1].iteration for fit in fits),
            "max_error": max(fit.max_error for fit in fits),
            "seconds": sum(fit.history[-1].seconds for fit in fits),
            "stop": fits[-1].stop.value,
        }
        table.update({DIRECTIONS[c]: entry for c in fits[0].components})
    return table


def _evaluation(run: Run) -> Json:
    seconds = sum(step.evaluation_seconds for d in run.deflections for step in d.steps)
    pairs = sum(
        len(d.turn.region.inside) * len(fit.chosen) * len(fit.components)
        for d in run.deflections for step in d.steps for fit in step.fits
    )  # fmt: skip
    return {
        "seconds": seconds,
        "whole_mesh_seconds": run.whole_mesh_seconds,
        "pairs_per_second": pairs / seconds if seconds else 0.0,
    }


def _quality(summary: Quality) -> Json:
    return {name: getattr(summary, name) for name in ("min", "p01", "mean", "below_0_2", "below_0_4")}
