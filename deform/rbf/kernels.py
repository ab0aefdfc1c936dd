"""Radial basis functions, and sums of them over centres.

A kernel is a function of the squared distance. It is used with a linear polynomial (eq. 2) unless another one is asked
for. The multiquadric would be solvable without (paper section 2.1), but the linear polynomial keeps plane faces plane
in the surface blending of appendix A.

A kernel is one class. The *type* of its named tuple of numbers (`Kernel.code`) selects the compiled formula, so the
loops over points and centres are written once. The logarithm is our own, because LLVM can vectorise it; it cannot
vectorise a call into the C library.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray
from scipy.special import xlogy

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.compiled import compiled, for_code, prefer_wide_vectors, tuple_setitem
from sdm_deflect.base.threads import Progress, in_chunks, silent

from .fitting import KernelName

# Numbers of columns for which loops are compiled; the narrowest that fits is used.
WIDTHS = (1, 3, 8)
# The centres are padded with weight zero to a multiple of this: whole vectors, no remainder loop.
PADDING = 32
# Number of centres summed at a time: they and their weights fit into a core's own cache.
BLOCK = 8_192
# log x = LOG_UNIT * scaled_log(x); callers take the constant out of their loops.
LOG_UNIT = float(np.log(2.0)) / 2.0**52

# The double sqrt(1/2) read as an integer.
SQRT_HALF_BITS = np.int64(0x3FE6A09E667F3BCD)
# A mask without the 52 bits of the mantissa.
EXPONENT_BITS = np.int64(-(2**52))

# Chebyshev interpolation of 2 artanh(t) / t in s = t**2 on [0, 0.02945]: relative error 1.8e-16.
C0, C1, C2, C3, C4, C5, C6 = (
    c / LOG_UNIT
    for c in (
        2.0000000000000004,
        0.6666666666655285,
        0.4000000006177087,
        0.2857141601619127,
        0.22223434911013043,
        0.1812192224220776,
        0.16837811516924603,
    )
)
# Compiled formulas by the type of their numbers.
FORMULAS: dict[Any, Callable[[Any, Any], Any]] = {}
# Name of the array in a file that holds the kernel's name.
KERNEL = "kernel"


@compiled
def scaled_log(x: float) -> float:  # pragma: no cover - machine code
    """Return 2**52 log2 x of a positive, normal x; relative error about 5e-16. Finite for x = 0.

    x = 2**e m with m in [sqrt(1/2), sqrt(2)), and log m = 2 artanh t with t = (m - 1)/(m + 1), |t| < 0.172. The
    bits of x less those of m are the integer 2**52 e, so the scale saves a shift and a multiplication.
    """
    bits = np.float64(x).view(np.int64)
    exponent = (bits - SQRT_HALF_BITS) & EXPONENT_BITS
    m = np.int64(bits - exponent).view(np.float64)
    t = (m - 1.0) / (m + 1.0)
    s = t * t
    p = C6
    p = p * s + C5
    p = p * s + C4
    p = p * s + C3
    p = p * s + C2
    p = p * s + C1
    p = p * s + C0
    return exponent + t * p


class Rescaling(NamedTuple):
    """phi(length * rho) = factor * kernel(rho) + square * rho**2: a kernel in another unit of length."""

    kernel: "Kernel"
    factor: float
    square: float


class Kernel:
    """A conditionally positive definite radial function, of order 2 or less up to its sign.

    Attributes
    ----------
    sign : +1 or -1: sign * phi is the conditionally positive definite one.
    unit : constant factor: phi = unit * formula; the loops leave it out.
    numbers : type of the named tuple of numbers in the formula.
    stored : name in files; empty for kernels that are not stored.
    """

    __slots__ = ()
    sign: ClassVar[float] = 1.0
    unit: ClassVar[float] = 1.0
    numbers: ClassVar[type]
    stored: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        FORMULAS[cls.numbers] = cls.formula

    @classmethod
    def of_radius(cls, radius: float) -> "Kernel":
        """Return the kernel with a radius; most kernels ignore it."""
        del radius
        return cls()

    def __call__(self, r2: FloatArray) -> FloatArray:
        """Return phi for squared distances r2 of any shape."""
        raise NotImplementedError

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:
        """Return phi / unit at a squared distance. Numba compiles it; the arguments must have these names."""
        raise NotImplementedError

    def code(self) -> tuple[float, ...]:
        """Return the numbers in the formula."""
        return cast(tuple[float, ...], self.numbers())

    def rescaled(self, length: float) -> Rescaling:
        """Return the kernel for distances measured in units of `length`."""
        raise NotImplementedError


class ThinPlateSplineCode(NamedTuple):
    """The thin plate spline has no numbers."""


@dataclass(frozen=True, slots=True)
class ThinPlateSpline(Kernel):
    """phi(r) = r**2 log r, zero at r = 0 (eq. 8)."""

    unit: ClassVar[float] = 0.5 * LOG_UNIT
    numbers: ClassVar[type] = ThinPlateSplineCode
    stored: ClassVar[str] = "thin_plate_spline"

    def __call__(self, r2: FloatArray) -> FloatArray:
        return np.asarray(0.5 * xlogy(r2, r2), dtype=np.float64)

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
        return r2 * scaled_log(r2)  # zero at r = 0 because the logarithm there is finite

    def rescaled(self, length: float) -> Rescaling:
        return Rescaling(self, length**2, length**2 * float(np.log(length)))


class MultiquadricCode(NamedTuple):
    """Numbers of the multiquadric."""

    epsilon2: float


@dataclass(frozen=True, slots=True)
class Multiquadric(Kernel):
    """phi(r) = sqrt(1 + (epsilon r)**2) (eq. 9).

    Parameters
    ----------
    epsilon : Shape parameter in 1/metre of the given coordinates. The paper takes 1e4, so that phi is linear in r to
        many digits.
    """

    epsilon: float
    sign: ClassVar[float] = -1.0
    numbers: ClassVar[type] = MultiquadricCode
    stored: ClassVar[str] = "multiquadric"

    def __post_init__(self) -> None:
        if not 0.0 < self.epsilon < np.inf:
            raise ValueError(f"epsilon = {self.epsilon} must be a positive number of 1/metre")

    @classmethod
    def of_radius(cls, radius: float) -> Kernel:
        return cls(1.0 / radius)

    def __call__(self, r2: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(1.0 + self.epsilon**2 * r2), dtype=np.float64)

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
        return math.sqrt(1.0 + code.epsilon2 * r2)

    def code(self) -> MultiquadricCode:
        return MultiquadricCode(self.epsilon**2)

    def rescaled(self, length: float) -> Rescaling:
        return Rescaling(Multiquadric(self.epsilon * length), 1.0, 0.0)


class WendlandC2Code(NamedTuple):
    """Numbers of Wendland's function."""

    inverse2: float  # 1 / radius**2


@dataclass(frozen=True, slots=True)
class WendlandC2(Kernel):
    """phi(r) = (1 - r / radius)**4 (4 r / radius + 1), zero beyond the radius (Wendland 1995, for three dimensions).

    Parameters
    ----------
    radius : Radius of the support, in metres of the given coordinates.
    """

    radius: float
    numbers: ClassVar[type] = WendlandC2Code
    stored: ClassVar[str] = "wendland_c2"

    def __post_init__(self) -> None:
        if not 0.0 < self.radius < np.inf:
            raise ValueError(f"radius = {self.radius} must be a positive length")

    @classmethod
    def of_radius(cls, radius: float) -> Kernel:
        return cls(radius)

    def __call__(self, r2: FloatArray) -> FloatArray:
        rho = np.sqrt(r2) / self.radius
        return np.asarray(np.maximum(1.0 - rho, 0.0) ** 4 * (4.0 * rho + 1.0), dtype=np.float64)

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
        rho = math.sqrt(r2 * code.inverse2)
        left = max(1.0 - rho, 0.0)
        return left * left * left * left * (4.0 * rho + 1.0)

    def code(self) -> WendlandC2Code:
        return WendlandC2Code(self.radius**-2)

    def rescaled(self, length: float) -> Rescaling:
        return Rescaling(WendlandC2(self.radius / length), 1.0, 0.0)


class CubicCode(NamedTuple):
    """The cubic has no numbers."""


@dataclass(frozen=True, slots=True)
class Cubic(Kernel):
    """phi(r) = r**3."""

    numbers: ClassVar[type] = CubicCode
    stored: ClassVar[str] = "cubic"

    def __call__(self, r2: FloatArray) -> FloatArray:
        return np.asarray(r2 * np.sqrt(r2), dtype=np.float64)

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
        return r2 * math.sqrt(r2)

    def rescaled(self, length: float) -> Rescaling:
        return Rescaling(self, length**3, 0.0)


def kernel_of(name: KernelName, radius: float) -> Kernel:
    """Return the kernel of a name in `Fitting`; `KERNELS` says whether it has a radius."""
    kinds: dict[KernelName, type[Kernel]] = {
        "tps": ThinPlateSpline, "mq": Multiquadric, "wendland": WendlandC2, "cubic": Cubic,
    }  # fmt: skip
    return kinds[name].of_radius(radius)


def arrays_of(kernel: Kernel, tag: str = "") -> dict[str, NDArray[Any]]:
    """Return the kernel's name and numbers as arrays, their names ending with a tag."""
    numbers = {f"kernel_{name}{tag}": np.array(value) for name, value in asdict(cast(Any, kernel)).items()}
    return {KERNEL: np.array(kernel.stored), **numbers}


def phi(code: tuple[float, ...], r2: float) -> float:
    """Return phi / unit at the squared distance r2, inside compiled loops only."""
    raise NotImplementedError("phi is compiled: call it from compiled code, or call the kernel itself")


def _formula(code: Any, r2: Any) -> Callable[[Any, Any], Any] | None:  # pragma: no cover - compiling
    """Return the formula for the type of `code`, when a loop is compiled."""
    return FORMULAS.get(getattr(code, "instance_class", None))


overload(phi, jit_options={"fastmath": True, "error_model": "numpy"})(_formula)


def kernel_sum(
    kernel: Kernel,
    points: FloatArray,
    centers: FloatArray,
    beta: FloatArray,
    alpha: FloatArray,
    *,
    threads: int | None = None,
    progress: Progress = silent,
) -> FloatArray:
    """Return alpha . [1, p] + sum_j beta_j phi(|p - c_j|), (N, k), for all columns at once.

    Parameters
    ----------
    kernel : The radial function, in the units of the coordinates.
    points : (N, 3) evaluation points.
    centers, beta, alpha : (C, 3), (C, k) and (4, k): centres, kernel and polynomial coefficients.
    threads : Number of threads; by default all. The result does not depend on it.
    """
    check_points(points=points, centers=centers)
    x = np.ascontiguousarray(points, dtype=np.float64)
    out = np.zeros((len(x), beta.shape[1]))
    code, b = kernel.code(), kernel.unit * beta.T
    sum_rows = for_code(_sum_rows, code)
    cuts = [slice(j, j + BLOCK) for j in range(0, max(1, len(centers)), BLOCK)]
    blocks = [_pad(centers[cut].T) for cut in cuts]

    def pass_over(part: slice) -> None:
        width = next(w for w in WIDTHS if w >= min(beta.shape[1] - part.start, WIDTHS[-1]))
        weights = [_pad(b[part, cut], width) for cut in cuts]
        a = np.ascontiguousarray(alpha[:, part].T)
        polynomials = [a, *(np.zeros_like(a) for _ in cuts[1:])]

        def chunk(low: int, high: int) -> None:
            for c, w, a in zip(blocks, weights, polynomials, strict=True):
                sum_rows(code, x[low:high], c, w, (0.0,) * width, a, out[low:high, part])

        in_chunks(chunk, len(x), len(centers), threads, progress)

    for k in range(0, beta.shape[1], WIDTHS[-1]):
        pass_over(slice(k, k + WIDTHS[-1]))
    return out


def kernel_matrix(kernel: Kernel, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return phi(|a_i - b_j|) as (M, N) for a (M, 3) and b (N, 3)."""
    check_points(a=a, b=b)
    out = np.empty((len(a), len(b)))
    x, y = np.ascontiguousarray(a), np.ascontiguousarray(b.T)
    code, unit = kernel.code(), kernel.unit
    matrix_rows = for_code(_matrix_rows, code)

    def chunk(low: int, high: int) -> None:
        matrix_rows(code, unit, x[low:high], y, out[low:high])

    in_chunks(chunk, len(a), len(b))
    return out


def check_points(**arrays: FloatArray) -> None:
    """Raise a ValueError for the first array that is not (N, 3): compiled loops do not check."""
    for name, array in arrays.items():
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"{name} {array.shape} must be (N, 3)")


def _pad(rows: FloatArray, count: int = 3) -> FloatArray:
    """Pad rows (k, C) with zeros to `count` rows and a multiple of `PADDING` columns."""
    out = np.zeros((count, -(-rows.shape[1] // PADDING) * PADDING))
    out[: len(rows), : rows.shape[1]] = rows
    return out


@compiled
def _sum_rows(
    code: Any, x: FloatArray, c: FloatArray, b: FloatArray, zeros: tuple[float, ...], a: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Add to out (N, k) the polynomials a (k, 4) and the sums at x (N, 3) over centres c (3, C) with weights b (w, C).

    The w sums of a point are a tuple, which LLVM keeps in registers; it interleaves the loop over the centres.
    """
    prefer_wide_vectors()
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        s = zeros
        for j in range(c.shape[1]):
            d0, d1, d2 = x0 - c[0, j], x1 - c[1, j], x2 - c[2, j]
            p = phi(code, d0 * d0 + d1 * d1 + d2 * d2)
            for k in range(len(zeros)):
                s = tuple_setitem(s, k, s[k] + b[k, j] * p)
        for k in range(len(a)):
            out[i, k] += s[k] + (a[k, 0] + a[k, 1] * x0 + a[k, 2] * x1 + a[k, 3] * x2)


@compiled
def _matrix_rows(
    code: Any, unit: float, x: FloatArray, y: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - machine code
    """Write phi between x (M, 3) and y (3, N) to out (M, N)."""
    prefer_wide_vectors()
    for i in range(len(x)):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        for j in range(y.shape[1]):
            d0, d1, d2 = x0 - y[0, j], x1 - y[1, j], x2 - y[2, j]
            out[i, j] = unit * phi(code, d0 * d0 + d1 * d1 + d2 * d2)
