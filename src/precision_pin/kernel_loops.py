"""The compiled loops of the sampler: draw, derive, displace, compose, count.

All compiled code of the package stands in this one file (numba does not see that a cached function is stale when a
function it calls changes in another file). It knows nothing of robots: everything arrives as arrays, laid out by
:mod:`precision_pin.kernel_layout`.

Samples are worked on in *tiles* of `TILE`. One *row* of a workspace holds one quantity of a tile; rows stand `STRIDE`
doubles apart and are named by the offset of their first element, an unsigned integer (signed offsets make numba test
for negative indices, which keeps LLVM from vectorising). Sampled tiles hold the even units first, then the odd ones,
as Philox and Box-Muller give them; they are put in order only where a result leaves the tile.

Floating-point contraction (fused multiply-add) is allowed in `_gather`, `_turn_*` and `_logarithm` only. All else,
the random numbers and the sums included, is plain IEEE arithmetic in a written order, with no call of a mathematical
library, and so gives the same bits on every machine; exceptions are powers, sines and cosines in derived formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeVar

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from precision_pin.parameters import Operator
from precision_pin.statistics.sketch import BINS, OFFSET, SHIFT

__all__ = [
    "ANGLE",
    "ATOM",
    "DRAW",
    "EXACT",
    "FORMULA",
    "LINEAR",
    "NOT_FINITE",
    "SCRATCH",
    "STRIDE",
    "SUMS",
    "TILE",
    "Counting",
    "Draws",
    "Formulas",
    "Motions",
    "Superposition",
    "run",
]

Array = NDArray[np.float64]
Offsets = NDArray[np.uint64]
Compiled = TypeVar("Compiled", bound=Callable[..., Any])

TILE: Final = 256
"""Samples worked on together; even."""
STRIDE: Final = TILE + 8
"""Doubles from one row to the next; not a power of two, so that rows do not fall on the same cache lines."""
ATOM: Final = 1 << 14
"""Samples of one partial sum, that of :func:`precision_pin.statistics.observe`."""
LANES: Final = 16
SUMS: Final = 31
"""Partial sums of an atom: 8 residuals, 21 products of two components (upper triangle by rows), 2 squared norms."""

DRAW, LINEAR, EXACT = 0, 1, 2
"""How far a tile is worked on."""
FORMULA, ANGLE, NOT_FINITE = 1, 2, 3
"""Why a run stopped."""

# rows of the workspace's scratch part
_E: Final = 0
_Q: Final = 3
_H: Final = 7
_W: Final = 10
_VALUES: Final = 11
_RESIDUALS: Final = 19
_LANES: Final = 27
SCRATCH: Final = _LANES + -(-(SUMS + 16) * LANES // STRIDE)
"""Rows before the first parameter."""

_U = np.uint64
_TILE = _U(TILE)
_PAIRS = _U(TILE // 2)
_STRIDE = _U(STRIDE)
_ZERO, _ONE, _TWO, _TWELVE, _TWENTY, _HALF_WORD, _MANTISSA, _SIGN_FROM_TWO = (
    _U(k) for k in (0, 1, 2, 12, 20, 32, 52, 62)
)
_MULTIPLIER_0, _MULTIPLIER_1 = _U(0xD2511F53), _U(0xCD9E8D57)
_WEYL_0, _WEYL_1 = _U(0x9E3779B9), _U(0xBB67AE85)
_LOW = _U(0xFFFFFFFF)
_BITS_OF_ONE = _U(0x3FF0000000000000)
_HALF_STEP = 2.0**-53
_ROUND_TO_WHOLE = 1.5 * 2.0**52
_BITS_OF_2_52 = _U(0x4330000000000000)
_TURN = 2 * math.pi
_HALF_TURN_SQUARED = (math.pi / 2) ** 2
_FEWEST_TAIL = math.exp(-25.0)

_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _SQRT, _SIN, _COS = (int(operator) for operator in Operator)


class Draws(NamedTuple):
    """The components of a space by kind of law; every ``*rows`` are row offsets."""

    fixed_rows: Offsets
    fixed_values: Array
    stream_rows: Offsets
    streams: Offsets
    uniform_rows: Offsets
    uniform: Array
    """``(k, 2)`` mean, half-width."""
    triangular_rows: Offsets
    triangular: Array
    """``(k, 2)`` mean, half-width."""
    normal_rows: Offsets
    normal: Array
    """``(k, 2)`` mean, standard deviation."""
    truncated_rows: Offsets
    truncated: Array
    """``(k, 5)`` mean, standard deviation, k, Φ(-k), Φ(k) - Φ(-k)."""
    disc_rows: Offsets
    disc: Array
    """``(k,)`` radius; y stands one row after x."""
    circle_rows: Offsets
    circle: Array
    """``(k,)`` radius; y stands one row after x."""
    joint_rows: Offsets
    joint_roots: Array
    """``(k, m + 1, m)`` the mean, then the root of the covariance, padded to the largest m by zeros."""
    joint_sizes: Offsets


class Formulas(NamedTuple):
    """Derived parameters and the products of parameters."""

    operators: NDArray[np.int64]
    left: Offsets
    right: Offsets
    results: Offsets
    product_factors: Offsets
    """``(k, 2)``; a product of three is a product with the product of two."""
    products: Offsets


class Superposition(NamedTuple):
    """Six sums ``coefficient × row``: the entries of number c are ``starts[c] … starts[c + 1]``."""

    starts: Offsets
    rows: Offsets
    coefficients: Array


class Motions(NamedTuple):
    """The targets, tip first. Sums 6k … 6k+2 are target k's d, 6k+3 … 6k+5 half its δ, both in base axes."""

    starts: Offsets
    rows: Offsets
    coefficients: Array
    arms: Array
    """``(K, 3)`` from each pivot to the undisplaced tip, base axes."""
    wide: NDArray[np.int64]
    """``(K + 1,)`` which series: 1 where a target, or at last their product, may turn by more than 0.25 rad."""


class Counting(NamedTuple):
    """What is subtracted, how it is binned, and which limits are counted."""

    centre: Array
    inverse_scale: Array
    limit_rows: Offsets
    limits: Array


def _compiled(function: Compiled) -> Compiled:
    """Compile with plain IEEE arithmetic; a division by zero gives infinity, as in numpy."""
    compiled: Compiled = numba.njit(error_model="numpy", nogil=True)(function)
    return compiled


def _contracted(function: Compiled) -> Compiled:
    """Compile allowing fused multiply-add, and no other liberty: infinities and NaN stay what they are."""
    compiled: Compiled = numba.njit(error_model="numpy", nogil=True, fastmath={"contract"})(function)
    return compiled


def _cached(function: Compiled) -> Compiled:
    """Compile the outermost function, kept on disk; without a disk to keep it on, compiled in every process."""
    try:
        compiled: Compiled = numba.njit(error_model="numpy", nogil=True, cache=True)(function)
    except RuntimeError:  # neither the package nor the home can be written: numba refuses to cache
        return _compiled(function)
    return compiled


if numba.config.DISABLE_JIT:

    def _float_of(bits: Any) -> Any:
        return _U(bits).view(np.float64)

    def _bits_of(value: Any) -> Any:
        return np.float64(value).view(np.uint64)

else:

    @intrinsic  # type: ignore[untyped-decorator]
    def _float_of(context: Any, bits: Any) -> Any:
        """Return the double of 64 bits."""
        del context, bits

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.float64(numba.uint64), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def _bits_of(context: Any, value: Any) -> Any:
        """Return the 64 bits of a double."""
        del context, value

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.uint64(numba.float64), generate


# random numbers ----------------------------------------------------------------------------------------------------


@_compiled
def uniforms(w, rows, streams, words, seed, first_pair):  # type: ignore[no-untyped-def]
    """Fill rows with uniform numbers, as `precision_pin.philox.uniforms`: even units first, then odd ones."""
    bits = w.view(np.uint64)
    for k in range(rows.size):
        row, stream, word = rows[k], streams[k], words[k]
        for i in range(_PAIRS):
            pair = first_pair + i
            c0, c1, c2, c3 = pair, pair >> _HALF_WORD, stream, word
            key_0, key_1 = seed & _LOW, seed >> _HALF_WORD
            # only the low halves of the words count; the high ones hold what the multiplication left
            for _ in range(10):
                first = _MULTIPLIER_0 * (c0 & _LOW)
                second = _MULTIPLIER_1 * (c2 & _LOW)
                c0, c1, c2, c3 = (second >> _HALF_WORD) ^ c1 ^ key_0, second, (first >> _HALF_WORD) ^ c3 ^ key_1, first
                key_0 = (key_0 + _WEYL_0) & _LOW
                key_1 = (key_1 + _WEYL_1) & _LOW
            bits[row + i] = (((c0 & _LOW) | (c1 << _HALF_WORD)) >> _TWELVE) | _BITS_OF_ONE
            bits[row + _PAIRS + i] = (((c2 & _LOW) | (c3 << _HALF_WORD)) >> _TWELVE) | _BITS_OF_ONE
        for i in range(_TILE):
            w[row + i] = (w[row + i] - 1.0) + _HALF_STEP


@_compiled
def logarithm(x):  # type: ignore[no-untyped-def]
    """Return log x of a normal number, within 1 ulp; the method and coefficients of fdlibm's e_log.c."""
    shifted = _bits_of(x) + _U(0x00095F6200000000)
    exponent = _float_of((shifted >> _MANTISSA) | _BITS_OF_2_52) - (2.0**52 + 1023.0)
    f = _float_of((shifted & _U(0x000FFFFFFFFFFFFF)) + _U(0x3FE6A09E00000000)) - 1.0
    half_square = 0.5 * f * f
    s = f / (2.0 + f)
    z = s * s
    v = z * z
    even = v * (3.999999999940941908e-01 + v * (2.222219843214978396e-01 + v * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + v * (2.857142874366239149e-01 + v * (1.818357216161805012e-01 + v * 1.479819860511658591e-01))
    )
    tail = s * (half_square + (even + odd)) + exponent * 1.90821492927058770002e-10
    return tail - half_square + f + exponent * 6.93147180369123816490e-01


@_compiled
def sine_and_cosine(t):  # type: ignore[no-untyped-def]
    """Return sin t and cos t for 0 ≤ t ≤ 2π, within 1 ulp; coefficients of fdlibm's k_sin.c and k_cos.c."""
    rounded = t * (2 / math.pi) + _ROUND_TO_WHOLE
    quarter = _bits_of(rounded)
    k = rounded - _ROUND_TO_WHOLE
    # t - k·π/2 with π/2 in three parts of which k times the first two is exact; the rest stays apart
    coarse = t - k * 1.57079632673412561417e00
    fine = k * 6.07710050630396597660e-11
    r = coarse - fine
    rest = ((coarse - r) - fine) - k * 2.02226624879595063154e-21
    z = r * r
    p = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    v = z * r
    s = r - ((z * (0.5 * rest - v * p) - rest) - v * -1.66666666666666324348e-01)
    p = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z
                * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))
            )
        )
    )
    half = 0.5 * z
    u = 1.0 - half
    c = u + (((1.0 - u) - half) + (z * p - r * rest))
    swap = (quarter & _ONE) != _ZERO
    sine = c if swap else s
    cosine = s if swap else c
    sine = _float_of(_bits_of(sine) ^ ((quarter & _TWO) << _SIGN_FROM_TWO))
    cosine = _float_of(_bits_of(cosine) ^ (((quarter + _ONE) & _TWO) << _SIGN_FROM_TWO))
    return sine, cosine


@_compiled
def normal_score(p):  # type: ignore[no-untyped-def]
    """Return Φ⁻¹(p) for e⁻²⁵ ≤ p ≤ 0.575: algorithm AS 241 (Wichura, Applied Statistics 37, 1988), PPND16."""
    q = p - 0.5
    r = 0.180625 - q * q
    numerator = q * (
        3.3871328727963666080e0
        + r
        * (
            1.3314166789178437745e2
            + r
            * (
                1.9715909503065514427e3
                + r
                * (
                    1.3731693765509461125e4
                    + r
                    * (
                        4.5921953931549871457e4
                        + r * (6.7265770927008700853e4 + r * (3.3430575583588128105e4 + r * 2.5090809287301226727e3))
                    )
                )
            )
        )
    )
    denominator = 1.0 + r * (
        4.2313330701600911252e1
        + r
        * (
            6.8718700749205790830e2
            + r
            * (
                5.3941960214247511077e3
                + r
                * (
                    2.1213794301586595867e4
                    + r * (3.9307895800092710610e4 + r * (2.8729085735721942674e4 + r * 5.2264952788528545610e3))
                )
            )
        )
    )
    r = np.sqrt(-logarithm(p)) - 1.6
    tail_numerator = -(
        1.42343711074968357734e0
        + r
        * (
            4.63033784615654529590e0
            + r
            * (
                5.76949722146069140550e0
                + r
                * (
                    3.64784832476320460504e0
                    + r
                    * (
                        1.27045825245236838258e0
                        + r * (2.41780725177450611770e-1 + r * (2.27238449892691845833e-2 + r * 7.74545014278341407640e-4))
                    )
                )
            )
        )
    )
    tail_denominator = 1.0 + r * (
        2.05319162663775882187e0
        + r
        * (
            1.67638483018380384940e0
            + r
            * (
                6.89767334985100004550e-1
                + r
                * (
                    1.48103976427480074590e-1
                    + r * (1.51986665636164571966e-2 + r * (5.47593808499534494600e-4 + r * 1.05075007164441684324e-9))
                )
            )
        )
    )
    central = q >= -0.425
    return (numerator if central else tail_numerator) / (denominator if central else tail_denominator)


@_compiled
def far_normal_score(p):  # type: ignore[no-untyped-def]
    """Return Φ⁻¹(p) for p < e⁻²⁵, by the same algorithm."""
    r = np.sqrt(-logarithm(p)) - 5.0
    numerator = 6.65790464350110377720e0 + r * (
        5.46378491116411436990e0
        + r
        * (
            1.78482653991729133580e0
            + r
            * (
                2.96560571828504891230e-1
                + r
                * (
                    2.65321895265761230930e-2
                    + r * (1.24266094738807843860e-3 + r * (2.71155556874348757815e-5 + r * 2.01033439929228813265e-7))
                )
            )
        )
    )
    denominator = 1.0 + r * (
        5.99832206555887937690e-1
        + r
        * (
            1.36929880922735805310e-1
            + r
            * (
                1.48753612908506148525e-2
                + r
                * (
                    7.86869131145613259100e-4
                    + r * (1.84631831751005468180e-5 + r * (1.42151175831644588870e-7 + r * 2.04426310338993978564e-15))
                )
            )
        )
    )
    return -numerator / denominator


@_compiled
def normals(w, row):  # type: ignore[no-untyped-def]
    """Turn a row of uniform numbers into standard normal ones: Box-Muller of each pair (even unit, odd unit)."""
    for i in range(_PAIRS):
        reach = np.sqrt(-2.0 * logarithm(w[row + i]))
        sine, cosine = sine_and_cosine(_TURN * w[row + _PAIRS + i])
        w[row + i] = reach * cosine
        w[row + _PAIRS + i] = reach * sine


@_compiled
def uniform_law(w, row, mean, half_width):  # type: ignore[no-untyped-def]
    """Turn uniform numbers into `precision_pin.laws.Uniform`."""
    for i in range(_TILE):
        w[row + i] = mean + half_width * (2.0 * w[row + i] - 1.0)


@_compiled
def triangular_law(w, row, mean, half_width):  # type: ignore[no-untyped-def]
    """Turn uniform numbers into `precision_pin.laws.Triangular`."""
    for i in range(_TILE):
        u = w[row + i]
        tail = u if u < 0.5 else 1.0 - u
        size = 1.0 - np.sqrt(2.0 * tail)
        w[row + i] = mean + half_width * (size if u > 0.5 else -size)


@_compiled
def truncated_law(w, row, mean, std, k, cut, share):  # type: ignore[no-untyped-def]
    """Turn uniform numbers into `precision_pin.laws.TruncatedNormal`."""
    far = 0
    for i in range(_TILE):
        u = w[row + i]
        p = cut + (u if u < 0.5 else 1.0 - u) * share
        far += 1 if p < _FEWEST_TAIL else 0
    if far:  # about once in 10¹¹ numbers, so that the others do not pay for it
        for i in range(_TILE):
            u = w[row + i]
            p = cut + (u if u < 0.5 else 1.0 - u) * share
            score = far_normal_score(p) if p < _FEWEST_TAIL else normal_score(p)
            size = std * (-score if -score < k else k)
            w[row + i] = mean + (size if u > 0.5 else -size)
    else:
        for i in range(_TILE):
            u = w[row + i]
            score = normal_score(cut + (u if u < 0.5 else 1.0 - u) * share)
            size = std * (-score if -score < k else k)
            w[row + i] = mean + (size if u > 0.5 else -size)


@_compiled
def disc_law(w, row, radius):  # type: ignore[no-untyped-def]
    """Turn two rows of uniform numbers into `precision_pin.laws.Disc`."""
    for i in range(_TILE):
        reach = radius * np.sqrt(w[row + i])
        sine, cosine = sine_and_cosine(_TURN * w[row + _STRIDE + i])
        w[row + i] = reach * cosine
        w[row + _STRIDE + i] = reach * sine


@_compiled
def circle_law(w, row, radius):  # type: ignore[no-untyped-def]
    """Turn the second of two rows of uniform numbers into `precision_pin.laws.Circle`."""
    for i in range(_TILE):
        sine, cosine = sine_and_cosine(_TURN * w[row + _STRIDE + i])
        w[row + i] = radius * cosine
        w[row + _STRIDE + i] = radius * sine


@_compiled
def joint_law(w, row, size, root):  # type: ignore[no-untyped-def]
    """Turn rows of standard normal numbers into `precision_pin.laws.JointNormal`, the last row first."""
    for back in range(size):
        k = size - _ONE - _U(back)
        target = row + k * _STRIDE
        own = root[k + _ONE, k]
        for i in range(_TILE):
            w[target + i] = own * w[target + i]
        for j in range(k):
            other = row + _U(j) * _STRIDE
            factor = root[k + _ONE, j]
            for i in range(_TILE):
                w[target + i] += factor * w[other + i]
        mean = root[_ZERO, k]
        for i in range(_TILE):
            w[target + i] += mean


@_compiled
def apply_laws(w, draws):  # type: ignore[no-untyped-def]
    """Turn the rows of uniform numbers into the components of the space."""
    for k in range(draws.uniform_rows.size):
        uniform_law(w, draws.uniform_rows[k], draws.uniform[k, 0], draws.uniform[k, 1])
    for k in range(draws.triangular_rows.size):
        triangular_law(w, draws.triangular_rows[k], draws.triangular[k, 0], draws.triangular[k, 1])
    for k in range(draws.normal_rows.size):
        row = draws.normal_rows[k]
        normals(w, row)
        mean, std = draws.normal[k, 0], draws.normal[k, 1]
        for i in range(_TILE):
            w[row + i] = mean + std * w[row + i]
    for k in range(draws.truncated_rows.size):
        law = draws.truncated[k]
        truncated_law(w, draws.truncated_rows[k], law[0], law[1], law[2], law[3], law[4])
    for k in range(draws.disc_rows.size):
        disc_law(w, draws.disc_rows[k], draws.disc[k])
    for k in range(draws.circle_rows.size):
        circle_law(w, draws.circle_rows[k], draws.circle[k])
    for k in range(draws.joint_rows.size):
        row, size = draws.joint_rows[k], draws.joint_sizes[k]
        for j in range(size):
            normals(w, row + _U(j) * _STRIDE)
        joint_law(w, row, size, draws.joint_roots[k])


# derived parameters and products -------------------------------------------------------------------------------------


@_compiled
def _derive(w, formulas):  # type: ignore[no-untyped-def]
    """Evaluate the operations and products; return how many results are not finite."""
    failures = 0
    for step in range(formulas.operators.size):
        operator = formulas.operators[step]
        a, b, result = formulas.left[step], formulas.right[step], formulas.results[step]
        if operator == _ADD:
            for i in range(_TILE):
                w[result + i] = w[a + i] + w[b + i]
        elif operator == _SUBTRACT:
            for i in range(_TILE):
                w[result + i] = w[a + i] - w[b + i]
        elif operator == _MULTIPLY:
            for i in range(_TILE):
                w[result + i] = w[a + i] * w[b + i]
        elif operator == _DIVIDE:
            for i in range(_TILE):
                w[result + i] = w[a + i] / w[b + i]
        elif operator == _POWER:
            for i in range(_TILE):
                w[result + i] = w[a + i] ** w[b + i]
        elif operator == _SQRT:
            for i in range(_TILE):
                w[result + i] = np.sqrt(w[a + i])
        elif operator == _SIN:
            for i in range(_TILE):
                w[result + i] = np.sin(w[a + i])
        elif operator == _COS:
            for i in range(_TILE):
                w[result + i] = np.cos(w[a + i])
        for i in range(_TILE):
            failures += 0 if abs(w[result + i]) < np.inf else 1
    for k in range(formulas.products.size):
        a, b, result = formulas.product_factors[k, 0], formulas.product_factors[k, 1], formulas.products[k]
        for i in range(_TILE):
            w[result + i] = w[a + i] * w[b + i]
    return failures


# displacing the chain ------------------------------------------------------------------------------------------------


@_contracted
def _gather(w, result, start, stop, rows, coefficients, fresh):  # type: ignore[no-untyped-def]
    """Add up ``coefficient × row`` into a row, from zero if it is fresh."""
    k = start
    if fresh:
        if start == stop:
            for i in range(_TILE):
                w[result + i] = 0.0
        elif stop - start >= _U(4):
            a, b, c, d = rows[k], rows[k + _U(1)], rows[k + _U(2)], rows[k + _U(3)]
            p, q = coefficients[k], coefficients[k + _U(1)]
            r, s = coefficients[k + _U(2)], coefficients[k + _U(3)]
            for i in range(_TILE):
                w[result + i] = p * w[a + i] + q * w[b + i] + r * w[c + i] + s * w[d + i]
            k += _U(4)
        else:
            a, p = rows[k], coefficients[k]
            for i in range(_TILE):
                w[result + i] = p * w[a + i]
            k += _U(1)
    while stop - k >= _U(4):
        a, b, c, d = rows[k], rows[k + _U(1)], rows[k + _U(2)], rows[k + _U(3)]
        p, q = coefficients[k], coefficients[k + _U(1)]
        r, s = coefficients[k + _U(2)], coefficients[k + _U(3)]
        for i in range(_TILE):
            w[result + i] += p * w[a + i] + q * w[b + i] + r * w[c + i] + s * w[d + i]
        k += _U(4)
    if stop - k >= _U(2):
        a, b, p, q = rows[k], rows[k + _U(1)], coefficients[k], coefficients[k + _U(1)]
        for i in range(_TILE):
            w[result + i] += p * w[a + i] + q * w[b + i]
        k += _U(2)
    if k < stop:
        a, p = rows[k], coefficients[k]
        for i in range(_TILE):
            w[result + i] += p * w[a + i]


@_contracted
def _turn_narrow(w):  # type: ignore[no-untyped-def]
    """Turn the half rotation vector h (rows _H) into the quaternion (row _W, rows _H): Taylor, |h| ≤ 0.125."""
    for i in range(_TILE):
        x, y, z = w[_H * STRIDE + i], w[(_H + 1) * STRIDE + i], w[(_H + 2) * STRIDE + i]
        s = x * x + y * y + z * z
        cosine = 1.0 - s / 2 * (1.0 - s / 12 * (1.0 - s / 30 * (1.0 - s / 56)))
        w[_H * STRIDE + i] = x
        w[_W * STRIDE + i] = cosine
