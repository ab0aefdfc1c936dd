import time

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from sdm_deflect.base.threads import in_chunks, single_threaded_blas


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("rows", [0, 1, 7, 10_000])
def test_every_row_is_done_once(threads, rows):
    done = np.zeros(rows, dtype=int)

    def work(low, high):
        done[low:high] += 1

    in_chunks(work, rows, 10_000, threads)
    assert (done == 1).all()


def test_an_error_reaches_the_caller_and_stops_the_rest():
    calls = []

    def work(low, high):
        calls.append(low)
        if low == 0:
            raise RuntimeError("broken")
        time.sleep(0.01)

    with pytest.raises(RuntimeError, match="broken"):
        in_chunks(work, 1_000, 4_000_000, 2)
    assert len(calls) < 1_000


def test_blas_is_single_threaded_within():
    with single_threaded_blas():
        pools = [p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"]
    assert pools
    assert set(pools) == {1}
