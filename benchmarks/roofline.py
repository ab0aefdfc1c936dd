"""What the processor could do at most: multiplications with addition (FMA), all cores, nothing else."""

import ctypes

from benchmarks.peers import compiled

C_SOURCE = """
#include <stddef.h>
typedef double vector __attribute__((vector_size(64)));
void multiply_add(size_t rounds, double factor, double *sum) {
    double total = 0;
#pragma omp parallel reduction(+ : total)
    {
        vector a[CHAINS], s = {};
        for (int k = 0; k < CHAINS; k++) a[k] = s + k;
        for (size_t i = 0; i < rounds; i++)
#pragma GCC unroll 12
            for (int k = 0; k < CHAINS; k++) a[k] = a[k] * (s + factor) + factor;
        for (int k = 0; k < CHAINS; k++) total += a[k][0];
    }
    *sum = total;
}
"""
# Independent chains: as many as hide the latency of one FMA.
CHAINS = 12
ROUNDS = 20_000_000
# Operations of a thin plate spline in three directions: distance 3, logarithm 8, times r**2 1, directions 3.
PER_PAIR = 15


def multiply_adds() -> float:
    """Run them; return how many one thread did."""
    function, total = compiled(C_SOURCE.replace("CHAINS", str(CHAINS))).multiply_add, ctypes.c_double()
    function(ctypes.c_size_t(ROUNDS), ctypes.c_double(0.5), ctypes.byref(total))
    return 8.0 * CHAINS * ROUNDS
