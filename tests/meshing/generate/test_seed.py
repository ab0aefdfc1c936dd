"""The same input and seed give the same mesh to the bit; where they cannot, the program says why."""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import LateError, MeshingError
from sdm_deflect.meshing.generate import generation
from sdm_deflect.meshing.generate.generation import generate

WORKER = "sdm_deflect.meshing.generate.volume_worker"
TRY = f"from {WORKER} import fix_seed; print(fix_seed(5))"


def said(before="", **environment):
    """What `fix_seed` says in a process that did something before."""
    words = [sys.executable, "-c", f"{before}\n{TRY}"]
    done = subprocess.run(words, env=os.environ | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


unseeded = pytest.mark.skipif(bool(said()), reason="the mesher cannot be seeded here")


@pytest.fixture(scope="module")
def question():
    """A ball in a cube of eight corners, coarse."""
    ball = trimesh.creation.icosphere(2, 0.3)
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    background = trimesh.creation.box((2.4, 2.4, 2.4)).vertices
    tets = np.array([[0, 1, 2, 4], [3, 1, 2, 7], [5, 1, 4, 7], [6, 2, 4, 7], [1, 2, 4, 7]])
    return {
        "points": np.concatenate([ball.vertices, corners]), "triangles": ball.faces,
        "background_points": background, "background_tets": tets, "background_lengths": np.full(8, 0.25),
        "envelope": np.array(1e-3), "energy": np.array(10.0), "threads": np.array(1), "seed": np.array(7),
    }  # fmt: skip


def filled(question, **changes):
    answer = child.call(WORKER, question | {name: np.array(value) for name, value in changes.items()}, 300.0)
    assert not str(answer["unseeded"])
    return answer["points"].tobytes() + answer["tets"].tobytes()


@unseeded
def test_equal_seeds_give_equal_bits_on_any_number_of_threads(question):
    first = filled(question)
    assert all(filled(question, threads=threads) == first for threads in (1, 2, 4))
    assert filled(question, seed=8) != first


@unseeded
def test_a_second_libstdcxx_is_told_and_not_seeded(tmp_path):
    """Such as conda's: nobody knows which of the two the mesher asks."""
    maps = Path("/proc/self/maps").read_text()
    known = next(Path(line.split()[-1]) for line in maps.splitlines() if "libstdc++" in line)
    copy = tmp_path / "libstdc++.so.7"
    copy.write_bytes(known.read_bytes().replace(b"libstdc++.so.6\0", b"libstdc++.so.7\0"))  # else it is the same one
    assert said(f"import ctypes; ctypes.CDLL({str(copy)!r})") == "the process has 2 libraries libstdc++"


@unseeded
@pytest.mark.parametrize(
    ("before", "why"),
    [
        ("import platform; platform.machine = lambda: 'aarch64'", "no seed on Linux aarch64"),
        (f"import {WORKER} as one; one.sys.platform = 'darwin'", "no seed on Linux x86_64"),
        (f"import {WORKER} as one; one.EXTENSIONS = {{'avx2', 'fma9'}}", "the processor lacks fma9"),
        (f"import {WORKER} as one; one.RANDOM_DEVICE = 'none_such'", "no std::random_device: "),
        (
            f"import ctypes, {WORKER} as one; load = ctypes.CDLL\n"
            "one.ctypes.CDLL = lambda name: load(name) if name else type('L', (), {'mprotect': lambda *_: -1})",
            "the system does not let a process change its code",
        ),
    ],
)
def test_where_there_is_no_seed_the_reason_is_told(before, why):
    assert said(before).startswith(why)


def test_a_further_attempt_has_the_next_seed_and_is_the_same_again(body, coarse, monkeypatch):
    """A planted refusal of the first attempt."""
    fill, seeds = generation.fill, []

    def refusing(surface, field, box, parameters):
        seeds.append(parameters.seed)
        if parameters.seed == 3:
            raise MeshingError("refused")
        return fill(surface, field, box, parameters)

    monkeypatch.setattr(generation, "fill", refusing)
    once, again = (generate(body, replace(coarse, seed=3)) for _ in range(2))
    assert seeds == [3, 4, 3, 4]
    assert once.report.rejected == ("refused",)
    if not once.report.unseeded:
        assert once.mesh.points.tobytes() == again.mesh.points.tobytes()


def test_an_attempt_that_takes_too_long_ends_the_run(body, coarse, monkeypatch):
    """Another one in its place would make the mesh depend on the clock."""
    tried = count()

    def late(*_):
        next(tried)
        raise LateError("the mesher took more than 9 s")

    monkeypatch.setattr(generation, "fill", late)
    with pytest.raises(LateError, match="took more than 9 s: allow more by max_seconds, or give another seed"):
        generate(body, coarse)
    assert next(tried) == 1
