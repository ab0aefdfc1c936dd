"""The sum on a CUDA card, by Numba's simulator, and what is said where there is none."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.rbf import gpu
from sdm_deflect.deform.rbf.gpu import check_card
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import Cubic, Multiquadric, ThinPlateSpline, WendlandC2, kernel_sum

# More centres and points than a block of threads has, and neither a multiple of it.
SUMS = """
import json
import numpy as np
from sdm_deflect.deform.rbf.gpu import sum_on_card
from sdm_deflect.deform.rbf.kernels import Cubic, Multiquadric, ThinPlateSpline, WendlandC2, kernel_sum
rng = np.random.default_rng(5)
errors = {}
for kernel, columns in ((ThinPlateSpline(), 3), (Multiquadric(9.0), 1), (WendlandC2(0.7), 4), (Cubic(), 2)):
    x, c = rng.random((300, 3)), rng.random((300, 3))
    x[0] = c[7]
    beta, alpha = rng.normal(size=(300, columns)), rng.normal(size=(4, columns))
    here, there = (add(kernel, x, c, beta, alpha) for add in (kernel_sum, sum_on_card))
    errors[type(kernel).__name__] = float(np.abs(there - here).max() / np.abs(here).max())
print(json.dumps(errors))
"""


def test_the_simulated_card_sums_as_the_processor() -> None:
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_CUDA_WARN_ON_IMPLICIT_COPY": "0"}
    done = subprocess.run(
        [sys.executable, "-c", SUMS], env=environment, cwd=Path(__file__).parents[3], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    errors = json.loads(done.stdout)
    assert set(errors) == {"ThinPlateSpline", "Multiquadric", "WendlandC2", "Cubic"}
    assert max(errors.values()) < 1e-13


def test_numba_cuda_can_be_loaded_or_a_sentence_says_how_to_install_it() -> None:
    """With a NumPy that is too new for it its arrays cannot be loaded, which the simulator does not notice."""
    if find_spec("numba_cuda") is None:
        with pytest.raises(InputError, match=r"needs numba-cuda: in your clone, pip install '\.\[gpu\]'"):
            check_card()
    else:
        assert find_spec("numba.cuda.np.arrayobj") is not None
        from numba.cuda.np import arrayobj

        assert arrayobj.__name__ == "numba.cuda.np.arrayobj"


@pytest.mark.parametrize("kernel", [ThinPlateSpline(), Multiquadric(9.0), WendlandC2(0.7), Cubic()], ids=repr)
def test_an_interpolant_for_a_card_is_refused_without_one(kernel) -> None:
    zero = np.zeros((2, 3))
    with pytest.raises(InputError, match="processor = gpu"):
        Interpolant(kernel, np.eye(3)[:2], zero, np.zeros((4, 3)), "gpu")(zero)


def test_the_setting_reaches_the_sum_at_the_nodes(hybrid_wing, flap_names, monkeypatch: pytest.MonkeyPatch) -> None:
    sums = []

    def on_card(*terms):
        sums.append(len(terms[1]))
        return kernel_sum(*terms[:-1])

    monkeypatch.setattr(gpu, "check_card", lambda: None)
    monkeypatch.setattr(gpu, "sum_on_card", on_card)
    wing = hybrid_wing.mesh, flap_names, hybrid_wing.hinge
    here, there = (
        sdm_deflect.deflect(*wing, 5.0, motion="blended", fixed="wing*", processor=processor)
        for processor in ("cpu", "gpu")
    )
    assert np.array_equal(here.points, there.points)
    assert max(sums) > 100
