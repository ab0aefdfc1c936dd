"""OpenFOAM's programs run on a case, and what they print."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.extras import missing_program

NUMBER = r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
# Metrics that checkMesh lists, and how.
METRICS = {
    "aspect ratio": rf"Max aspect ratio = {NUMBER}",
    "openness": rf"Max cell openness = {NUMBER}",
    "face area": rf"Minimum face area = {NUMBER}",
    "volume": rf"Min volume = {NUMBER}",
    "non-orthogonality": rf"non-orthogonality Max: {NUMBER}",
    "mean non-orthogonality": rf"non-orthogonality Max: [\d.]+ average: {NUMBER}",
    "skewness": rf"Max skewness = {NUMBER}",
    "edge length": rf"Min/max edge length = {NUMBER}",
    "mean determinant": rf"Cell determinant .* average: {NUMBER}",
    "interpolation weight": rf"interpolation weight : minimum: {NUMBER}",
    "volume ratio": rf"volume ratio : minimum: {NUMBER}",
    "cells with small determinant": rf"small determinant .* number of cells: {NUMBER}",
}


def needed(*programs: str) -> None:
    """Skip the test where a program is not installed; in a pipeline (CI) it then fails."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(missing_program(program))


def run(program: str, case: Path, *words: str, ranks: int = 0) -> str:
    """Return what a program of OpenFOAM prints, in so many processes if `ranks` is given.

    Where it is not installed the test is skipped.
    """
    parallel = ["mpirun", "--oversubscribe", "-np", str(ranks)] if ranks else []
    needed(*parallel[:1], program)
    own = {
        "WM_PROJECT_DIR": "/usr/share/openfoam",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    done = subprocess.run(
        [*parallel, program, "-case", str(case.resolve()), *(["-parallel"] if ranks else []), *words],
        cwd=case,
        env=own | os.environ,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert "FOAM FATAL" not in done.stderr, done.stderr
    assert done.stdout.rstrip().endswith(("End", "Finalising parallel run")), done.stdout[-2000:] + done.stderr
    return done.stdout


def metrics(text: str) -> dict[str, float]:
    """Return the metrics in what ``checkMesh -allGeometry`` printed; 0 where a complaint is not made."""
    found = {name: re.search(pattern, text) for name, pattern in METRICS.items()}
    return {name: float(match[1]) if match else 0.0 for name, match in found.items()}


def complaints(text: str) -> list[str]:
    """Return the lines with three stars, without their numbers."""
    return [re.sub(r"[\d.]+", "#", line.strip()) for line in text.splitlines() if "***" in line]
