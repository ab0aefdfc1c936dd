"""Kernels by name: every one deflects, says what it is, and is the same kernel in every file and for every angle."""

import re
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect import InputError, deflect
from sdm_deflect.cases.aircraft.registry import case_named, resolve
from sdm_deflect.cases.report.folder import settings_of
from sdm_deflect.cases.run.metrics import fit_text, kernel_text
from sdm_deflect.deform.rbf.fitting import KERNELS

HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


@pytest.fixture(scope="module")
def turned(block):
    """By kernel."""
    return {name: deflect(block, "body", HINGE, 10.0, kernel=name) for name in KERNELS}


@pytest.mark.parametrize("name", KERNELS)
def test_every_kernel_deflects_and_says_what_it_is(name, turned):
    result, figures = turned[name], turned[name].figures()
    sites, region = result.plan.boxes[0].sites, result.plan.boxes[0].region
    diagonal = np.linalg.norm(np.ptp(region.hexahedron.corners, axis=0))
    radius = {"mq": sites.edge, "wendland": diagonal}.get(name)
    assert result.passed
    assert figures["kernel"] == {"name": name, "radius": pytest.approx(radius), "polynomial": "linear"}
    assert all(1.0 < fit["condition"] < 1e8 for fit in figures["adaptation"].values())
    assert KERNELS[name].name in kernel_text(figures["kernel"])
    assert re.fullmatch(
        r"interpolation: centres .*; condition \S+, error at the sites \S+, between them .*", fit_text(figures)
    )
    assert figures["error_between_sites"]["max"] > figures["error_between_sites"]["p99"] > 0.0
    assert settings_of(result.deflection, Path(), Path())["kernel_radius"] == sites.radius


def test_a_run_takes_the_kernel_with_its_table_and_without():
    for text in ("kernel=wendland", "polynomial=none", "kernel_radius=0.1"):
        kernel = [] if text.startswith("kernel=") else ["kernel=wendland"]
        one, other = (resolve("aileron", assignments=[*kernel, before + text]) for before in ("", "adaptation."))
        assert one == other != case_named("aileron")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kernel": "gauss"}, "kernel = 'gauss' is not one of tps, mq, wendland, cubic"),
        ({"kernel": "cubic", "polynomial": "constant"}, "the cubic is conditionally positive definite of order 2 and"),
        ({"kernel": "mq", "polynomial": "none"}, "order 1 and needs polynomial = linear or constant"),
        ({"kernel_radius": 0.1}, r"kernel_radius = 0\.1: the thin plate spline has none; .* kernel = mq or wendland"),
        ({"kernel": "mq", "kernel_radius": -1.0}, r"kernel_radius = -1 must be a number of at least 0"),
        ({"kernel": "mq", "kernel_radius": 1e-300}, "kernel_radius = 1e-300 is out of range: .* median edge is"),
        ({"kernel": "wendland", "kernel_radius": 1e300}, r"1e\+300 is out of range: .* the diagonal of the box"),
        ({"kernel": "mq", "kernel_radius": 1e3}, "kernel = mq with kernel_radius = 1000: .* A smaller radius"),
    ],
)
def test_what_a_kernel_lacks_is_told_in_one_sentence(given, words, block):
    with pytest.raises(InputError, match=words) as caught:
        deflect(block, "body", HINGE, 10.0, **given)
    assert "\n" not in str(caught.value)


def test_the_narrower_the_support_the_less_a_node_far_away_moves(block):
    """Without a polynomial, Wendland's functions move nothing beyond their radius from the last centre."""
    options = {"kernel": "wendland", "polynomial": "none", "near_wall": False, "box": [[-1.9] * 3, [1.9] * 3]}
    far = np.flatnonzero(np.abs(block.points).max(axis=1) == 1.5)
    means = []
    for radius in (1.0, 2.0, 8.0):
        found = deflect(block, "body", HINGE, 10.0, kernel_radius=radius, **options)
        assert found.plan.boxes[0].sites.radius == radius
        means.append(np.abs(found.displacement[far]).mean())
    assert means[0] < 0.5 * means[1] < 0.5 * means[2]
