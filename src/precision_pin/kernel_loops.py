"""The compiled loops of the sampler: draw, derive, displace, compose, count.

All compiled code of the package stands in this one file (numba does not see that a cached function is stale when a
function it calls changes in another file). It knows nothing of robots: everything arrives as arrays, laid out by
:mod:`precision_pin.kernel_layout`.

Samples are worked on in *tiles* of `TILE`. One *row* of a workspace holds one quantity of a tile; rows stand `STRIDE`
doubles apart and are named by the offset of their first element, an unsigned integer (signed offsets make numba test
for negative indices, which keeps LLVM from vectorising). Sampled tiles hold the even units first, then the odd ones,
as Philox and Box-Muller give them; they are put in order only where a result leaves the tile.

Floating-point contraction (fused multiply-add) is allowed in what is marked `contracted` only: logarithms, normal
numbers, discs' directions, displacements. All else, uniform numbers and sums included, is plain IEEE arithmetic in a
written order. No mathematical library is called but for powers, sines and cosines in derived formulas. So bits are the
same on machines of one type, and numbers within rounding on others.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from precision_pin.compiled import INTERPRETED, contracted, kept, plain

__all__ = [
    "ANGLE",
    "ATOM",
    "DRAW",
    "EXACT",
    "FORMULA",
    "LANE_DOUBLES",
    "LARGEST",
    "LINEAR",
    "NORM_COLUMNS",
    "NORM_EXPONENTS",
    "NORM_MANTISSA",
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
    "run_poses",
]

Array = NDArray[np.float64]
Offsets = NDArray[np.uint64]
Scalar = Any
"""A number inside compiled code: an offset (np.uint64), an index or a double."""

TILE: Final = 256
"""Samples worked on together."""
STRIDE: Final = TILE + 8
"""Doubles from one row to the next; not a power of two, so that rows do not fall on the same cache lines."""
ATOM: Final = 1 << 14
"""Samples of one partial sum, that of :func:`precision_pin.statistics.observe`."""
LANES: Final = 16
LARGEST: Final = 10
"""How many of the largest errors are kept."""
SUMS: Final = 31
"""Partial sums of an atom: 8 residuals, 21 products of two components (upper triangle by rows), 2 squared norms."""

LANE_DOUBLES: Final = (SUMS + 16) * LANES
"""What a pose's lanes take: those of the sums, of the eight smallest and of the eight largest values."""

NORM_MANTISSA: Final = 5
NORM_EXPONENTS: Final = (-4, 4)
NORM_COLUMNS: Final = 2 * (1 + ((NORM_EXPONENTS[1] - NORM_EXPONENTS[0]) << NORM_MANTISSA))
"""Columns of the small sketch of a norm, 514: as the large one, with 32 bins an octave and eight octaves on each side."""

DRAW, LINEAR, EXACT = 0, 1, 2
"""How far a tile is worked on."""
FORMULA, ANGLE, NOT_FINITE = 1, 2, 3
"""Why a run stopped."""

_U = np.uint64

# rows of the workspace's scratch part: tip displacement, quaternion (w, x, y, z), one target's rotation (x, y, z, w)
_E0, _E1, _E2, _Q0, _Q1, _Q2, _Q3, _H0, _H1, _H2, _HW = (_U(row * STRIDE) for row in range(11))
_VALUES: Final = _U(11 * STRIDE)
_RESIDUALS: Final = _U(19 * STRIDE)
_LANES: Final = _U(27 * STRIDE)
_R0, _R1, _R2, _R3, _R4, _R5, _R6, _R7 = (_RESIDUALS + _U(q * STRIDE) for q in range(8))
(
    _P0, _P1, _P2, _P3, _P4, _P5, _P6, _P7, _P8, _P9, _P10, _P11, _P12, _P13, _P14, _P15, _P16, _P17, _P18, _P19, _P20,
    _P21, _P22,
) = (_LANES + _U((8 + k) * LANES) for k in range(23))  # fmt: skip
SCRATCH: Final = 27 + -(-(SUMS + 16) * LANES // STRIDE)
"""Rows before the first parameter."""

_TILE = _U(TILE)
_PAIRS = _U(TILE // 2)
_EIGHTH = _U(TILE // 8)
_STRIDE = _U(STRIDE)
_ZERO, _ONE, _TWO, _THREE, _FOUR, _TWELVE, _HALF_WORD, _MANTISSA, _SIGN_FROM_TWO = (
    _U(k) for k in (0, 1, 2, 3, 4, 12, 32, 52, 62)
)
_MULTIPLIER_0, _MULTIPLIER_1 = _U(0xD2511F53), _U(0xCD9E8D57)
_WEYL_0, _WEYL_1 = _U(0x9E3779B9), _U(0xBB67AE85)
_LOW = _U(0xFFFFFFFF)
_BITS_OF_ONE = _U(0x3FF0000000000000)
_HALF_STEP = 2.0**-53
_ROUND_TO_WHOLE = 1.5 * 2.0**52
_BITS_OF_2_52 = _U(0x4330000000000000)
_QUARTER_TURN_SQUARED = (math.pi / 2) ** 2
_FAR_TAIL = math.exp(-25.0)
_HIGH_HALF = _U(0xFFFFFFFFF8000000)
_BIAS = _U(1023)

# polynomials, highest power first
# (2 artanh(√z)/√z - 2)/z up to z = 0.0295, sin(2π√z)/√z and cos(2π√z) up to z = 1/64, within 5e-18 of their values:
# interpolated at Chebyshev nodes
_ARTANH = (
    0.1461645239982644, 0.15331721380921012, 0.18182889131869306, 0.2222221113470439, 0.2857142862597604,
    0.39999999999899505, 0.666666666666667,
)  # fmt: skip
_SINE = (
    3.7808689593022566, -15.093804209987113, 42.058685020160894, -76.70585970427454, 81.60524927594804,
    -41.341702240399634, 6.283185307179586,
)  # fmt: skip
_COSINE = (
    -1.6990343940660484, 7.9032069115696775, -26.426253275854723, 60.24464135270201, -85.4568172066438,
    64.93939402266824, -19.739208802178716, 1.0,
)  # fmt: skip
_CENTRE = (
    2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4, 4.5921953931549871457e4,
    1.3731693765509461125e4, 1.9715909503065514427e3, 1.3314166789178437745e2, 3.3871328727963666080e0,
)  # fmt: skip
_CENTRE_BELOW = (
    5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4, 2.1213794301586595867e4,
    5.3941960214247511077e3, 6.8718700749205790830e2, 4.2313330701600911252e1, 1.0,
)  # fmt: skip
_TAIL = (
    7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1, 1.27045825245236838258e0,
    3.64784832476320460504e0, 5.76949722146069140550e0, 4.63033784615654529590e0, 1.42343711074968357734e0,
)  # fmt: skip
_TAIL_BELOW = (
    1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2, 1.48103976427480074590e-1,
    6.89767334985100004550e-1, 1.67638483018380384940e0, 2.05319162663775882187e0, 1.0,
)  # fmt: skip
_FAR = (
    2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3, 2.65321895265761230930e-2,
    2.96560571828504891230e-1, 1.78482653991729133580e0, 5.46378491116411436990e0, 6.65790464350110377720e0,
)  # fmt: skip
_FAR_BELOW = (
    2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5, 7.86869131145613259100e-4,
    1.48753612908506148525e-2, 1.36929880922735805310e-1, 5.99832206555887937690e-1, 1.0,
)  # fmt: skip
_EXPONENTIAL = (
    4.13813679705723846039e-08, -1.65339022054652515390e-06, 6.61375632143793436117e-05,
    -2.77777777770155933842e-03, 1.66666666666666019037e-01,
)  # fmt: skip
# Φ(-z) exp(z²/2), 0 ≤ z ≤ 8.65, within 2.6e-18 of itself: interpolated at Chebyshev nodes of (z - 2.5)/(z + 2.5)
_MILLS = (
    0.398942277294474654756, 12.6671510236808289922, 191.785311942068851348, 1807.15013551905889277,
    11648.2058378305628335, 53256.6653173253926117, 173206.594692038836659, 389109.250073612829344,
    555453.844886661102395, 397174.710960185426643,
)  # fmt: skip
_MILLS_BELOW = (
    1.0, 31.7518382136494508159, 481.734516006812416409, 4561.60461497557840297, 29676.4737803928290264,
    137960.744566166715363, 462414.16719060097007, 1100069.97552553588879, 1773118.43149761954608,
    1744706.82940626728931, 794349.421920370853286,
)  # fmt: skip
# Taylor series of cos √s, sin √s/√s and atan √t/√t
_SHORT_COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(5, -1, -1))
_SHORT_SINC = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(4, -1, -1))
_LONG_COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(11, -1, -1))
_LONG_SINC = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(11, -1, -1))
_SHORT_ARC = tuple((-1) ** k / (2 * k + 1) for k in range(6, -1, -1))
_LONG_ARC = tuple((-1) ** k / (2 * k + 1) for k in range(20, -1, -1))

# numbers of other files are repeated here, not imported: numba would not see them change; a test compares them
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _SQRT, _SIN, _COS = range(8)  # precision_pin.parameters.Operator
_SHIFT, _OFFSET, _BINS = 43, 1011 << 9, 10_241  # precision_pin.statistics.sketch
_FARTHEST = 8.6  # precision_pin.laws.FARTHEST_NORMAL

_NORM_SHIFT = _U(52 - NORM_MANTISSA)
_NORM_OFFSET = _U(((1023 + NORM_EXPONENTS[0]) << NORM_MANTISSA) - 1)
_NORM_LAST = _U(NORM_COLUMNS // 2 - 1)


class Draws(NamedTuple):
    """The components of a space by kind of law; every ``*rows`` are row offsets."""

    fixed_rows: Offsets
    fixed_values: Array
    stream_rows: Offsets
    streams: Offsets
    score_rows: Offsets
    """Which become standard normal numbers, but for the rows of joint normal laws."""
    group_starts: Offsets
    """Correlated rows: those of group g are ``group_rows[starts[g] … starts[g + 1]]``."""
    group_rows: Offsets
    group_roots: Array
    """``(groups, m, m)`` root of the scores' correlation, padded to the largest m by zeros."""
    cumulated_rows: Offsets
    """Which become uniform numbers again."""
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
    lognormal_rows: Offsets
    lognormal: Array
    """``(k, 3)`` mean, σ of the logarithm, σ²/2."""
    arcsine_rows: Offsets
    arcsine: Array
    """``(k, 2)`` mean, half-width."""
    two_point_rows: Offsets
    two_point: Array
    """``(k, 3)`` centre, half-width, threshold."""
    empirical_rows: Offsets
    empirical_starts: Offsets
    """The lines of law k are ``empirical[starts[k] … starts[k + 1]]``."""
    empirical: Array
    """``(lines, 4)`` probability and value at which each begins, slope, value at its end."""
    table_rows: Offsets
    table_shapes: Offsets
    """``(k, 3)`` numbers in a row, rows, position of the first number in ``table``."""
    table: Array


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
    """The linear model's two vectors as sums ``coefficients × row``, see `Motions`."""

    shift_rows: Offsets
    shifts: Array
    turn_rows: Offsets
    turns: Array


class Motions(NamedTuple):
    """The targets, tip first: of each two vectors in base axes, d and half its δ, as sums ``coefficients × row``.

    Those of target k are entries ``starts[k] … starts[k + 1] - 1``, filled up with coefficients of zero until three
    or none are left after passes of four.
    """

    shift_starts: Offsets
    shift_rows: Offsets
    shifts: Array
    """``(entries, 3)``."""
    turn_starts: Offsets
    turn_rows: Offsets
    turns: Array
    """``(entries, 3)``."""
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


if INTERPRETED:

    def _float_of(bits: Any) -> Any:
        return _U(bits).view(np.float64)

    def _bits_of(value: Any) -> Any:
        return np.float64(value).view(np.uint64)

else:

    @intrinsic
    def _float_of(context: Any, bits: Any) -> Any:
        """Return the double of 64 bits."""
        del context, bits

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.float64(numba.uint64), generate

    @intrinsic
    def _bits_of(context: Any, value: Any) -> Any:
        """Return the 64 bits of a double."""
        del context, value

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.uint64(numba.float64), generate


# random numbers ----------------------------------------------------------------------------------------------------


@plain
def _uniform(low: Scalar, high: Scalar) -> Scalar:
    """Return (2j + 1)/2⁵³, j the top 52 of the bits in the low halves of two words; every step is exact."""
    return (_float_of((((low & _LOW) | (high << _HALF_WORD)) >> _TWELVE) | _BITS_OF_ONE) - 1.0) + _HALF_STEP


@plain
def _round(c: Any, key_0: Scalar, key_1: Scalar) -> Any:
    """Return the four words after a round; only their low halves count, the high ones hold what is left over."""
    a, b = _MULTIPLIER_0 * (c[0] & _LOW), _MULTIPLIER_1 * (c[2] & _LOW)
    return (b >> _HALF_WORD) ^ c[1] ^ key_0, b, (a >> _HALF_WORD) ^ c[3] ^ key_1, a


@plain
def uniforms(w: Array, rows: Offsets, streams: Offsets, words: Offsets, seed: Scalar, first_pair: Scalar) -> None:
    """Fill rows with uniform numbers, as `precision_pin.philox.uniforms`: even units first, then odd ones."""
    for k in range(rows.size):
        row, stream, word = rows[k], streams[k], words[k]
        for i in range(_EIGHTH):
            # four pairs a turn, so that their chains of multiplications overlap
            p, q = first_pair + i, first_pair + _EIGHTH + i
            r, s = p + _TWO * _EIGHTH, q + _TWO * _EIGHTH
            a, b = (p, p >> _HALF_WORD, stream, word), (q, q >> _HALF_WORD, stream, word)
            c, d = (r, r >> _HALF_WORD, stream, word), (s, s >> _HALF_WORD, stream, word)
            x, y = seed & _LOW, seed >> _HALF_WORD
            # ten rounds; a loop of more than five is not unrolled, and then nothing is vectorised
            for _ in range(5):
                a, b, c, d = _round(a, x, y), _round(b, x, y), _round(c, x, y), _round(d, x, y)
                x, y = (x + _WEYL_0) & _LOW, (y + _WEYL_1) & _LOW
            for _ in range(5):
                a, b, c, d = _round(a, x, y), _round(b, x, y), _round(c, x, y), _round(d, x, y)
                x, y = (x + _WEYL_0) & _LOW, (y + _WEYL_1) & _LOW
            even, odd = row + i, row + _PAIRS + i
            w[even], w[odd] = _uniform(a[0], a[1]), _uniform(a[2], a[3])
            w[even + _EIGHTH], w[odd + _EIGHTH] = _uniform(b[0], b[1]), _uniform(b[2], b[3])
            w[even + _TWO * _EIGHTH], w[odd + _TWO * _EIGHTH] = _uniform(c[0], c[1]), _uniform(c[2], c[3])
            w[even + _THREE * _EIGHTH], w[odd + _THREE * _EIGHTH] = _uniform(d[0], d[1]), _uniform(d[2], d[3])


@plain
def _polynomial(z: Scalar, coefficients: Any) -> Scalar:
    value = coefficients[0]
    for k in range(1, len(coefficients)):
        value = value * z + coefficients[k]
    return value


@contracted
def _series(z: Scalar, coefficients: Any) -> Scalar:
    value = coefficients[0]
    for k in range(1, len(coefficients)):
        value = value * z + coefficients[k]
    return value


@contracted
def logarithm(x: Scalar) -> Scalar:
    """Return log x of a normal number, within 2 ulp: 2 artanh(f / (2 + f)) of x = 2ᵉ (1 + f)."""
    shifted = _bits_of(x) + _U(0x00095F6200000000)
    exponent = _float_of((shifted >> _MANTISSA) | _BITS_OF_2_52) - (2.0**52 + 1023.0)
    f = _float_of((shifted & _U(0x000FFFFFFFFFFFFF)) + _U(0x3FE6A09E00000000)) - 1.0
    s = f / (2.0 + f)
    z = s * s
    return exponent * 0.6931471805599453 + (2.0 * s + s * z * _series(z, _ARTANH))


@contracted
def turned(u: Scalar) -> tuple[Scalar, Scalar]:
    """Return sin 2πu and cos 2πu for 0 ≤ u ≤ 1, within 2 ulp; polynomials of Chebyshev interpolation on 1/8 of a turn."""
    rounded = 4.0 * u + _ROUND_TO_WHOLE
    quarter = _bits_of(rounded)
    r = u - 0.25 * (rounded - _ROUND_TO_WHOLE)  # exact
    z = r * r
    s, c = r * _series(z, _SINE), _series(z, _COSINE)
    swap = (quarter & _ONE) != _ZERO
    sine = c if swap else s
    cosine = s if swap else c
    sine = _float_of(_bits_of(sine) ^ ((quarter & _TWO) << _SIGN_FROM_TWO))
    cosine = _float_of(_bits_of(cosine) ^ (((quarter + _ONE) & _TWO) << _SIGN_FROM_TWO))
    return sine, cosine


@plain
def normal_score(p: Scalar) -> Scalar:
    """Return Φ⁻¹(p) for e⁻²⁵ ≤ p ≤ 0.575: algorithm AS 241 (Wichura, Applied Statistics 37, 1988), PPND16."""
    q = p - 0.5
    r = 0.180625 - q * q
    t = np.sqrt(-logarithm(p)) - 1.6
    central = q >= -0.425
    above = q * _polynomial(r, _CENTRE) if central else -_polynomial(t, _TAIL)
    below = _polynomial(r, _CENTRE_BELOW) if central else _polynomial(t, _TAIL_BELOW)
    return above / below


@plain
def far_normal_score(p: Scalar) -> Scalar:
    """Return Φ⁻¹(p) for p < e⁻²⁵, by the same algorithm."""
    r = np.sqrt(-logarithm(p)) - 5.0
    return -_polynomial(r, _FAR) / _polynomial(r, _FAR_BELOW)


@plain
def exponential(x: Scalar) -> Scalar:
    """Return exp x for |x| < 700, within 1 ulp; the method and coefficients of fdlibm's e_exp.c."""
    rounded = x * 1.44269504088896338700e00 + _ROUND_TO_WHOLE
    k = rounded - _ROUND_TO_WHOLE
    high = x - k * 6.93147180369123816490e-01
    low = k * 1.90821492927058770002e-10
    r = high - low
    z = r * r
    c = r - z * _polynomial(z, _EXPONENTIAL)
    return (1.0 - ((low - r * c / (2.0 - c)) - high)) * _float_of((_bits_of(rounded) + _BIAS) << _MANTISSA)


@plain
def cumulative(z: Scalar) -> Scalar:
    """Return Φ(z) for |z| ≤ 8.65, the lower tail within a few ulp, as `precision_pin.laws.law.cumulative`."""
    a = abs(z)
    # the square of the high half is exact
    high = _float_of(_bits_of(a) & _HIGH_HALF)
    rest = 0.5 * (a - high) * (a + high)
    power = exponential(-0.5 * high * high) * (1.0 - rest * (1.0 - 0.5 * rest))
    tail = _polynomial(a, _MILLS) / _polynomial(a, _MILLS_BELOW) * power
    return 1.0 - tail if z > 0.0 else tail


@contracted
def normals(w: Array, row: Scalar) -> None:
    """Turn a row of uniform numbers into standard normal ones: Box-Muller of each pair (even unit, odd unit)."""
    for i in range(_PAIRS):
        reach = np.sqrt(-2.0 * logarithm(w[row + i]))
        sine, cosine = turned(w[row + _PAIRS + i])
        w[row + i] = reach * cosine
        w[row + _PAIRS + i] = reach * sine


@plain
def correlate(w: Array, rows: Offsets, root: Array) -> None:
    """Mix rows of standard normal numbers, the last row first, as `precision_pin.correlation.Correlation.mix`."""
    for back in range(rows.size):
        k = rows.size - 1 - back
        target = rows[k]
        for i in range(_TILE):
            w[target + i] = root[k, k] * w[target + i]
        for j in range(k):
            other, factor = rows[j], root[k, j]
            for i in range(_TILE):
                w[target + i] += factor * w[other + i]
        for i in range(_TILE):
            score = w[target + i]
            score = score if score > -_FARTHEST else -_FARTHEST
            w[target + i] = score if score < _FARTHEST else _FARTHEST


@plain
def uniforms_again(w: Array, row: Scalar) -> None:
    """Turn a row of standard normal numbers into uniform ones."""
    for i in range(_TILE):
        w[row + i] = cumulative(w[row + i])


@plain
def lognormal_law(w: Array, row: Scalar, mean: Scalar, sigma: Scalar, half_square: Scalar) -> None:
    """Turn standard normal numbers into `precision_pin.laws.Lognormal`."""
    for i in range(_TILE):
        w[row + i] = mean * exponential(sigma * w[row + i] - half_square)


@plain
def arcsine_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.Arcsine`."""
    for i in range(_TILE):
        u = w[row + i] - 0.5
        size = turned(0.5 * abs(u))[0]
        w[row + i] = mean + half_width * (size if u > 0.0 else -size)


@plain
def two_point_law(w: Array, row: Scalar, centre: Scalar, half_width: Scalar, threshold: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.TwoPoint`."""
    for i in range(_TILE):
        w[row + i] = centre + (half_width if w[row + i] > threshold else -half_width)


@plain
def empirical_law(w: Array, row: Scalar, lines: Array, first: Scalar, last: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.Empirical`, by bisection of the lines ``first … last - 1``."""
    for i in range(_TILE):
        u = w[row + i]
        low, high = first, last
        while high - low > _ONE:
            middle = (low + high) >> _ONE
            if lines[middle, 0] <= u:
                low = middle
            else:
                high = middle
        value = lines[low, 1] + lines[low, 2] * (u - lines[low, 0])
        end = lines[low, 3]
        w[row + i] = value if value < end else end


@plain
def table_law(w: Array, row: Scalar, size: Scalar, count: Scalar, first: Scalar, table: Array) -> None:
    """Turn the first of ``size`` rows of uniform numbers into `precision_pin.laws.Rows`."""
    for i in range(_TILE):
        # below count: the product of count and a uniform number rounds to less
        begin = first + size * _U(w[row + i] * np.float64(count))
        for k in range(size):
            w[row + _U(k) * _STRIDE + i] = table[begin + _U(k)]


@plain
def uniform_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.Uniform`."""
    for i in range(_TILE):
        w[row + i] = mean + half_width * (2.0 * w[row + i] - 1.0)


@plain
def triangular_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.Triangular`."""
    for i in range(_TILE):
        u = w[row + i]
        tail = u if u < 0.5 else 1.0 - u
        size = 1.0 - np.sqrt(2.0 * tail)
        w[row + i] = mean + half_width * (size if u > 0.5 else -size)


@plain
def truncated_law(w: Array, row: Scalar, mean: Scalar, std: Scalar, k: Scalar, cut: Scalar, share: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.laws.TruncatedNormal`."""
    far = 0
    for i in range(_TILE):
        u = w[row + i]
        p = cut + (u if u < 0.5 else 1.0 - u) * share
        far += 1 if p < _FAR_TAIL else 0
    if far:  # about once in 10¹¹ numbers, so that the others do not pay for it
        for i in range(_TILE):
            u = w[row + i]
            p = cut + (u if u < 0.5 else 1.0 - u) * share
            score = far_normal_score(p) if p < _FAR_TAIL else normal_score(p)
            size = std * (-score if -score < k else k)
            w[row + i] = mean + (size if u > 0.5 else -size)
    else:
        for i in range(_TILE):
            u = w[row + i]
            score = normal_score(cut + (u if u < 0.5 else 1.0 - u) * share)
            size = std * (-score if -score < k else k)
            w[row + i] = mean + (size if u > 0.5 else -size)


@plain
def disc_law(w: Array, row: Scalar, radius: Scalar) -> None:
    """Turn two rows of uniform numbers into `precision_pin.laws.Disc`."""
    for i in range(_TILE):
        reach = radius * np.sqrt(w[row + i])
        sine, cosine = turned(w[row + _STRIDE + i])
        w[row + i] = reach * cosine
        w[row + _STRIDE + i] = reach * sine


@plain
def circle_law(w: Array, row: Scalar, radius: Scalar) -> None:
    """Turn the second of two rows of uniform numbers into `precision_pin.laws.Circle`."""
    for i in range(_TILE):
        sine, cosine = turned(w[row + _STRIDE + i])
        w[row + i] = radius * cosine
        w[row + _STRIDE + i] = radius * sine


@plain
def joint_law(w: Array, row: Scalar, size: Scalar, root: Array) -> None:
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


@plain
def apply_laws(w: Array, draws: Draws) -> None:
    """Turn the rows of uniform numbers into the components of the space."""
    for k in range(draws.score_rows.size):
        normals(w, draws.score_rows[k])
    for k in range(draws.group_starts.size - 1):
        correlate(w, draws.group_rows[draws.group_starts[k] : draws.group_starts[k + 1]], draws.group_roots[k])
    for k in range(draws.cumulated_rows.size):
        uniforms_again(w, draws.cumulated_rows[k])
    for k in range(draws.uniform_rows.size):
        uniform_law(w, draws.uniform_rows[k], draws.uniform[k, 0], draws.uniform[k, 1])
    for k in range(draws.triangular_rows.size):
        triangular_law(w, draws.triangular_rows[k], draws.triangular[k, 0], draws.triangular[k, 1])
    for k in range(draws.normal_rows.size):
        row = draws.normal_rows[k]
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
    for k in range(draws.lognormal_rows.size):
        law = draws.lognormal[k]
        lognormal_law(w, draws.lognormal_rows[k], law[0], law[1], law[2])
    for k in range(draws.arcsine_rows.size):
        arcsine_law(w, draws.arcsine_rows[k], draws.arcsine[k, 0], draws.arcsine[k, 1])
    for k in range(draws.two_point_rows.size):
        law = draws.two_point[k]
        two_point_law(w, draws.two_point_rows[k], law[0], law[1], law[2])
    for k in range(draws.empirical_rows.size):
        first, last = draws.empirical_starts[k], draws.empirical_starts[k + 1]
        empirical_law(w, draws.empirical_rows[k], draws.empirical, first, last)
    for k in range(draws.table_rows.size):
        shape = draws.table_shapes[k]
        table_law(w, draws.table_rows[k], shape[0], shape[1], shape[2], draws.table)


# derived parameters and products -------------------------------------------------------------------------------------


@plain
def _derive(w: Array, formulas: Formulas) -> Scalar:
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


@contracted
def _mix(w: Array, result: Scalar, start: Scalar, stop: Scalar, rows: Offsets, vectors: Array) -> None:
    """Add ``vector × row`` to the three rows from an offset on, for entries ``start … stop - 1``."""
    one, two, three = result, result + _STRIDE, result + _U(2 * STRIDE)
    k = start
    while stop - k >= _FOUR:
        a, b, c, d = rows[k], rows[k + _ONE], rows[k + _TWO], rows[k + _THREE]
        ax, ay, az = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        bx, by, bz = vectors[k + _ONE, 0], vectors[k + _ONE, 1], vectors[k + _ONE, 2]
        cx, cy, cz = vectors[k + _TWO, 0], vectors[k + _TWO, 1], vectors[k + _TWO, 2]
        dx, dy, dz = vectors[k + _THREE, 0], vectors[k + _THREE, 1], vectors[k + _THREE, 2]
        for i in range(_TILE):
            p, q, r, s = w[a + i], w[b + i], w[c + i], w[d + i]
            w[one + i] += ax * p + bx * q + cx * r + dx * s
            w[two + i] += ay * p + by * q + cy * r + dy * s
            w[three + i] += az * p + bz * q + cz * r + dz * s
        k += _FOUR
    if k < stop:
        a, b, c = rows[k], rows[k + _ONE], rows[k + _TWO]
        ax, ay, az = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        bx, by, bz = vectors[k + _ONE, 0], vectors[k + _ONE, 1], vectors[k + _ONE, 2]
        cx, cy, cz = vectors[k + _TWO, 0], vectors[k + _TWO, 1], vectors[k + _TWO, 2]
        for i in range(_TILE):
            p, q, r = w[a + i], w[b + i], w[c + i]
            w[one + i] += ax * p + bx * q + cx * r
            w[two + i] += ay * p + by * q + cy * r
            w[three + i] += az * p + bz * q + cz * r


@contracted
def _turn_narrow(w: Array) -> None:
    """Turn the half rotation vector h into the quaternion of its rotation, in place, for |h| ≤ 0.125."""
    for i in range(_TILE):
        x, y, z = w[_H0 + i], w[_H1 + i], w[_H2 + i]
        s = x * x + y * y + z * z
        sinc = _series(s, _SHORT_SINC)
        w[_HW + i] = _series(s, _SHORT_COSINE)
        w[_H0 + i] = sinc * x
        w[_H1 + i] = sinc * y
        w[_H2 + i] = sinc * z


@contracted
def _turn_wide(w: Array) -> None:
    """As `_turn_narrow`, for |h| ≤ π/2."""
    for i in range(_TILE):
        x, y, z = w[_H0 + i], w[_H1 + i], w[_H2 + i]
        s = x * x + y * y + z * z
        sinc = _series(s, _LONG_SINC)
        w[_HW + i] = _series(s, _LONG_COSINE)
        w[_H0 + i] = sinc * x
        w[_H1 + i] = sinc * y
        w[_H2 + i] = sinc * z


@plain
def _too_far(w: Array) -> Scalar:
    """Return how many half rotation vectors are π/2 long or more."""
    count = 0
    for i in range(_TILE):
        x, y, z = w[_H0 + i], w[_H1 + i], w[_H2 + i]
        count += 0 if x * x + y * y + z * z < _QUARTER_TURN_SQUARED else 1
    return count


@contracted
def _rotate(w: Array, rx: Scalar, ry: Scalar, rz: Scalar) -> None:
    """Turn what lies beyond a target: e ← e + (Rot - 1)(r + e), q ← rotation · q."""
    for i in range(_TILE):
        a, x, y, z = w[_HW + i], w[_H0 + i], w[_H1 + i], w[_H2 + i]
        px, py, pz = rx + w[_E0 + i], ry + w[_E1 + i], rz + w[_E2 + i]
        # (Rot - 1) p = 2 v × (a p + v × p), with nothing that cancels
        ux = a * px + (y * pz - z * py)
        uy = a * py + (z * px - x * pz)
        uz = a * pz + (x * py - y * px)
        w[_E0 + i] += 2.0 * (y * uz - z * uy)
        w[_E1 + i] += 2.0 * (z * ux - x * uz)
        w[_E2 + i] += 2.0 * (x * uy - y * ux)
        b, qx, qy, qz = w[_Q0 + i], w[_Q1 + i], w[_Q2 + i], w[_Q3 + i]
        w[_Q0 + i] = a * b - x * qx - y * qy - z * qz
        w[_Q1 + i] = a * qx + b * x + (y * qz - z * qy)
        w[_Q2 + i] = a * qy + b * y + (z * qx - x * qz)
        w[_Q3 + i] = a * qz + b * z + (x * qy - y * qx)


@contracted
def _turn_by_three(w: Array, first: Scalar, rows: Offsets, vectors: Array, rx: Scalar, ry: Scalar, rz: Scalar) -> None:
    """Do at once what `_mix` of three entries, `_turn_narrow` and `_rotate` do."""
    a, b, c = rows[first], rows[first + _ONE], rows[first + _TWO]
    ax, ay, az = vectors[first, 0], vectors[first, 1], vectors[first, 2]
    bx, by, bz = vectors[first + _ONE, 0], vectors[first + _ONE, 1], vectors[first + _ONE, 2]
    cx, cy, cz = vectors[first + _TWO, 0], vectors[first + _TWO, 1], vectors[first + _TWO, 2]
    for i in range(_TILE):
        p, q, r = w[a + i], w[b + i], w[c + i]
        x = ax * p + bx * q + cx * r
        y = ay * p + by * q + cy * r
        z = az * p + bz * q + cz * r
        s = x * x + y * y + z * z
        sinc = _series(s, _SHORT_SINC)
        t = _series(s, _SHORT_COSINE)
        x, y, z = sinc * x, sinc * y, sinc * z
        px, py, pz = rx + w[_E0 + i], ry + w[_E1 + i], rz + w[_E2 + i]
        ux = t * px + (y * pz - z * py)
        uy = t * py + (z * px - x * pz)
        uz = t * pz + (x * py - y * px)
        w[_E0 + i] += 2.0 * (y * uz - z * uy)
        w[_E1 + i] += 2.0 * (z * ux - x * uz)
        w[_E2 + i] += 2.0 * (x * uy - y * ux)
        q0, qx, qy, qz = w[_Q0 + i], w[_Q1 + i], w[_Q2 + i], w[_Q3 + i]
        w[_Q0 + i] = t * q0 - x * qx - y * qy - z * qz
        w[_Q1 + i] = t * qx + q0 * x + (y * qz - z * qy)
        w[_Q2 + i] = t * qy + q0 * y + (z * qx - x * qz)
        w[_Q3 + i] = t * qz + q0 * z + (x * qy - y * qx)


@contracted
def _rotation_vector_narrow(w: Array) -> None:
    """Turn the quaternion into the rotation vector, in place: 4 atan(|v|/(1 + w)) v/|v|, up to 0.25 rad."""
    for i in range(_TILE):
        x, y, z = w[_Q1 + i], w[_Q2 + i], w[_Q3 + i]
        g = 1.0 / (1.0 + w[_Q0 + i])
        t = (x * x + y * y + z * z) * g * g
        scale = 4.0 * g * _series(t, _SHORT_ARC)
        w[_Q1 + i] = scale * x
        w[_Q2 + i] = scale * y
        w[_Q3 + i] = scale * z


@contracted
def _rotation_vector_wide(w: Array) -> None:
    """As `_rotation_vector_narrow`, up to π, with the angle halved once more; the angle is in [0, π]."""
    for i in range(_TILE):
        x, y, z, a = w[_Q1 + i], w[_Q2 + i], w[_Q3 + i], w[_Q0 + i]
        sign = 1.0 if a >= 0.0 else -1.0
        g = 1.0 / (1.0 + abs(a))
        t = (x * x + y * y + z * z) * g * g
        h = 1.0 / (1.0 + np.sqrt(1.0 + t))
        t = t * h * h
        scale = sign * 8.0 * g * h * _series(t, _LONG_ARC)
        w[_Q1 + i] = scale * x
        w[_Q2 + i] = scale * y
        w[_Q3 + i] = scale * z


@plain
def _at_rest(w: Array) -> None:
    """Let no sample be displaced yet."""
    for i in range(_TILE):
        w[_E0 + i] = 0.0
        w[_E1 + i] = 0.0
        w[_E2 + i] = 0.0
        w[_Q0 + i] = 1.0
        w[_Q1 + i] = 0.0
        w[_Q2 + i] = 0.0
        w[_Q3 + i] = 0.0


@plain
def _displace(w: Array, motions: Motions, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Compose all targets from the tip to the base; return the sample of which a target turns by π or more, or -1.

    The tip's displacement e and the rotation q, not the pose, are carried along, so that nothing cancels.
    """
    _at_rest(w)
    targets = motions.arms.shape[0]
    for k in range(_U(targets)):
        first, last = motions.turn_starts[k], motions.turn_starts[k + _ONE]
        rx, ry, rz = motions.arms[k, 0], motions.arms[k, 1], motions.arms[k, 2]
        if last - first == _THREE and not motions.wide[k]:
            _turn_by_three(w, first, motions.turn_rows, motions.turns, rx, ry, rz)
        elif first < last:
            for i in range(_TILE):
                w[_H0 + i] = 0.0
                w[_H1 + i] = 0.0
                w[_H2 + i] = 0.0
            _mix(w, _H0, first, last, motions.turn_rows, motions.turns)
            if motions.wide[k]:
                if _too_far(w):
                    for i in range(_TILE):
                        sample = _sample_at(i, sampled)
                        x, y, z = w[_H0 + i], w[_H1 + i], w[_H2 + i]
                        if skipped <= sample < count and not x * x + y * y + z * z < _QUARTER_TURN_SQUARED:
                            return sample
                _turn_wide(w)
            else:
                _turn_narrow(w)
            _rotate(w, rx, ry, rz)
        _mix(w, _E0, motions.shift_starts[k], motions.shift_starts[k + _ONE], motions.shift_rows, motions.shifts)
    if motions.wide[targets]:
        _rotation_vector_wide(w)
    else:
        _rotation_vector_narrow(w)
    return -1


@plain
def _superpose(w: Array, superposition: Superposition) -> None:
    """Write the linear model's six numbers where `_displace` leaves them."""
    _at_rest(w)
    _mix(w, _E0, _ZERO, _U(superposition.shift_rows.size), superposition.shift_rows, superposition.shifts)
    _mix(w, _Q1, _ZERO, _U(superposition.turn_rows.size), superposition.turn_rows, superposition.turns)


# counting ------------------------------------------------------------------------------------------------------------


@plain
def _sample_at(position: Scalar, sampled: bool) -> Scalar:
    """Return which sample of the tile stands at a position of a row."""
    place = np.int64(position)
    if not sampled:
        return place
    return 2 * place if place < TILE // 2 else 2 * (place - TILE // 2) + 1


@plain
def _in_order(w: Array, source: Scalar, result: Scalar, sampled: bool) -> None:
    """Copy a row with its samples in order."""
    if sampled:
        for i in range(_PAIRS):
            w[result + _TWO * i] = w[source + i]
            w[result + _TWO * i + _ONE] = w[source + _PAIRS + i]
    else:
        for i in range(_TILE):
            w[result + i] = w[source + i]


@plain
def _values(w: Array, sampled: bool) -> Scalar:
    """Write the eight quantities in order; return how many samples are not finite."""
    for part in range(_TWO):
        norm = _VALUES + part * _U(4 * STRIDE)
        for c in range(_U(3)):
            source = part * _U(4 * STRIDE) + c * _STRIDE  # rows _E0, _E1, _E2 and _Q1, _Q2, _Q3
            _in_order(w, source, norm + (c + _ONE) * _STRIDE, sampled)
        for i in range(_TILE):
            x, y, z = w[norm + _STRIDE + i], w[norm + _U(2 * STRIDE) + i], w[norm + _U(3 * STRIDE) + i]
            w[norm + i] = np.sqrt(x * x + y * y + z * z)
    failures = 0
    for i in range(_TILE):
        finite = w[_VALUES + i] < np.inf and w[_VALUES + _U(4 * STRIDE) + i] < np.inf
        failures += 0 if finite else 1
    return failures


@plain
def _pad(w: Array, count: Scalar) -> None:
    """Let the samples beyond the last one equal the first: they change neither smallest nor largest."""
    for q in range(_U(8)):
        row = _VALUES + q * _STRIDE
        for i in range(count, TILE):
            w[row + _U(i)] = w[row]


@plain
def _keep_largest(
    w: Array, q: Scalar, count: Scalar, first: Scalar, largest: Array, units: NDArray[np.int64], row: Scalar
) -> None:
    """Keep the tile's largest values of a quantity, largest first, of equal ones the earlier unit's."""
    values = _VALUES + q * _STRIDE
    least = largest[row, LARGEST - 1]
    above = 0
    for i in range(_TILE):
        above += 1 if w[values + i] > least else 0
    if above:
        for i in range(count):
            value = w[values + _U(i)]
            place = LARGEST
            while place > 0 and value > largest[row, place - 1]:
                place -= 1
            if place < LARGEST:
                for k in range(LARGEST - 1, place, -1):
                    largest[row, k] = largest[row, k - 1]
                    units[row, k] = units[row, k - 1]
                largest[row, place] = value
                units[row, place] = np.int64(first) + i


@plain
def _widen(w: Array, step: Scalar) -> None:
    """Let the lanes' smallest and largest values take in the tile's: of every, or every fourth, quantity."""
    for q in range(_ZERO, _U(8), step):
        values = _VALUES + q * _STRIDE
        lowest = _LANES + (_U(SUMS) + q) * _U(LANES)
        highest = lowest + _U(8 * LANES)
        for lane in range(_U(LANES)):
            low, high = w[lowest + lane], w[highest + lane]
            for c in range(_U(TILE // LANES)):
                value = w[values + c * _U(LANES) + lane]
                low = value if value < low else low
                high = value if value > high else high
            w[lowest + lane] = low
            w[highest + lane] = high


@plain
def _bin(w: Array, bins: Offsets, q: Scalar, centre: Scalar, inverse_scale: Scalar) -> None:
    """Write a quantity's residuals, and in which bin of the sketch each falls."""
    values, residuals = _VALUES + q * _STRIDE, _RESIDUALS + q * _STRIDE
    first = q * _U(2 * _BINS)
    for i in range(_TILE):
        residual = w[values + i] - centre
        w[residuals + i] = residual
        scaled = residual * inverse_scale
        shifted = _bits_of(abs(scaled)) >> _U(_SHIFT)
        magnitude = shifted - _U(_OFFSET - 1) if shifted > _U(_OFFSET - 1) else _ZERO
        magnitude = magnitude if magnitude < _U(_BINS - 1) else _U(_BINS - 1)
        bins[i] = first + (_U(_BINS - 1) - magnitude if scaled < 0.0 else _U(_BINS) + magnitude)


@plain
def _add_residuals(w: Array) -> None:
    """Add the residuals into their lanes."""
    for q in range(_U(8)):
        sums, residuals = _LANES + q * _U(LANES), _RESIDUALS + q * _STRIDE
        for lane in range(_U(LANES)):
            total = w[sums + lane]
            for c in range(_U(TILE // LANES)):
                total += w[residuals + c * _U(LANES) + lane]
            w[sums + lane] = total


@plain
def _count(
    w: Array, bins: Offsets, count: Scalar, counting: Counting, sketch: NDArray[np.uint32], inside: NDArray[np.int64]
) -> None:
    """Count the tile's values into the lanes, the sketch and the specifications."""
    _widen(w, _ONE)
    for q in range(_U(8)):
        _bin(w, bins, q, counting.centre[q], counting.inverse_scale[q])
        for i in range(_U(count)):
            sketch[bins[i]] += np.uint32(1)
        for i in range(count, TILE):
            w[_RESIDUALS + q * _STRIDE + _U(i)] = 0.0
    _add_residuals(w)
    _add_products(w)
    for k in range(counting.limits.size):
        row, limit = _VALUES + counting.limit_rows[k] * _STRIDE, counting.limits[k]
        kept = 0
        for i in range(_U(count)):
            kept += 1 if abs(w[row + i]) <= limit else 0
        inside[k] += kept


@plain
def _add_products(w: Array) -> None:
    """Add the products of the residuals' rows into their lanes: of two components each, then of each norm."""
    for begin in range(_ZERO, _TILE, _U(4 * LANES)):
        for lane in range(_U(LANES)):
            xx, xy, xz, xa, xb, xc = (
                w[_P0 + lane],
                w[_P1 + lane],
                w[_P2 + lane],
                w[_P3 + lane],
                w[_P4 + lane],
                w[_P5 + lane],
            )
            yy, yz, ya, yb, yc = w[_P6 + lane], w[_P7 + lane], w[_P8 + lane], w[_P9 + lane], w[_P10 + lane]
            zz, za, zb, zc = w[_P11 + lane], w[_P12 + lane], w[_P13 + lane], w[_P14 + lane]
            aa, ab, ac = w[_P15 + lane], w[_P16 + lane], w[_P17 + lane]
            bb, bc = w[_P18 + lane], w[_P19 + lane]
            cc = w[_P20 + lane]
            dd, tt = w[_P21 + lane], w[_P22 + lane]
            for turn in range(_FOUR):
                i = begin + turn * _U(LANES) + lane
                d, x, y, z = w[_R0 + i], w[_R1 + i], w[_R2 + i], w[_R3 + i]
                t, a, b, c = w[_R4 + i], w[_R5 + i], w[_R6 + i], w[_R7 + i]
                xx, xy, xz, xa, xb, xc = xx + x * x, xy + x * y, xz + x * z, xa + x * a, xb + x * b, xc + x * c
                yy, yz, ya, yb, yc = yy + y * y, yz + y * z, ya + y * a, yb + y * b, yc + y * c
                zz, za, zb, zc = zz + z * z, za + z * a, zb + z * b, zc + z * c
                aa, ab, ac = aa + a * a, ab + a * b, ac + a * c
                bb, bc = bb + b * b, bc + b * c
                cc = cc + c * c
                dd, tt = dd + d * d, tt + t * t
            w[_P0 + lane], w[_P1 + lane], w[_P2 + lane], w[_P3 + lane], w[_P4 + lane], w[_P5 + lane] = (
                xx,
                xy,
                xz,
                xa,
                xb,
                xc,
            )
            w[_P6 + lane], w[_P7 + lane], w[_P8 + lane], w[_P9 + lane], w[_P10 + lane] = yy, yz, ya, yb, yc
            w[_P11 + lane], w[_P12 + lane], w[_P13 + lane], w[_P14 + lane] = zz, za, zb, zc
            w[_P15 + lane], w[_P16 + lane], w[_P17 + lane] = aa, ab, ac
            w[_P18 + lane], w[_P19 + lane] = bb, bc
            w[_P20 + lane] = cc
            w[_P21 + lane], w[_P22 + lane] = dd, tt


@plain
def _fold(w: Array, sums: Array) -> None:
    """Fold each sum's lanes in halves and empty them."""
    for k in range(_U(SUMS)):
        lanes = _LANES + k * _U(LANES)
        half = LANES // 2
        while half:
            for lane in range(_U(half)):
                w[lanes + lane] += w[lanes + _U(half) + lane]
            half //= 2
        sums[k] = w[lanes]
        for lane in range(_U(LANES)):
            w[lanes + lane] = 0.0


@kept
def run(
    w: Array,
    draws: Draws,
    formulas: Formulas,
    superposition: Superposition,
    motions: Motions,
    stage: Scalar,
    seed: Scalar,
    words: Offsets,
    first: Scalar,
    skip: Scalar,
    count: Scalar,
    given: Array,
    kept_components: Array,
    kept_errors: Array,
    counting: Counting,
    sums: Array,
    lowest: Array,
    highest: Array,
    sketch: NDArray[np.uint32],
    inside: NDArray[np.int64],
    largest: Array,
    largest_units: NDArray[np.int64],
) -> tuple[Scalar, Scalar]:
    """Work through samples tile by tile.

    Parameters
    ----------
    w
        Workspace, 64-byte aligned: `SCRATCH` rows, then those that the offsets name.
    draws, formulas, superposition, motions
        The layout.
    stage
        `DRAW`, `LINEAR` or `EXACT`.
    seed, words
        Key and, for each stream, the last counter word.
    first, skip, count
        First unit, which is even, how many samples at the beginning nobody asked for (they may fail), and how many
        samples with them.
    given
        ``(d, count)`` component values to use, or no columns: draw them.
    kept_components, kept_errors
        ``(d, count)`` and ``(6, count)`` to fill, or no columns.
    counting, sums, lowest, highest, sketch, inside, largest, largest_units
        What to subtract; ``(atoms, SUMS)`` partial sums, none: count nothing; ``(8,)``; ``(8,)``; ``(8 · COLUMNS,)``;
        ``(S,)``; ``(2, LARGEST)`` and their units; the last six to add to.

    Returns
    -------
    tuple
        Why the run stopped (0: it did not) and at which sample.
    """
    for row in range(draws.fixed_rows.size):
        for i in range(_TILE):
            w[draws.fixed_rows[row] + i] = draws.fixed_values[row]
    counted = sums.shape[0] > 0
    bins = np.empty(TILE, np.uint64)
    if counted:
        for i in range(_U(SUMS * LANES)):
            w[_LANES + i] = 0.0
        for q in range(_U(8)):
            for lane in range(_U(LANES)):
                w[_LANES + (_U(SUMS) + q) * _U(LANES) + lane] = lowest[q]
                w[_LANES + (_U(SUMS + 8) + q) * _U(LANES) + lane] = highest[q]
    sampled = given.shape[1] == 0
    components = given.shape[0]
    tiles = (count + TILE - 1) // TILE
    for tile in range(tiles):
        begin = tile * TILE
        size = TILE if count - begin > TILE else count - begin
        skipped = skip if tile == 0 else 0
        if sampled:
            uniforms(w, draws.stream_rows, draws.streams, words, seed, (first >> _ONE) + _U(tile) * _PAIRS)
            apply_laws(w, draws)
        else:
            for k in range(components):
                offset = _U((SCRATCH + k) * STRIDE)
                for i in range(size):
                    w[offset + _U(i)] = given[k, begin + i]
                for i in range(size, TILE):
                    w[offset + _U(i)] = given[k, begin]
        if kept_components.shape[1]:
            for k in range(components):
                _in_order(w, _U((SCRATCH + k) * STRIDE), _VALUES, sampled)
                for i in range(size):
                    kept_components[k, begin + i] = w[_VALUES + _U(i)]
        if stage == DRAW:
            continue
        if _derive(w, formulas):
            for i in range(_TILE):
                sample = _sample_at(i, sampled)
                for step in range(formulas.results.size):
                    if skipped <= sample < size and not abs(w[formulas.results[step] + i]) < np.inf:
                        return FORMULA, begin + sample
        if stage == LINEAR:
            _superpose(w, superposition)
        else:
            sample = _displace(w, motions, skipped, size, sampled)
            if sample >= 0:
                return ANGLE, begin + sample
        if _values(w, sampled):
            for i in range(skipped, size):
                if not (w[_VALUES + _U(i)] < np.inf and w[_VALUES + _U(4 * STRIDE + i)] < np.inf):
                    return NOT_FINITE, begin + i
        if kept_errors.shape[1]:
            for c in range(6):
                offset = _VALUES + _U((c + 1 + c // 3) * STRIDE)
                for i in range(size):
                    kept_errors[c, begin + i] = w[offset + _U(i)]
        if counted:
            if size < TILE:
                _pad(w, size)
            _count(w, bins, size, counting, sketch, inside)
            _keep_largest(w, _ZERO, size, first + _U(begin), largest, largest_units, 0)
            _keep_largest(w, _FOUR, size, first + _U(begin), largest, largest_units, 1)
            if (begin + TILE) % ATOM == 0 or tile == tiles - 1:
                _fold(w, sums[begin // ATOM])
    if counted:
        for q in range(_U(8)):
            for lane in range(_U(LANES)):
                low = w[_LANES + (_U(SUMS) + q) * _U(LANES) + lane]
                high = w[_LANES + (_U(SUMS + 8) + q) * _U(LANES) + lane]
                lowest[q] = low if low < lowest[q] else lowest[q]
                highest[q] = high if high > highest[q] else highest[q]
    return 0, 0


# many poses ----------------------------------------------------------------------------------------------------------


@plain
def _norm_residuals(w: Array, size: Scalar, centre: Array) -> Scalar:
    """Write the residuals and the two norms, their samples not in order; return how many samples are not finite.

    The samples beyond the last one get no residuals, and the norms of the first.
    """
    for part in range(_TWO):
        first = part * _U(4 * STRIDE)  # of rows _E0, _E1, _E2 and _Q1, _Q2, _Q3
        norm, residual = _VALUES + first, _RESIDUALS + first
        q = part * _FOUR
        c, cx, cy, cz = centre[q], centre[q + _ONE], centre[q + _TWO], centre[q + _THREE]
        for i in range(_TILE):
            x, y, z = w[first + i], w[first + _STRIDE + i], w[first + _U(2 * STRIDE) + i]
            length = np.sqrt(x * x + y * y + z * z)
            w[norm + i] = length
            w[residual + i] = length - c
            w[residual + _STRIDE + i] = x - cx
            w[residual + _U(2 * STRIDE) + i] = y - cy
            w[residual + _U(3 * STRIDE) + i] = z - cz
        if size < TILE:
            for i in range(_TILE):
                if _sample_at(i, True) >= size:
                    w[norm + i] = w[norm]
                    for row in range(_FOUR):
                        w[residual + row * _STRIDE + i] = 0.0
    failures = 0
    for i in range(_TILE):
        finite = w[_VALUES + i] < np.inf and w[_VALUES + _U(4 * STRIDE) + i] < np.inf
        failures += 0 if finite else 1
    return failures


@plain
def _count_norms(
    w: Array,
    bins: Offsets,
    size: Scalar,
    inverse_scale: Array,
    limit_rows: Offsets,
    limits: Array,
    sketch: NDArray[np.uint32],
    inside: NDArray[np.int64],
) -> None:
    """Count the residuals into the lanes, the two norms into the small sketch, and all into the specifications."""
    _widen(w, _FOUR)
    _add_residuals(w)
    _add_products(w)
    for part in range(_TWO):
        residuals, first = _RESIDUALS + part * _U(4 * STRIDE), part * _U(NORM_COLUMNS)
        factor = inverse_scale[part * _FOUR]
        for i in range(_TILE):
            scaled = w[residuals + i] * factor
            shifted = _bits_of(abs(scaled)) >> _NORM_SHIFT
            magnitude = shifted - _NORM_OFFSET if shifted > _NORM_OFFSET else _ZERO
            magnitude = magnitude if magnitude < _NORM_LAST else _NORM_LAST
            bins[i] = first + (_NORM_LAST - magnitude if scaled < 0.0 else _NORM_LAST + _ONE + magnitude)
        if size == TILE:
            for i in range(_TILE):
                sketch[bins[i]] += np.uint32(1)
        else:
            for i in range(_TILE):
                if _sample_at(i, True) < size:
                    sketch[bins[i]] += np.uint32(1)
    for k in range(limits.size):
        q, limit = limit_rows[k], limits[k]
        # a norm stands by itself, a component where it was made
        row = _VALUES + q * _STRIDE if q & _THREE == _ZERO else (q - _ONE) * _STRIDE
        kept = 0
        if size == TILE:
            for i in range(_TILE):
                kept += 1 if abs(w[row + i]) <= limit else 0
        else:
            for i in range(_TILE):
                kept += 1 if _sample_at(i, True) < size and abs(w[row + i]) <= limit else 0
        inside[k] += kept


@plain
def _failed_formula(w: Array, formulas: Formulas, size: Scalar) -> Scalar:
    """Return the first sample of which an operation's result is not finite, or -1."""
    found = -1
    for i in range(_TILE):
        sample = _sample_at(i, True)
        for step in range(formulas.results.size):
            if sample < size and not abs(w[formulas.results[step] + i]) < np.inf:
                found = sample if found < 0 or sample < found else found
    return found


@kept
def run_poses(
    workspaces: Array,
    lanes: Array,
    unit_draws: Draws,
    draws: Draws,
    unit_formulas: Formulas,
    formulas: Formulas,
    superposition: Superposition,
    superposed: Offsets,
    motions: Motions,
    stage: Scalar,
    seed: Scalar,
    unit_words: Offsets,
    words: Offsets,
    first: Scalar,
    count: Scalar,
    centre: Array,
    inverse_scale: Array,
    limit_rows: Offsets,
    limits: Array,
    norms_only: bool,
    sums: Array,
    lowest: Array,
    highest: Array,
    sketch: NDArray[np.uint32],
    inside: NDArray[np.int64],
    largest: Array,
    largest_units: NDArray[np.int64],
) -> tuple[Scalar, Scalar, Scalar]:
    """Work through samples of P poses; what is drawn once for a unit is drawn once for all poses.

    Parameters
    ----------
    workspaces
        ``(T, rows)`` as `run`'s, of tiles that are worked on together.
    lanes
        ``(P, LANE_DOUBLES)`` room.
    unit_draws, unit_formulas, unit_words
        What is done once for a tile.
    draws, formulas, words
        What is done at every pose; ``words`` are ``(P, streams)``.
    superposition, superposed
        All poses' entries, one behind the other, and where each pose's shifts and turns begin, ``(P + 1, 2)``.
    motions
        All poses' entries, one behind the other; starts ``(P, K + 1)``, arms ``(P, K, 3)``, wide ``(P, K + 1)``.
    stage
        `LINEAR` or `EXACT`.
    seed, first, count
        As in `run`.
    centre, inverse_scale
        ``(P, 8)``.
    limit_rows, limits
        ``(S,)`` quantities and their limits.
    norms_only
        Keep the small sketches of the two norms instead of the large ones of all, and no largest errors.
    sums, lowest, highest, sketch, inside, largest, largest_units
        As in `run`, each with P in front.

    Returns
    -------
    tuple
        Why the run stopped (0: it did not), at which pose and sample.
    """
    together = workspaces.shape[0]
    for t in range(together):
        w = workspaces[t]
        for row in range(unit_draws.fixed_rows.size):
            for i in range(_TILE):
                w[unit_draws.fixed_rows[row] + i] = unit_draws.fixed_values[row]
    bins = np.empty(TILE, np.uint64)
    poses = centre.shape[0]
    for pose in range(poses):
        for k in range(SUMS * LANES):
            lanes[pose, k] = 0.0
        for q in range(8):
            for lane in range(LANES):
                lanes[pose, (SUMS + q) * LANES + lane] = lowest[pose, q]
                lanes[pose, (SUMS + 8 + q) * LANES + lane] = highest[pose, q]
    tiles = (count + TILE - 1) // TILE
    for begin in range(0, tiles, together):
        end = begin + together if begin + together < tiles else tiles
        for tile in range(begin, end):
            w = workspaces[tile - begin]
            pair = (first >> _ONE) + _U(tile) * _PAIRS
            uniforms(w, unit_draws.stream_rows, unit_draws.streams, unit_words, seed, pair)
            apply_laws(w, unit_draws)
            if _derive(w, unit_formulas):
                sample = _failed_formula(w, unit_formulas, count - tile * TILE)
                if sample >= 0:
                    return FORMULA, 0, tile * TILE + sample
        for pose in range(poses):
            at = Motions(
                motions.shift_starts[pose],
                motions.shift_rows,
                motions.shifts,
                motions.turn_starts[pose],
                motions.turn_rows,
                motions.turns,
                motions.arms[pose],
                motions.wide[pose],
            )
            counting = Counting(centre[pose], inverse_scale[pose], limit_rows, limits)
            own_lanes, own_sketch, own_inside = lanes[pose], sketch[pose], inside[pose]
            for tile in range(begin, end):
                w = workspaces[tile - begin]
                size = TILE if count - tile * TILE > TILE else count - tile * TILE
                if draws.stream_rows.size:
                    pair = (first >> _ONE) + _U(tile) * _PAIRS
                    uniforms(w, draws.stream_rows, draws.streams, words[pose], seed, pair)
                    apply_laws(w, draws)
                if _derive(w, formulas):
                    sample = _failed_formula(w, formulas, size)
                    if sample >= 0:
                        return FORMULA, pose, tile * TILE + sample
                if stage == LINEAR:
                    _at_rest(w)
                    here, beyond = superposed[pose], superposed[pose + 1]
                    _mix(w, _E0, here[0], beyond[0], superposition.shift_rows, superposition.shifts)
                    _mix(w, _Q1, here[1], beyond[1], superposition.turn_rows, superposition.turns)
                else:
                    sample = _displace(w, at, 0, size, True)
                    if sample >= 0:
                        return ANGLE, pose, tile * TILE + sample
                for k in range(_U(LANE_DOUBLES)):
                    w[_LANES + k] = own_lanes[k]
                if norms_only:
                    if _norm_residuals(w, size, counting.centre):
                        for i in range(_TILE):
                            if not (w[_VALUES + i] < np.inf and w[_VALUES + _U(4 * STRIDE) + i] < np.inf):
                                return NOT_FINITE, pose, tile * TILE + _sample_at(i, True)
                    _count_norms(w, bins, size, counting.inverse_scale, limit_rows, limits, own_sketch, own_inside)
                else:
                    if _values(w, True):
                        for i in range(size):
                            if not (w[_VALUES + _U(i)] < np.inf and w[_VALUES + _U(4 * STRIDE + i)] < np.inf):
                                return NOT_FINITE, pose, tile * TILE + i
                    if size < TILE:
                        _pad(w, size)
                    _count(w, bins, size, counting, own_sketch, own_inside)
                    unit = first + _U(tile * TILE)
                    _keep_largest(w, _ZERO, size, unit, largest[pose], largest_units[pose], 0)
                    _keep_largest(w, _FOUR, size, unit, largest[pose], largest_units[pose], 1)
                if (tile + 1) * TILE % ATOM == 0 or tile == tiles - 1:
                    _fold(w, sums[pose, tile * TILE // ATOM])
                for k in range(_U(LANE_DOUBLES)):
                    own_lanes[k] = w[_LANES + k]
    for pose in range(poses):
        for q in range(8):
            for lane in range(LANES):
                low = lanes[pose, (SUMS + q) * LANES + lane]
                high = lanes[pose, (SUMS + 8 + q) * LANES + lane]
                lowest[pose, q] = low if low < lowest[pose, q] else lowest[pose, q]
                highest[pose, q] = high if high > highest[pose, q] else highest[pose, q]
    return 0, 0, 0
