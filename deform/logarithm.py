"""A natural logarithm that the compiler can vectorise."""

import numpy as np

from deform.compiled import compiled

LOG_2 = 0.6931471805599453
MANTISSA_BITS = np.int64(52)
SQRT_HALF_BITS = np.int64(0x3FE6A09E667F3BCD)  # the double sqrt(1/2) read as an integer


@compiled
def log(x: float) -> float:  # pragma: no cover - machine code
    """Natural logarithm of a positive, normal x; relative error about 3e-16.

    x = 2**e m with m in [sqrt(1/2), sqrt(2)), and log m = 2 artanh t with t = (m - 1)/(m + 1), |t| < 0.172.
    The library's logarithm is a call for each number and costs seven times as much.
    """
    bits = np.float64(x).view(np.int64)
    exponent = (bits - SQRT_HALF_BITS) >> MANTISSA_BITS
    m = np.int64(bits - (exponent << MANTISSA_BITS)).view(np.float64)
    t = (m - 1.0) / (m + 1.0)
    s = t * t
    p = 1.0 / 19.0
    p = p * s + 1.0 / 17.0
    p = p * s + 1.0 / 15.0
    p = p * s + 1.0 / 13.0
    p = p * s + 1.0 / 11.0
    p = p * s + 1.0 / 9.0
    p = p * s + 1.0 / 7.0
    p = p * s + 1.0 / 5.0
    p = p * s + 1.0 / 3.0
    return exponent * LOG_2 + 2.0 * t * (1.0 + s * p)
