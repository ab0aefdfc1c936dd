"""The child process that runs fTetWild; it receives triangles, seed points and a size field, and answers tetrahedra."""

import ctypes
import mmap
import platform
import sys
from pathlib import Path

import numpy as np
import pytetwild

from sdm_deflect.meshing.child import Arrays, serve

# The function of libstdc++ that gives std::random_device its numbers.
RANDOM_DEVICE = "_ZNSt13random_device9_M_getvalEv"
# Extensions of the processor that NumPy, SciPy and libm use for the mesher's input: without them its last bits differ.
EXTENSIONS = {"avx2", "fma"}
# Permissions of a page of memory, as in <sys/mman.h>.
READ, WRITE, EXECUTE = 1, 2, 4

# Below the smallest target length, so that the surface is never coarsened before the sizes apply.
IDEAL_EDGE = 0.7


def tetrahedralise(question: Arrays) -> Arrays:
    """Fill space around and inside triangles with tetrahedra.

    The question holds ``points`` (N, 3), of which unreferenced ones are seeds and domain corners; ``triangles``
    (T, 3); ``background_points``, ``background_tets``, ``background_lengths``: target edge lengths; ``envelope`` in
    metres; ``energy``: AMIPS energy 3 / Q at which a cell is left alone; ``threads``; ``seed``. The answer is
    ``points`` and ``tets``, positively oriented, and ``unseeded``: why the seed had no effect, or "".
    """
    unseeded = fix_seed(int(question["seed"]))
    points, lengths = question["points"], question["background_lengths"]
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    # With no ordinary passes only the bounded loop that applies the size field optimises; the ordinary
    # passes would use one size everywhere and refine without end.
    nodes, tets = pytetwild.tetrahedralize(
        points,
        question["triangles"].astype(np.int32),
        edge_length_abs=IDEAL_EDGE * float(lengths.min()),
        epsilon=float(question["envelope"]) / float(diagonal),
        stop_energy=float(question["energy"]),
        num_opt_iter=0,
        num_threads=int(question["threads"]),
        simplify=False,
        disable_filtering=True,
        vtk_ordering=True,
        bg_vertices=question["background_points"],
        bg_tets=question["background_tets"].astype(np.int32),
        bg_values=lengths,
        loglevel=6,
        quiet=True,
    )
    return {"points": nodes, "tets": tets, "unseeded": np.array(unseeded)}


def fix_seed(seed: int) -> str:
    """Give the mesher in this process a seed (32 bits); return why that is impossible, or "".

    fTetWild takes its seed from std::random_device and has no option for it. So that function's code in memory is
    replaced by "return seed". This needs Linux on x86-64, where the code is known, and a single libstdc++ in the
    process.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return f"no seed on {platform.system()} {platform.machine()}"
    processor = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    flags = next((line.split() for line in processor if line.startswith("flags")), [])
    if lacks := sorted(EXTENSIONS.difference(flags)):
        return f"the processor lacks {' and '.join(lacks)}"
    maps = [line.split(maxsplit=5) for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()]
    libraries = {entry[5] for entry in maps if len(entry) == 6 and "libstdc++" in entry[5]}
    if len(libraries) != 1:
        return f"the process has {len(libraries)} libraries libstdc++"
    try:
        start = ctypes.cast(getattr(ctypes.CDLL(libraries.pop()), RANDOM_DEVICE), ctypes.c_void_p).value or 0
    except (OSError, AttributeError) as error:
        return f"no std::random_device: {error}"
    code = b"\xb8" + seed.to_bytes(4, "little") + b"\xc3"  # mov eax, seed; ret
    first = start - start % mmap.PAGESIZE
    page, size = ctypes.c_void_p(first), ctypes.c_size_t(start + len(code) - first)
    protect = ctypes.CDLL(None).mprotect
    if protect(page, size, READ | WRITE | EXECUTE):
        return "the system does not let a process change its code"
    ctypes.memmove(start, code, len(code))
    protect(page, size, READ | EXECUTE)
    return ""


if __name__ == "__main__":
    serve(tetrahedralise)
