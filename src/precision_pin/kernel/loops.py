"""Compiled loops of the sampler: draw, derive, displace, compose, count.

All compiled code of the package is in this file, because numba does not notice that a cached function is stale when a
function it calls changes in another file. The code is independent of the robot: all data arrive as arrays, made by
:mod:`precision_pin.kernel.arrays`.

Samples are processed in *tiles* of `TILE`. One *row* of a workspace holds one quantity of a tile. Rows are `STRIDE`
doubles apart and identified by the offset of their first element, an unsigned integer: signed offsets make numba test
for negative indices, which keeps LLVM from vectorising. The rows that every model has are in one array, the *scratch*
`s`, those of the parameters in another, `w`: in a single array LLVM would test them for overlap before every loop,
which takes as long as the loop. Sampled tiles hold the even units first, then the odd ones, the order of Philox and
Box-Muller. They are reordered only where a result leaves the tile.

Floating-point contraction (fused multiply-add) is allowed only in functions marked `fma`: logarithms, normal numbers,
directions of discs, displacements. All other code, including uniform numbers and sums, is strict IEEE arithmetic in the
written order. The mathematical library is called only for powers, sines and cosines in derived formulas. So the bits
are the same on machines of one type, and the numbers agree to rounding on others.
"""

from __future__ import annotations

import math
from typing import Any, Final, Literal, NamedTuple

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.jit import (
    INTERPRETED,
    cached_entry,
    cached_part,
    cached_part_inline,
    fma,
    fma_noinline,
    inline,
    strict,
)
from precision_pin.statistics.limits import SINE_SERIES

Offsets = NDArray[np.uint64]
Bins = NDArray[np.uint32]
Scalar = Any
"""Number inside compiled code: an offset (np.uint64), an index or a double."""
Wanted = Literal[True] | None
"""Flag for optional code: True, or None, which is another type to numba, so that the code is not compiled at all."""

TILE: Final = 128
"""Samples processed together."""
STRIDE: Final = TILE + 8
"""Doubles from one row to the next; not a power of two, so that rows do not compete for the same cache lines."""
ATOM: Final = 1 << 14
"""Samples in one partial sum, as in :func:`precision_pin.statistics.observe`."""
LANES: Final = 16
"""Running sums of one quantity: fixed, and more than a vector register holds, so every processor adds in one order."""
HELD: Final = 16
"""Tiles whose bins are found before they are counted."""
LARGEST: Final = 10
"""Number of largest errors kept."""
SUMS: Final = 31
"""Partial sums of an atom: 8 residuals, 21 products of two components (upper triangle by rows), 2 squared norms."""

LANE_DOUBLES: Final = (SUMS + 16) * LANES
"""Doubles in the lanes of a pose: of the sums, the eight smallest and the eight largest values."""

NORM_MANTISSA: Final = 5
NORM_EXPONENTS: Final = (-4, 4)
NORM_COLUMNS: Final = 2 * (1 + ((NORM_EXPONENTS[1] - NORM_EXPONENTS[0]) << NORM_MANTISSA))
"""Columns of the small sketch of a norm, 514: as the large one, with 32 bins per octave, eight octaves on each side."""

FINE, NARROW, WIDE = 0, 1, 2
"""Series for the rotation of a target, by its largest angle."""
DRAW, LINEAR, EXACT = 0, 1, 2
"""Last stage of the work on a tile."""
FORMULA, ANGLE, NOT_FINITE = 1, 2, 3
"""Reasons for stopping a run."""

_U = np.uint64

# rows of the scratch: the eight quantities, which also hold the tip's displacement e and the quaternion's vector v while they
# are composed; the quaternion's scalar; and for the current target half its rotation vector X as far as it is summed, the
# multiple G of it, and the function C of its length
_D, _E0, _E1, _E2, _T, _V0, _V1, _V2, _V, _X0, _X1, _X2, _G0, _G1, _G2, _C = (_U(row * STRIDE) for row in range(16))
# the residuals reuse the rows of G and C, so that the scratch stays in the first-level cache
_RESIDUALS: Final = _G0
_R0, _R1, _R2, _R3, _R4, _R5, _R6, _R7 = (_RESIDUALS + _U(q * STRIDE) for q in range(8))
# after the residuals, which end with row 19
_LANES: Final = _U(20 * STRIDE)
(
    _P0, _P1, _P2, _P3, _P4, _P5, _P6, _P7, _P8, _P9, _P10, _P11, _P12, _P13, _P14, _P15, _P16, _P17, _P18, _P19, _P20,
    _P21, _P22,
) = (_LANES + _U((8 + k) * LANES) for k in range(23))  # fmt: skip
SCRATCH: Final = 20 + -(-(SUMS + 16) * LANES // STRIDE)
"""Number of rows of the scratch."""

_TILE = _U(TILE)
_PAIRS = _U(TILE // 2)
_EIGHTH = _U(TILE // 8)
_STRIDE = _U(STRIDE)
_LANE = _U(LANES)
# unsigned, like the offsets they are added to: the sum with a signed number would be signed
_ZERO, _ONE, _TWO, _THREE, _FOUR, _FIVE, _SIX, _TWELVE, _HALF_WORD, _MANTISSA, _SIGN_FROM_FOUR = (
    _U(k) for k in (0, 1, 2, 3, 4, 5, 6, 12, 32, 52, 61)
)
# Philox4x32 (Salmon, Moraes, Dror and Shaw, SC 2011): the multipliers, and the increments of the keys in each round
_MULTIPLIER_0, _MULTIPLIER_1 = _U(0xD2511F53), _U(0xCD9E8D57)
_WEYL_0, _WEYL_1 = _U(0x9E3779B9), _U(0xBB67AE85)
_LOW = _U(0xFFFFFFFF)
_BITS_OF_ONE = _U(0x3FF0000000000000)
_ONE_LESS = 1.0 - 2.0**-53  # 2⁻⁵³ below one: puts the uniform numbers halfway between multiples of 2⁻⁵²
# adding and subtracting these rounds to whole numbers and to eighths, because the mantissa has no bits for less; the factor
# 1.5 keeps sums with negative numbers in the same binade
_ROUND_TO_WHOLE = 1.5 * 2.0**52
_ROUND_TO_EIGHTH = 1.5 * 2.0**49
# a whole number in the mantissa of 2^52 gives a double without a conversion, for which not all processors have a vector
# instruction
_BITS_OF_2_52 = _U(0x4330000000000000)
_ROOT_OF_HALF = math.sqrt(0.5)
_QUARTER_TURN_SQUARED = (math.pi / 2) ** 2
_FAR_TAIL = math.exp(-25.0)
_ALL_BUT_SIGN, _SIGN = np.int32(0x7FFFFFFF), np.int32(31)
_HIGH_HALF = _U(0xFFFFFFFFF8000000)
_BIAS = _U(1023)

# polynomials, highest power first
# (2 artanh(√z/2)/√z - 1)/z up to z = 0.03, sin(2π√z)/√z and cos(2π√z) up to z = 1/256, with relative errors below 1e-15,
# 3e-16 and 3e-17: interpolated at Chebyshev nodes
_ARTANH = (
    9.019753805148336e-05, 0.00043399051425642025, 0.002232143255777381, 0.012499999998508662, 0.08333333333333423,
)  # fmt: skip
_SINE = (
    -15.05071314565728, 42.05850583775351, -76.70585938733862, 81.60524927576472, -41.34170224039968,
    6.283185307179586,
)  # fmt: skip
_COSINE = (
    -26.335385167684986, 60.24425228323669, -85.45681645024156, 64.9393940220264, -19.739208802178542, 1.0,
)  # fmt: skip
# a number near √2 whose logarithm minus log 2, both rounded to doubles, is exact to 3e-21
_ROOT_OF_TWO, _ITS_LOGARITHM = 1.414213562372734, 0.3465735902797174
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
# Φ(-z) exp(z²/2), 0 ≤ z ≤ 8.65, with a relative error below 2.6e-18: interpolated at Chebyshev nodes of (z - 2.5)/(z + 2.5)
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
# tan √s/√s and 2 cos² √s up to s = 0.005² and up to 1/64, atan √t/√t up to t = tan² 0.005 and up to tan² 1/8, with errors
# below 9e-17: interpolated at Chebyshev nodes
_FINE_TANGENT = (0.13333535716592487, 0.3333333333143598, 1.0)
_FINE_COSINE = (0.6666635726618821, -1.9999999999760678, 2.0)
_FINE_ARC = (0.19999502750452347, -0.3333333332948705, 1.0)
_TANGENT = (
    0.009033635110796896, 0.021866481700786467, 0.053968278373067606, 0.13333333324387606, 0.3333333333334532, 1.0,
)  # fmt: skip
_COSINE_SQUARED = (
    -0.0002817933128400379, 0.00634919960538201, -0.08888888883643706, 0.6666666666664887, -1.9999999999999998, 2.0,
)  # fmt: skip
_SHORT_ARC = (
    0.07334546520721653, -0.09083216624042942, 0.1111102868070088, -0.14285713831346633, 0.19999999998806048,
    -0.33333333333332155, 1.0,
)  # fmt: skip
# Taylor series of cos √s, sin √s/√s and atan √t/√t
_LONG_COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(11, -1, -1))
_LONG_SINC = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(11, -1, -1))
_LONG_ARC = tuple((-1) ** k / (2 * k + 1) for k in range(20, -1, -1))

# constants of other files are repeated here, not imported, because numba would not notice a change; a test compares them
# precision_pin.draws.expressions.Operator
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _SQRT, _SIN, _COS, _SIGNUM = range(9)
_SHIFT, _OFFSET, _BINS = 43, 1011 << 9, 10_241  # precision_pin.statistics.accumulate
_FARTHEST = 8.6  # precision_pin.draws.laws.FARTHEST_NORMAL

_NORM_SHIFT = _U(52 - NORM_MANTISSA)
_NORM_OFFSET = _U(((1023 + NORM_EXPONENTS[0]) << NORM_MANTISSA) - 1)
_NORM_LAST = _U(NORM_COLUMNS // 2 - 1)


# named tuples, which numba accepts from Python without conversion
class Draws(NamedTuple):
    """Components of a space by kind of law; all fields ``*rows`` are row offsets."""

    fixed_rows: Offsets
    fixed_values: Array
    stream_rows: Offsets
    streams: Offsets
    normal_rows: Offsets
    """Uncorrelated normal laws, and the normal numbers that correlated, jointly normal and lognormal laws start from."""
    normal: Array
    """``(k, 2)`` mean, -2 times the variance."""
    group_starts: Offsets
    """Correlated rows: those of group g are ``group_rows[starts[g] … starts[g + 1]]``."""
    group_rows: Offsets
    group_roots: Array
    """``(groups, m, m)`` root of the scores' correlation matrix, padded with zeros to the largest m."""
    cumulated_rows: Offsets
    """Correlated rows that are turned back into uniform numbers."""
    uniform_rows: Offsets
    uniform: Array
    """``(k, 2)`` mean, half-width."""
    triangular_rows: Offsets
    triangular: Array
    """``(k, 2)`` mean, half-width."""
    scaled_rows: Offsets
    """Correlated normal laws, scaled from standard normal numbers."""
    scaled: Array
    """``(k, 2)`` mean, standard deviation."""
    truncated_rows: Offsets
    truncated: Array
    """``(k, 5)`` mean, standard deviation, k, Φ(-k), Φ(k) - Φ(-k)."""
    disc_rows: Offsets
    disc: Array
    """``(k,)`` radius; y is in the row after x."""
    circle_rows: Offsets
    circle: Array
    """``(k,)`` radius; y is in the row after x."""
    sphere_rows: Offsets
    sphere: Array
    """``(k,)`` radius; y and z are in the rows after x."""
    joint_rows: Offsets
    joint_roots: Array
    """``(k, m + 3, m)`` the mean, the root of the covariance, lowest and highest values; padded to the largest m."""
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
    """``(lines, 4)`` probability and value at the start of each line, slope, value at its end."""
    table_rows: Offsets
    table_shapes: Offsets
    """``(k, 3)`` numbers in a row, number of rows, index of the first number in ``table``."""
    table: Array


class Formulas(NamedTuple):
    """Derived parameters, and products of parameters that are factors of further products."""

    operators: NDArray[np.int64]
    left: Offsets
    right: Offsets
    results: Offsets
    product_factors: Offsets
    """``(k, 2)`` rows of the two factors."""
    products: Offsets


class Superposition(NamedTuple):
    """Two vectors of the linear model as sums, see `Motions`; the poses are concatenated."""

    shift_rows: Offsets
    shifts: Array
    turn_rows: Offsets
    turns: Array
    starts: Offsets
    """``(2 P + 1, 2)`` starts of shifts and turns, as in `Motions`."""


class Motions(NamedTuple):
    """Targets from tip to base, each with two vectors in base axes: d and half of δ. Each vector is a sum of two parts.

    The first part consists of terms ``vector × row``, entries ``starts[2 k] … starts[2 k + 1] - 1`` of target k. A
    target that rotates has at least three for each vector. Zero vectors pad counts one or two above a multiple of six,
    because the loops never process one or two entries. The second part, up to ``starts[2 k + 2] - 1``, consists of sets
    of six entries for three terms ``vector × row × row``: six rows, and three vectors in the first three of six places.
    """

    shift_starts: Offsets
    """``(2 K + 1,)`` first entries of the parts."""
    shift_rows: Offsets
    shifts: Array
    """``(entries, 3)`` vectors."""
    turn_starts: Offsets
    """``(2 K + 1,)`` first entries of the parts."""
    turn_rows: Offsets
    turns: Array
    """``(entries, 3)`` vectors."""
    arms: Array
    """``(K, 3)`` from each pivot to the undisplaced tip, base axes."""
    series: NDArray[np.int64]
    """``(K + 1,)`` `FINE`, `NARROW` or `WIDE`, for rotations up to 0.01 rad, 0.25 rad or π: of each target, then of the sum."""


class Datum(NamedTuple):
    """Errors at the visits of a datum, and multiples of rows that it adds to the errors.

    The motions are those of V visits, concatenated as for `run_poses`.
    """

    motions: Motions
    results: Offsets
    """``(V, 6)`` rows for the error of each visit."""
    rows: Offsets
    """``(R,)`` rows that are added: of these errors, and of components."""
    gains: Array
    """``(P, R, 6)`` what a unit of each row adds to the error at each pose."""


class Conditions(NamedTuple):
    """Limits on lengths of components of the error in any axes; several of a specification are kept together."""

    starts: Offsets
    """``(S + 1,)`` first condition of each specification; none for a limit of one of the eight quantities."""
    matrices: Array
    """``(C, 3, 6)``, or ``(P, C, 3, 6)``."""
    limits: Array
    tilts: Offsets
    """Whether the limited length is the chord of a tilt, ``(C,)``."""


class Counting(NamedTuple):
    """Centres to subtract, scales of bins, and limits to count against."""

    centre: Array
    inverse_scale: Array
    limit_rows: Offsets
    limits: Array
    conditions: Conditions


if INTERPRETED:

    def _float_of(bits: Any) -> Any:
        return _U(bits).view(np.float64)

    def _bits_of(value: Any) -> Any:
        return np.float64(value).view(np.uint64)

else:

    @intrinsic
    def _float_of(context: Any, bits: Any) -> Any:
        del context, bits

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.float64(numba.uint64), generate

    @intrinsic
    def _bits_of(context: Any, value: Any) -> Any:
        del context, value

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

        return numba.uint64(numba.float64), generate


# random numbers ----------------------------------------------------------------------------------------------------


@strict
def _round(c: Any, key_0: Scalar, key_1: Scalar) -> Any:
    """Return the four words after a round; only their low halves are valid, the high halves are leftovers."""
    a, b = _MULTIPLIER_0 * (c[0] & _LOW), _MULTIPLIER_1 * (c[2] & _LOW)
    return (b >> _HALF_WORD) ^ c[1] ^ key_0, b, (a >> _HALF_WORD) ^ c[3] ^ key_1, a


@strict
def _uniform(product: Scalar, word: Scalar, key: Scalar) -> Scalar:
    """Return (2j + 1)/2⁵³, with j the top 52 of the 64 bits from one product of the last round; every step is exact."""
    # the upper half of these bits is the product's lower half; their lower half is the product's upper half, xored with
    # a word and, last, which saves two instructions, the key
    bits = ((product << _HALF_WORD) | (product >> _HALF_WORD)) ^ (word & _LOW)
    return _float_of((bits >> _TWELVE) ^ (_BITS_OF_ONE | (key >> _TWELVE))) - _ONE_LESS


@strict
def _last_round(c: Any, key_0: Scalar, key_1: Scalar) -> tuple[Scalar, Scalar]:
    a, b = _MULTIPLIER_0 * (c[0] & _LOW), _MULTIPLIER_1 * (c[2] & _LOW)
    return _uniform(b, c[1], key_0), _uniform(a, c[3], key_1)


@strict
def _share(products: Offsets, low: Scalar, mask: Scalar) -> None:
    """Write the parts of a tile's first two rounds that all streams share: two products, and the second's upper half."""
    for i in range(_PAIRS):
        first = _MULTIPLIER_0 * (low + i)
        second = _MULTIPLIER_1 * (((first >> _HALF_WORD) ^ mask) & _LOW)
        products[i], products[_PAIRS + i], products[_TILE + i] = first, second, second >> _HALF_WORD


@strict
def _after_two_rounds(products: Offsets, i: Scalar, same_0: Scalar, same_2: Scalar, same_3: Scalar) -> Any:
    """Return the four words of a pair after the second round."""
    return products[_TILE + i] ^ same_0, products[_PAIRS + i], products[i] ^ same_2, same_3


@cached_part
def uniforms(
    w: Array, rows: Offsets, streams: Offsets, words: Offsets, seed: Scalar, first_pair: Scalar, products: Offsets
) -> None:
    """Fill rows with uniform numbers, as `precision_pin.draws.philox.uniforms`: even units first, then odd ones."""
    # The first pair is a multiple of half a tile, so that all pairs have the same upper counter word. Of the four
    # products of the first two rounds, two are then the same for all pairs, and two for all streams with the same last
    # word. The latter are stored in `products`, 3/2 `TILE` words.
    low, high = first_pair & _LOW, first_pair >> _HALF_WORD
    key_0, key_1 = seed & _LOW, seed >> _HALF_WORD
    next_0, next_1 = (key_0 + _WEYL_0) & _LOW, (key_1 + _WEYL_1) & _LOW
    for k in range(rows.size):
        # the last word encodes pose and visit of a stream; it is mostly that of the stream before
        if k == 0 or words[k] != words[k - 1]:
            _share(products, low, words[k] ^ key_1)
        row = rows[k]
        other = _MULTIPLIER_1 * streams[k]
        same_3 = _MULTIPLIER_0 * (((other >> _HALF_WORD) ^ high ^ key_0) & _LOW)
        same_0, same_2 = other ^ next_0, (same_3 >> _HALF_WORD) ^ next_1
        for i in range(_EIGHTH):
            # four pairs per iteration, so that their chains of multiplications overlap
            j, m, n = i + _EIGHTH, i + _TWO * _EIGHTH, i + _THREE * _EIGHTH
            a = _after_two_rounds(products, i, same_0, same_2, same_3)
            b = _after_two_rounds(products, j, same_0, same_2, same_3)
            c = _after_two_rounds(products, m, same_0, same_2, same_3)
            d = _after_two_rounds(products, n, same_0, same_2, same_3)
            x, y = next_0, next_1
            # seven more rounds; LLVM unrolls a loop of at most five, and without unrolling it does not vectorise
            for _ in range(4):
                x, y = (x + _WEYL_0) & _LOW, (y + _WEYL_1) & _LOW
                a, b, c, d = _round(a, x, y), _round(b, x, y), _round(c, x, y), _round(d, x, y)
            for _ in range(3):
                x, y = (x + _WEYL_0) & _LOW, (y + _WEYL_1) & _LOW
                a, b, c, d = _round(a, x, y), _round(b, x, y), _round(c, x, y), _round(d, x, y)
            x, y = (x + _WEYL_0) & _LOW, (y + _WEYL_1) & _LOW
            even, odd = row + i, row + _PAIRS + i
            w[even], w[odd] = _last_round(a, x, y)
            w[even + _EIGHTH], w[odd + _EIGHTH] = _last_round(b, x, y)
            w[even + _TWO * _EIGHTH], w[odd + _TWO * _EIGHTH] = _last_round(c, x, y)
            w[even + _THREE * _EIGHTH], w[odd + _THREE * _EIGHTH] = _last_round(d, x, y)


@strict
def _polynomial(z: Scalar, coefficients: Any) -> Scalar:
    value = coefficients[0]
    for k in range(1, len(coefficients)):
        value = value * z + coefficients[k]
    return value


@fma
def _series(z: Scalar, coefficients: Any) -> Scalar:
    # the sum of `_polynomial`, with contraction
    value = coefficients[0]
    for k in range(1, len(coefficients)):
        value = value * z + coefficients[k]
    return value


@fma
def logarithm(x: Scalar) -> Scalar:
    """Return log x of a normalised double within 2 ulp, by 2 artanh(s/2) with s = 2(m - c)/(m + c) and x = 2ᵉ m."""
    # c is 1 or near √2, whichever is nearer to m
    # m from 2^(-1/4) to 2^(3/4)
    shifted = _bits_of(x) + _U(0x0005175F00000000)
    exponent = _float_of((shifted >> _MANTISSA) | _BITS_OF_2_52) - (2.0**52 + 1023.0)
    m = _float_of((shifted & _U(0x000FFFFFFFFFFFFF)) + _U(0x3FEAE8A100000000))
    above = m > 1.19
    c = _ROOT_OF_TWO if above else 1.0
    f = m - c  # exact
    s = (f + f) / (m + c)
    z = s * s
    # the largest part is added last
    whole = exponent * 0.6931471805599453 + (_ITS_LOGARITHM if above else 0.0)
    return whole + (s + s * z * _series(z, _ARTANH))


@fma
def _octant(u: Scalar) -> Any:
    """Return u in eighths of a turn, as bits, whether they are odd, and cosine and sine of 2πu up to quarter turns."""
    # for odd eighths both are √2 times too large, so that the series cover 1/16 of a turn only
    rounded = u + _ROUND_TO_EIGHTH
    eighths = _bits_of(rounded)
    r = u - (rounded - _ROUND_TO_EIGHTH)  # exact
    z = r * r
    s, c = r * _series(z, _SINE), _series(z, _COSINE)
    diagonal = (eighths & _ONE) != _ZERO
    return eighths, diagonal, c - s if diagonal else c, c + s if diagonal else s


@fma
def _quarters(eighths: Scalar, x: Scalar, y: Scalar, length: Scalar) -> tuple[Scalar, Scalar]:
    """Return length × (y, x), rotated by the quarter turns in the eighths."""
    # the third bit, half a turn, becomes the sign without a branch
    signed = _float_of(_bits_of(length) ^ ((eighths & _FOUR) << _SIGN_FROM_FOUR))
    odd = (eighths & _TWO) != _ZERO
    return signed * (x if odd else y), signed * (-y if odd else x)


@fma
def sine_and_cosine(u: Scalar, radius: Scalar) -> tuple[Scalar, Scalar]:
    """Return radius × sin 2πu and radius × cos 2πu for 0 ≤ u ≤ 1: within 4e-16 for a radius of 1, within 2 ulp near 0."""
    eighths, diagonal, x, y = _octant(u)
    return _quarters(eighths, x, y, radius * (_ROOT_OF_HALF if diagonal else 1.0))


@strict
def normal_score(p: Scalar) -> Scalar:
    """Return Φ⁻¹(p) for e⁻²⁵ ≤ p ≤ 0.575: algorithm AS 241 (Wichura, Applied Statistics 37, 1988), PPND16."""
    q = p - 0.5
    r = 0.180625 - q * q
    t = np.sqrt(-logarithm(p)) - 1.6
    # both formulas, then a selection: a branch would prevent vectorisation, which triples the cost
    central = q >= -0.425
    above = q * _polynomial(r, _CENTRE) if central else -_polynomial(t, _TAIL)
    below = _polynomial(r, _CENTRE_BELOW) if central else _polynomial(t, _TAIL_BELOW)
    return above / below


@strict
def far_normal_score(p: Scalar) -> Scalar:
    """Return Φ⁻¹(p) for p < e⁻²⁵, by the same algorithm."""
    r = np.sqrt(-logarithm(p)) - 5.0
    return -_polynomial(r, _FAR) / _polynomial(r, _FAR_BELOW)


@strict
def exponential(x: Scalar) -> Scalar:
    """Return exp x for |x| < 700, within 1 ulp, by the method and coefficients of fdlibm's e_exp.c."""
    # the low bits of the rounded number are the power of two, as a whole number
    rounded = x * 1.44269504088896338700e00 + _ROUND_TO_WHOLE
    k = rounded - _ROUND_TO_WHOLE
    high = x - k * 6.93147180369123816490e-01
    low = k * 1.90821492927058770002e-10
    r = high - low
    z = r * r
    c = r - z * _polynomial(z, _EXPONENTIAL)
    return (1.0 - ((low - r * c / (2.0 - c)) - high)) * _float_of((_bits_of(rounded) + _BIAS) << _MANTISSA)


@strict
def cumulative(z: Scalar) -> Scalar:
    """Return Φ(z) for |z| ≤ 8.65, as `precision_pin.draws.laws.law.cumulative`; the lower tail is within a few ulp."""
    a = abs(z)
    # the square of the high half is exact
    high = _float_of(_bits_of(a) & _HIGH_HALF)
    # exp(-rest) by three terms: rest is below 3e-6
    rest = 0.5 * (a - high) * (a + high)
    power = exponential(-0.5 * high * high) * (1.0 - rest * (1.0 - 0.5 * rest))
    tail = _polynomial(a, _MILLS) / _polynomial(a, _MILLS_BELOW) * power
    return 1.0 - tail if z > 0.0 else tail


@fma_noinline
def normals(w: Array, rows: Offsets, laws: Array) -> None:
    """Turn rows of uniform numbers into normal ones with mean and -2σ², by Box-Muller for each pair (even, odd unit)."""
    # two loops, first the logarithms: the constants of one loop fit into the registers, those of both do not
    for k in range(rows.size):
        row = rows[k]
        for i in range(_PAIRS):
            w[row + i] = logarithm(w[row + i])
    for k in range(rows.size):
        row, mean, factor = rows[k], laws[k, 0], laws[k, 1]
        half = 0.5 * factor
        for i in range(_PAIRS):
            eighths, diagonal, c, s = _octant(w[row + _PAIRS + i])
            reach = np.sqrt((half if diagonal else factor) * w[row + i])
            y, x = _quarters(eighths, c, s, reach)
            w[row + i] = mean + x
            w[row + _PAIRS + i] = mean + y


@strict
def correlate(w: Array, rows: Offsets, root: Array) -> None:
    """Mix rows of standard normal numbers, as `precision_pin.draws.correlation.Correlation.mix`."""
    # from the last row to the first: a row is mixed from those before it, which must still be independent
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
            # the same bound at which the laws clip their inverse
            score = w[target + i]
            score = score if score > -_FARTHEST else -_FARTHEST
            w[target + i] = score if score < _FARTHEST else _FARTHEST


@strict
def to_uniforms(w: Array, row: Scalar) -> None:
    """Turn a row of standard normal numbers into uniform ones."""
    for i in range(_TILE):
        w[row + i] = cumulative(w[row + i])


@strict
def lognormal_law(w: Array, row: Scalar, mean: Scalar, sigma: Scalar, half_square: Scalar) -> None:
    """Turn standard normal numbers into `precision_pin.draws.laws.Lognormal`."""
    for i in range(_TILE):
        w[row + i] = mean * exponential(sigma * w[row + i] - half_square)


@strict
def arcsine_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.Arcsine`."""
    for i in range(_TILE):
        u = w[row + i] - 0.5
        size = sine_and_cosine(0.5 * abs(u), 1.0)[0]
        w[row + i] = mean + half_width * (size if u > 0.0 else -size)


@strict
def two_point_law(w: Array, row: Scalar, centre: Scalar, half_width: Scalar, threshold: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.TwoPoint`."""
    for i in range(_TILE):
        w[row + i] = centre + (half_width if w[row + i] > threshold else -half_width)


@strict
def empirical_law(w: Array, row: Scalar, lines: Array, first: Scalar, last: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.Empirical`, by bisection in the lines ``first … last - 1``."""
    for i in range(_TILE):
        u = w[row + i]
        low, high = first, last
        while high - low > _ONE:
            middle = (low + high) >> _ONE
            if lines[middle, 0] <= u:
                low = middle
            else:
                high = middle
        # rounding must not carry a value beyond the end of its line
        value = lines[low, 1] + lines[low, 2] * (u - lines[low, 0])
        end = lines[low, 3]
        w[row + i] = value if value < end else end


@strict
def table_law(w: Array, row: Scalar, size: Scalar, count: Scalar, first: Scalar, table: Array) -> None:
    """Turn the first of ``size`` rows of uniform numbers into `precision_pin.draws.laws.Rows`."""
    for i in range(_TILE):
        # below count: the product of count and a uniform number rounds to less
        begin = first + size * _U(w[row + i] * np.float64(count))
        for k in range(size):
            w[row + _U(k) * _STRIDE + i] = table[begin + _U(k)]


@strict
def uniform_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.Uniform`."""
    for i in range(_TILE):
        # doubling the half-width and halving 2u - 1 are exact, and save an addition
        w[row + i] = mean + (half_width + half_width) * (w[row + i] - 0.5)


@strict
def triangular_law(w: Array, row: Scalar, mean: Scalar, half_width: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.Triangular`."""
    for i in range(_TILE):
        u = w[row + i]
        tail = u if u < 0.5 else 1.0 - u
        size = 1.0 - np.sqrt(2.0 * tail)
        w[row + i] = mean + half_width * (size if u > 0.5 else -size)


@strict
def truncated_law(w: Array, row: Scalar, mean: Scalar, std: Scalar, k: Scalar, cut: Scalar, share: Scalar) -> None:
    """Turn uniform numbers into `precision_pin.draws.laws.TruncatedNormal`."""
    far = 0
    for i in range(_TILE):
        u = w[row + i]
        p = cut + (u if u < 0.5 else 1.0 - u) * share
        far += 1 if p < _FAR_TAIL else 0
    if far:  # about once in 10¹¹ numbers; a separate loop keeps the common one fast
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


@strict
def disc_law(w: Array, row: Scalar, radius: Scalar) -> None:
    """Turn two rows of uniform numbers into `precision_pin.draws.laws.Disc`."""
    for i in range(_TILE):
        w[row + _STRIDE + i], w[row + i] = sine_and_cosine(w[row + _STRIDE + i], radius * np.sqrt(w[row + i]))


@strict
def circle_law(w: Array, row: Scalar, radius: Scalar) -> None:
    """Turn the second of two rows of uniform numbers into `precision_pin.draws.laws.Circle`."""
    for i in range(_TILE):
        w[row + _STRIDE + i], w[row + i] = sine_and_cosine(w[row + _STRIDE + i], radius)


@strict
def sphere_law(w: Array, row: Scalar, radius: Scalar) -> None:
    """Turn the last two of three rows of uniform numbers into `precision_pin.draws.laws.Sphere`."""
    for i in range(_TILE):
        u = w[row + _U(2) * _STRIDE + i]
        across = (radius + radius) * np.sqrt(u * (1.0 - u))
        w[row + _STRIDE + i], w[row + i] = sine_and_cosine(w[row + _STRIDE + i], across)
        w[row + _U(2) * _STRIDE + i] = (radius + radius) * (u - 0.5)


@strict
def joint_law(w: Array, row: Scalar, size: Scalar, root: Array) -> None:
    """Turn rows of standard normal numbers into `precision_pin.draws.laws.JointNormal`."""
    # from the last row to the first, as in `correlate`
    for back in range(size):
        k = size - _ONE - _U(back)
        target = row + k * _STRIDE
        diagonal = root[k + _ONE, k]
        for i in range(_TILE):
            w[target + i] = diagonal * w[target + i]
        for j in range(k):
            other = row + _U(j) * _STRIDE
            factor = root[k + _ONE, j]
            for i in range(_TILE):
                w[target + i] += factor * w[other + i]
        mean, low, high = root[_ZERO, k], root[size + _ONE, k], root[size + _U(2), k]
        for i in range(_TILE):
            w[target + i] = min(max(w[target + i] + mean, low), high)


@cached_part_inline
def apply_laws(w: Array, draws: Draws, rare: Wanted) -> None:
    """Turn the rows of uniform numbers into the components of the space; rare laws only if requested."""
    # normal numbers first, then those that are turned back into uniform ones: the laws below start from either. Each law has
    # its own loop without branches, which LLVM can vectorise
    normals(w, draws.normal_rows, draws.normal)
    if rare is not None:
        for k in range(draws.group_starts.size - 1):
            correlate(w, draws.group_rows[draws.group_starts[k] : draws.group_starts[k + 1]], draws.group_roots[k])
        for k in range(draws.cumulated_rows.size):
            to_uniforms(w, draws.cumulated_rows[k])
    for k in range(draws.uniform_rows.size):
        uniform_law(w, draws.uniform_rows[k], draws.uniform[k, 0], draws.uniform[k, 1])
    for k in range(draws.triangular_rows.size):
        triangular_law(w, draws.triangular_rows[k], draws.triangular[k, 0], draws.triangular[k, 1])
    for k in range(draws.truncated_rows.size):
        law = draws.truncated[k]
        truncated_law(w, draws.truncated_rows[k], law[0], law[1], law[2], law[3], law[4])
    if rare is not None:
        for k in range(draws.scaled_rows.size):
            row = draws.scaled_rows[k]
            mean, std = draws.scaled[k, 0], draws.scaled[k, 1]
            for i in range(_TILE):
                w[row + i] = mean + std * w[row + i]
        for k in range(draws.disc_rows.size):
            disc_law(w, draws.disc_rows[k], draws.disc[k])
        for k in range(draws.circle_rows.size):
            circle_law(w, draws.circle_rows[k], draws.circle[k])
        for k in range(draws.sphere_rows.size):
            sphere_law(w, draws.sphere_rows[k], draws.sphere[k])
        for k in range(draws.joint_rows.size):
            joint_law(w, draws.joint_rows[k], draws.joint_sizes[k], draws.joint_roots[k])
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


@strict
def _multiply(w: Array, factors: Offsets, results: Offsets) -> None:
    for k in range(results.size):
        a, b, result = factors[k, 0], factors[k, 1], results[k]
        for i in range(_TILE):
            w[result + i] = w[a + i] * w[b + i]


@cached_part_inline
def _derive(w: Array, formulas: Formulas) -> Scalar:
    """Evaluate the operations and products; return the number of results that are not finite."""
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
        elif operator == _SIGNUM:
            for i in range(_TILE):
                w[result + i] = 1.0 if w[a + i] >= 0.0 else -1.0
        # all are counted, because a loop with an early exit is not vectorised
        for i in range(_TILE):
            failures += 0 if abs(w[result + i]) < np.inf else 1
    _multiply(w, formulas.product_factors, formulas.products)
    return failures


# displacing the chain ------------------------------------------------------------------------------------------------


@inline
def _two(rows: Offsets, vectors: Array, k: Scalar) -> Any:
    """Return rows and vectors of the entries ``k, k + 1``."""
    m = k + _ONE
    return (rows[k], rows[m]), (
        (vectors[k, 0], vectors[k, 1], vectors[k, 2]),
        (vectors[m, 0], vectors[m, 1], vectors[m, 2]),
    )


@inline
def _three(rows: Offsets, vectors: Array, k: Scalar) -> Any:
    """Return rows and vectors of the entries ``k, k + 1, k + 2``."""
    first, second = _two(rows, vectors, k)
    n = k + _TWO
    return (*first, rows[n]), (*second, (vectors[n, 0], vectors[n, 1], vectors[n, 2]))


@fma
def _add(s: Array, w: Array, result: Scalar, rows: Any, vectors: Any) -> None:
    """Add ``vector × row`` of a few entries to three rows of the scratch."""
    # the entries of a pass are added first, so that the three sums are read and written once
    x_row, y_row, z_row = result, result + _STRIDE, result + _U(2 * STRIDE)
    for i in range(_TILE):
        p = w[rows[0] + i]
        x, y, z = vectors[0][0] * p, vectors[0][1] * p, vectors[0][2] * p
        for n in range(1, len(rows)):
            q = w[rows[n] + i]
            x, y, z = x + vectors[n][0] * q, y + vectors[n][1] * q, z + vectors[n][2] * q
        s[x_row + i] += x
        s[y_row + i] += y
        s[z_row + i] += z


@inline
def _mix(s: Array, w: Array, result: Scalar, start: Scalar, stop: Scalar, rows: Offsets, vectors: Array) -> None:
    """Add ``vector × row`` to three rows of the scratch, for the entries ``start … stop - 1``."""
    # six, five, four or three entries in a pass: the more, the less often the sums are read and written; the arrays are padded
    # so that one or two are never left
    k = start
    while k < stop:
        left = stop - k
        if left >= _SIX:
            (a, b), (c, d) = _three(rows, vectors, k), _three(rows, vectors, k + _THREE)
            _add(s, w, result, a + c, b + d)
            k += _SIX
        elif left == _FIVE:
            (a, b), (e, f) = _three(rows, vectors, k), _two(rows, vectors, k + _THREE)
            _add(s, w, result, a + e, b + f)
            k += _FIVE
        elif left == _FOUR:
            (e, f), (g, h) = _two(rows, vectors, k), _two(rows, vectors, k + _TWO)
            _add(s, w, result, e + g, f + h)
            k += _FOUR
        else:
            a, b = _three(rows, vectors, k)
            _add(s, w, result, a, b)
            k += _THREE


@fma
def _mix_products(
    s: Array, w: Array, result: Scalar, start: Scalar, stop: Scalar, rows: Offsets, vectors: Array
) -> None:
    """Add ``vector × row × row`` to three rows of the scratch, for sets of six entries from ``start`` to ``stop - 1``."""
    x_row, y_row, z_row = result, result + _STRIDE, result + _U(2 * STRIDE)
    k = start
    while k < stop:
        (a, b, c), ((px, py, pz), (qx, qy, qz), (rx, ry, rz)) = _three(rows, vectors, k)
        m = k + _THREE
        d, e, f = rows[m], rows[m + _ONE], rows[m + _TWO]
        for i in range(_TILE):
            p, q, r = w[a + i] * w[b + i], w[c + i] * w[d + i], w[e + i] * w[f + i]
            s[x_row + i] += px * p + qx * q + rx * r
            s[y_row + i] += py * p + qy * q + ry * r
            s[z_row + i] += pz * p + qz * q + rz * r
        k += _SIX


@strict
def _clear(s: Array, row: Scalar) -> None:
    for i in range(_TILE):
        s[row + i] = 0.0
        s[row + _STRIDE + i] = 0.0
        s[row + _U(2 * STRIDE) + i] = 0.0


@fma
def _turn(
    s: Array, w: Array, k: Scalar, rows: Offsets, vectors: Array, tangents: Any, cosines: Any, collected: Any
) -> None:
    """Write G = tan|h| h/|h| and C = 2 cos²|h| for half a rotation vector h, the sum of three entries and X, if given."""
    (a, b, c), ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = _three(rows, vectors, k)
    for i in range(_TILE):
        p, q, r = w[a + i], w[b + i], w[c + i]
        x = ax * p + bx * q + cx * r
        y = ay * p + by * q + cy * r
        z = az * p + bz * q + cz * r
        if collected is not None:
            x, y, z = x + s[_X0 + i], y + s[_X1 + i], z + s[_X2 + i]
            s[_X0 + i], s[_X1 + i], s[_X2 + i] = 0.0, 0.0, 0.0
        # with tan and cos² neither a root nor a division is needed; the quaternion (1, G) need not have unit length
        square = x * x + y * y + z * z
        tangent = _series(square, tangents)
        s[_G0 + i] = tangent * x
        s[_G1 + i] = tangent * y
        s[_G2 + i] = tangent * z
        s[_C + i] = _series(square, cosines)


@fma
def _add_cross(
    px: Scalar, py: Scalar, pz: Scalar, gx: Scalar, gy: Scalar, gz: Scalar, ux: Scalar, uy: Scalar, uz: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    return px + gy * uz - gz * uy, py + gz * ux - gx * uz, pz + gx * uy - gy * ux


@fma
def _begin(s: Array, w: Array, k: Scalar, rows: Offsets, vectors: Array, rx: Scalar, ry: Scalar, rz: Scalar) -> None:
    """Do as `_carry` for the first target, where nothing is displaced yet."""
    # the terms of e = 0 and q = 1 are left out
    (a, b, c), ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = _three(rows, vectors, k)
    for i in range(_TILE):
        gx, gy, gz, factor = s[_G0 + i], s[_G1 + i], s[_G2 + i], s[_C + i]
        ux, uy, uz = _add_cross(rx, ry, rz, gx, gy, gz, rx, ry, rz)
        p, q, r = w[a + i], w[b + i], w[c + i]
        ex, ey, ez = ax * p + bx * q + cx * r, ay * p + by * q + cy * r, az * p + bz * q + cz * r
        s[_E0 + i], s[_E1 + i], s[_E2 + i] = _add_cross(ex, ey, ez, gx, gy, gz, factor * ux, factor * uy, factor * uz)
        s[_V + i] = 1.0
        s[_V0 + i] = gx
        s[_V1 + i] = gy
        s[_V2 + i] = gz


@fma
def _carry(s: Array, w: Array, k: Scalar, rows: Offsets, vectors: Array, rx: Scalar, ry: Scalar, rz: Scalar) -> None:
    """Rotate and shift the part of the chain beyond a target: e ← e + (Rot - 1)(r + e) + three entries, q ← (1, G) q."""
    # (Rot - 1) p = G × C (p + G × p) avoids cancellation; q is a multiple of the rotation's quaternion
    (a, b, c), ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = _three(rows, vectors, k)
    for i in range(_TILE):
        gx, gy, gz, factor = s[_G0 + i], s[_G1 + i], s[_G2 + i], s[_C + i]
        ex, ey, ez = s[_E0 + i], s[_E1 + i], s[_E2 + i]
        px, py, pz = rx + ex, ry + ey, rz + ez
        ux, uy, uz = _add_cross(px, py, pz, gx, gy, gz, px, py, pz)
        p, q, r = w[a + i], w[b + i], w[c + i]
        ex, ey, ez = ex + ax * p + bx * q + cx * r, ey + ay * p + by * q + cy * r, ez + az * p + bz * q + cz * r
        s[_E0 + i], s[_E1 + i], s[_E2 + i] = _add_cross(ex, ey, ez, gx, gy, gz, factor * ux, factor * uy, factor * uz)
        v, x, y, z = s[_V + i], s[_V0 + i], s[_V1 + i], s[_V2 + i]
        s[_V + i] = v - gx * x - gy * y - gz * z
        s[_V0 + i], s[_V1 + i], s[_V2 + i] = _add_cross(x + v * gx, y + v * gy, z + v * gz, gx, gy, gz, x, y, z)


@strict
def _too_far(s: Array, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Return the first sample whose half rotation vector X has a length of π/2 or more, or -1."""
    # counted first in a loop without an early exit; the sample is searched only where there is one
    beyond = 0
    for i in range(_TILE):
        x, y, z = s[_X0 + i], s[_X1 + i], s[_X2 + i]
        beyond += 0 if x * x + y * y + z * z < _QUARTER_TURN_SQUARED else 1
    if beyond:
        for sample in range(skipped, count):
            i = _place_of(sample, sampled)
            x, y, z = s[_X0 + i], s[_X1 + i], s[_X2 + i]
            if not x * x + y * y + z * z < _QUARTER_TURN_SQUARED:
                return sample
    return -1


@fma
def _carry_wide(s: Array, rx: Scalar, ry: Scalar, rz: Scalar) -> None:
    """Do as `_carry`, with the quaternion of the half rotation vector X, |X| < π/2."""
    for i in range(_TILE):
        x, y, z = s[_X0 + i], s[_X1 + i], s[_X2 + i]
        square = x * x + y * y + z * z
        sinc = _series(square, _LONG_SINC)
        s[_C + i] = _series(square, _LONG_COSINE)
        s[_G0 + i] = sinc * x
        s[_G1 + i] = sinc * y
        s[_G2 + i] = sinc * z
    for i in range(_TILE):
        a, x, y, z = s[_C + i], s[_G0 + i], s[_G1 + i], s[_G2 + i]
        px, py, pz = rx + s[_E0 + i], ry + s[_E1 + i], rz + s[_E2 + i]
        ux = a * px + (y * pz - z * py)
        uy = a * py + (z * px - x * pz)
        uz = a * pz + (x * py - y * px)
        s[_E0 + i] += 2.0 * (y * uz - z * uy)
        s[_E1 + i] += 2.0 * (z * ux - x * uz)
        s[_E2 + i] += 2.0 * (x * uy - y * ux)
        b, vx, vy, vz = s[_V + i], s[_V0 + i], s[_V1 + i], s[_V2 + i]
        s[_V + i] = a * b - x * vx - y * vy - z * vz
        s[_V0 + i] = a * vx + b * x + (y * vz - z * vy)
        s[_V1 + i] = a * vy + b * y + (z * vx - x * vz)
        s[_V2 + i] = a * vz + b * z + (x * vy - y * vx)


@fma
def _rotation_vector_narrow(s: Array, arc: Any) -> None:
    """Convert the quaternion's vector to the rotation vector in place: 2 atan(|v|/w) v/|v|, up to 0.25 rad."""
    for i in range(_TILE):
        x, y, z = s[_V0 + i], s[_V1 + i], s[_V2 + i]
        # a single division gives both the tangent of half the angle and the scale, for any length of the quaternion
        g = 1.0 / s[_V + i]
        scale = 2.0 * g * _series((x * x + y * y + z * z) * g * g, arc)
        s[_V0 + i] = scale * x
        s[_V1 + i] = scale * y
        s[_V2 + i] = scale * z


@fma
def _rotation_vector_wide(s: Array) -> None:
    """Do as `_rotation_vector_narrow` for angles in [0, π], by halving the angle twice more."""
    for i in range(_TILE):
        x, y, z, a = s[_V0 + i], s[_V1 + i], s[_V2 + i], s[_V + i]
        # q and -q are the same rotation; the one with the smaller angle is used
        sign = 1.0 if a >= 0.0 else -1.0
        square = x * x + y * y + z * z
        g = 1.0 / (np.sqrt(a * a + square) + abs(a))
        t = square * g * g
        h = 1.0 / (1.0 + np.sqrt(1.0 + t))
        scale = sign * 8.0 * g * h * _series(t * h * h, _LONG_ARC)
        s[_V0 + i] = scale * x
        s[_V1 + i] = scale * y
        s[_V2 + i] = scale * z


@strict
def _stay(s: Array) -> None:
    _clear(s, _E0)
    _clear(s, _V0)
    for i in range(_TILE):
        s[_V + i] = 1.0


@inline
def _part(starts: Offsets, k: Scalar) -> Any:
    """Return the first entry of single rows, the first entry of products, and the end of both."""
    return starts[k + k], starts[k + k + _ONE], starts[k + k + _TWO]


@cached_part_inline
def _displace(s: Array, w: Array, motions: Motions, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Compose all targets from tip to base; return the first sample in which a target rotates by π or more, or -1."""
    # The tip's displacement e and rotation q are composed instead of the pose, which avoids cancellation. X is zero
    # before and after.
    turn_rows, turns, shift_rows, shifts = motions.turn_rows, motions.turns, motions.shift_rows, motions.shifts
    at_rest = True
    targets = motions.arms.shape[0]
    for k in range(_U(targets)):
        turn, turn_products, turn_end = _part(motions.turn_starts, k)
        shift, shift_products, shift_end = _part(motions.shift_starts, k)
        rx, ry, rz = motions.arms[k, 0], motions.arms[k, 1], motions.arms[k, 2]
        if turn < turn_end:
            # of the single rows, all but the last three of a turn are summed first; the last three, and the first three of the
            # shift, are added in the loop of `_turn` and `_carry`
            last_three = turn_products - _THREE
            _mix(s, w, _X0, turn, last_three, turn_rows, turns)
            _mix_products(s, w, _X0, turn_products, turn_end, turn_rows, turns)
            if motions.series[k] == WIDE:
                rows, vectors = _three(turn_rows, turns, last_three)
                _add(s, w, _X0, rows, vectors)
                sample = _too_far(s, skipped, count, sampled)
                if sample >= 0:
                    return sample
                if at_rest:
                    _stay(s)
                _carry_wide(s, rx, ry, rz)
                rows, vectors = _three(shift_rows, shifts, shift)
                _add(s, w, _E0, rows, vectors)
                _clear(s, _X0)
            else:
                if motions.series[k] != FINE:
                    _turn(s, w, last_three, turn_rows, turns, _TANGENT, _COSINE_SQUARED, True)
                elif turn + _THREE < turn_end:
                    _turn(s, w, last_three, turn_rows, turns, _FINE_TANGENT, _FINE_COSINE, True)
                else:
                    _turn(s, w, last_three, turn_rows, turns, _FINE_TANGENT, _FINE_COSINE, None)
                if at_rest:
                    _begin(s, w, shift, shift_rows, shifts, rx, ry, rz)
                else:
                    _carry(s, w, shift, shift_rows, shifts, rx, ry, rz)
            shift += _THREE
        elif at_rest:
            _stay(s)
        at_rest = False
        _mix(s, w, _E0, shift, shift_products, shift_rows, shifts)
        _mix_products(s, w, _E0, shift_products, shift_end, shift_rows, shifts)
    if at_rest:
        _stay(s)
    if motions.series[targets] == WIDE:
        _rotation_vector_wide(s)
    elif motions.series[targets] == NARROW:
        _rotation_vector_narrow(s, _SHORT_ARC)
    else:
        _rotation_vector_narrow(s, _FINE_ARC)
    return -1


@cached_part_inline
def _superpose(s: Array, w: Array, superposition: Superposition, pose: Scalar) -> None:
    """Write the six errors of the linear model to the rows that `_displace` uses."""
    shift_rows, shifts, turn_rows, turns, starts = superposition
    # columns: shifts, turns
    begin, products, end = _part(starts, pose)
    _clear(s, _E0)
    _clear(s, _V0)
    _mix(s, w, _E0, begin[0], products[0], shift_rows, shifts)
    _mix_products(s, w, _E0, products[0], end[0], shift_rows, shifts)
    _mix(s, w, _V0, begin[1], products[1], turn_rows, turns)
    _mix_products(s, w, _V0, products[1], end[1], turn_rows, turns)


@inline
def _at_pose(motions: Motions, pose: Scalar) -> Motions:
    """Return the motions of one of several poses."""
    return Motions(
        motions.shift_starts[pose],
        motions.shift_rows,
        motions.shifts,
        motions.turn_starts[pose],
        motions.turn_rows,
        motions.turns,
        motions.arms[pose],
        motions.series[pose],
    )


@strict
def _visit(s: Array, w: Array, datum: Datum, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Write the errors at the visits of a datum to their rows; return as `_displace`."""
    for visit in range(datum.results.shape[0]):
        sample = _displace(s, w, _at_pose(datum.motions, visit), skipped, count, sampled)
        if sample >= 0:
            return sample
        for c in range(_U(6)):
            row, result = (c + _ONE + c // _THREE) * _STRIDE, datum.results[visit, c]
            for i in range(_TILE):
                w[result + i] = s[row + i]
    return -1


@fma
def _add_datum(s: Array, w: Array, datum: Datum, pose: Scalar) -> None:
    """Add what the datum adds to the six errors of a pose."""
    for r in range(datum.rows.size):
        for c in range(_U(6)):
            gain, row = datum.gains[pose, r, c], (c + _ONE + c // _THREE) * _STRIDE
            if gain != 0.0:
                for i in range(_TILE):
                    s[row + i] += gain * w[datum.rows[r] + i]


# counting ------------------------------------------------------------------------------------------------------------


@strict
def _place_of(sample: Scalar, sampled: bool) -> Scalar:
    """Return the index of a sample of the tile within a row."""
    if sampled:
        return _U((sample >> 1) + (sample & 1) * (TILE // 2))
    return _U(sample)


@cached_part
def _norms(s: Array) -> Scalar:
    """Write the two norms; return the number of samples that are not finite."""
    failures = 0
    for part in range(_TWO):
        norm = part * _U(4 * STRIDE)
        for i in range(_TILE):
            x, y, z = s[norm + _STRIDE + i], s[norm + _U(2 * STRIDE) + i], s[norm + _U(3 * STRIDE) + i]
            # squares that overflow become infinite and are reported as errors that are not finite
            length = np.sqrt(x * x + y * y + z * z)
            s[norm + i] = length
            failures += 0 if length < np.inf else 1
    return failures


@strict
def _not_finite(s: Array, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Return the first sample that is not finite, or -1."""
    for sample in range(skipped, count):
        i = _place_of(sample, sampled)
        if not (s[_D + i] < np.inf and s[_T + i] < np.inf):
            return sample
    return -1


@cached_part
def _keep_largest(s: Array, count: Scalar, first: Scalar, largest: Array, units: NDArray[np.int64]) -> None:
    """Keep the largest norms in descending order, of equal ones the earlier unit's."""
    least_distance, least_angle = largest[0, LARGEST - 1], largest[1, LARGEST - 1]
    # a first loop without early exit: after the first tiles hardly any tile has one of the largest norms
    above = 0
    for i in range(_TILE):
        above += 1 if (s[_D + i] > least_distance) | (s[_T + i] > least_angle) else 0
    if above:
        for row in range(2):
            values = _U(row) * _FOUR * _STRIDE
            for sample in range(count):
                value = s[values + _place_of(sample, True)]
                place = LARGEST
                while place > 0 and value > largest[row, place - 1]:
                    place -= 1
                if place < LARGEST:
                    for k in range(LARGEST - 1, place, -1):
                        largest[row, k] = largest[row, k - 1]
                        units[row, k] = units[row, k - 1]
                    largest[row, place] = value
                    units[row, place] = np.int64(first) + sample


@inline
def _four(s: Array, first: Scalar, step: Scalar) -> Any:
    return s[first], s[first + step], s[first + _TWO * step], s[first + _THREE * step]


@inline
def _put_four(s: Array, first: Scalar, step: Scalar, values: Any) -> None:
    s[first], s[first + step], s[first + _TWO * step], s[first + _THREE * step] = values


@inline
def _lesser(a: Any, b: Any) -> Any:
    return (
        b[0] if b[0] < a[0] else a[0],
        b[1] if b[1] < a[1] else a[1],
        b[2] if b[2] < a[2] else a[2],
        b[3] if b[3] < a[3] else a[3],
    )


@inline
def _greater(a: Any, b: Any) -> Any:
    return (
        b[0] if b[0] > a[0] else a[0],
        b[1] if b[1] > a[1] else a[1],
        b[2] if b[2] > a[2] else a[2],
        b[3] if b[3] > a[3] else a[3],
    )


@strict
def _measure_some(s: Array, centre: Array, count: Scalar) -> Scalar:
    """Do as `_measure` for the first samples of a tile, one by one; the residuals of the others are zero."""
    # in the order of `_measure`, lane by lane; the zeros of unrequested samples change no sum
    failures = _norms(s)
    for q in range(_U(8)):
        for i in range(_TILE):
            lane = _LANES + q * _LANE + i % _LANE
            residual = 0.0
            # the sample at index i, even ones first
            if (i + i if i < _PAIRS else i + i - (_TILE - _ONE)) < _U(count):
                value = s[q * _STRIDE + i]
                residual = value - centre[q]
                low, high = lane + _U(SUMS) * _LANE, lane + _U(SUMS + 8) * _LANE
                s[low] = value if value < s[low] else s[low]
                s[high] = value if value > s[high] else s[high]
            s[_RESIDUALS + q * _STRIDE + i] = residual
            s[lane] += residual
    return failures


@cached_part
def _measure(s: Array, centre: Array, count: Scalar) -> Scalar:
    """Write norms and residuals, add these to their lanes, update the extremes; count the non-finite samples."""
    # all is done in one loop, because the processor does the rest while it waits for the square roots
    if count < TILE:
        return _measure_some(s, centre, count)
    failures = 0
    for part in range(_TWO):
        rows = part * _FOUR * _STRIDE
        sums = _LANES + part * _FOUR * _LANE
        lows, highs = sums + _U(SUMS) * _LANE, sums + _U(SUMS + 8) * _LANE
        # a norm and its three components together, so that the components are read once
        middle = _four(centre, part * _FOUR, _ONE)
        for lane in range(_LANE):
            # each lane adds every sixteenth sample in order, so that the bits do not depend on the processor's vector width
            total, low, high = _four(s, sums + lane, _LANE), _four(s, lows + lane, _LANE), _four(s, highs + lane, _LANE)
            for k in range(_U(TILE // LANES)):
                i = rows + k * _LANE + lane
                _, x, y, z = _four(s, i, _STRIDE)
                length = np.sqrt(x * x + y * y + z * z)
                s[i] = length
                failures += 0 if length < np.inf else 1
                values = (length, x, y, z)
                low, high = _lesser(low, values), _greater(high, values)
                residuals = (length - middle[0], x - middle[1], y - middle[2], z - middle[3])
                _put_four(s, _RESIDUALS + i, _STRIDE, residuals)
                total = (
                    total[0] + residuals[0],
                    total[1] + residuals[1],
                    total[2] + residuals[2],
                    total[3] + residuals[3],
                )
            _put_four(s, sums + lane, _LANE, total)
            _put_four(s, lows + lane, _LANE, low)
            _put_four(s, highs + lane, _LANE, high)
    return failures


@cached_part
def _find_bins(s: Array, bins: Bins, held: Scalar, inverse_scale: Array) -> None:
    """Write the bins of the residuals in the sketch, for up to `HELD` tiles, quantity by quantity."""
    # only the upper halves of the scaled residuals are needed; they are stored after the tiles
    for q in range(_U(8)):
        residuals, halves, factor = _RESIDUALS + q * _STRIDE, (_U(8 * HELD) + q) * _TILE, inverse_scale[q]
        for i in range(_TILE):
            bins[halves + i] = np.uint32(_bits_of(s[residuals + i] * factor) >> _HALF_WORD)
    for q in range(_U(8)):
        first, halves = (q * _U(HELD) + _U(held)) * _TILE, (_U(8 * HELD) + q) * _TILE
        # from here on only whole numbers of 32 bits, of which a vector holds twice as many
        zero = np.int32(q * _U(2 * _BINS) + _U(_BINS))
        for i in range(_TILE):
            half = np.int32(bins[halves + i])
            magnitude = np.int32(((half & _ALL_BUT_SIGN) >> np.int32(_SHIFT - 32)) - np.int32(_OFFSET - 1))
            magnitude = np.int32(min(max(magnitude, np.int32(0)), np.int32(_BINS - 1)))
            # upwards from zero, or downwards from zero - 1 for a negative residual
            bins[first + i] = np.uint32(zero + np.int32(magnitude ^ np.int32(half >> _SIGN)))


@strict
def _count_bins(bins: Bins, first: Scalar, tiles: Scalar, count: Scalar, sketch: NDArray[np.uint32]) -> None:
    """Count the bins of the samples in some tiles, of the last tile only ``count`` samples."""
    # whole tiles, then the excess is subtracted, so that the loop needs no test; a count below zero wraps around and back
    last = first + (_U(tiles) - _ONE) * _TILE
    for i in range(first, last + _TILE):
        sketch[bins[i]] += np.uint32(1)
    for sample in range(count, TILE):
        sketch[bins[last + _place_of(sample, True)]] -= np.uint32(1)


@cached_part
def _count_all_bins(bins: Bins, tiles: Scalar, count: Scalar, sketch: NDArray[np.uint32]) -> None:
    """Count the bins of `_find_bins`, quantity by quantity, so that its part of the sketch stays cached."""
    for q in range(_U(8)):
        _count_bins(bins, q * _U(HELD) * _TILE, tiles, count, sketch)


@strict
def _sketch_norms(s: Array, bins: Bins, count: Scalar, inverse_scale: Array, sketch: NDArray[np.uint32]) -> None:
    """Count the residuals of the two norms in the small sketch."""
    for part in range(_TWO):
        residuals, first = _RESIDUALS + part * _U(4 * STRIDE), part * _U(NORM_COLUMNS)
        factor = inverse_scale[part * _FOUR]
        for i in range(_TILE):
            scaled = s[residuals + i] * factor
            shifted = _bits_of(abs(scaled)) >> _NORM_SHIFT
            magnitude = shifted - _NORM_OFFSET if shifted > _NORM_OFFSET else _ZERO
            magnitude = magnitude if magnitude < _NORM_LAST else _NORM_LAST
            bins[i] = np.uint32(first + (_NORM_LAST - magnitude if scaled < 0.0 else _NORM_LAST + _ONE + magnitude))
        _count_bins(bins, _ZERO, 1, count, sketch)


@strict
def _keeps(s: Array, i: Scalar, conditions: Conditions, begin: Scalar, end: Scalar) -> bool:
    """Return whether a sample keeps the conditions of a specification, as in `statistics.limits`."""
    for c in range(begin, end):
        square = 0.0
        for row in range(_THREE):
            along = conditions.matrices[c, row, _ZERO] * s[_STRIDE + i]
            for k in range(_ONE, _SIX):
                along = along + conditions.matrices[c, row, k] * s[(k + _ONE + k // _THREE) * _STRIDE + i]
            square = square + along * along
        length = np.sqrt(square)
        if conditions.tilts[c]:
            x, y, z = s[_U(5 * STRIDE) + i], s[_U(6 * STRIDE) + i], s[_U(7 * STRIDE) + i]
            quarter = 0.25 * (x * x + y * y + z * z)
            shortening = SINE_SERIES[-1]
            for k in range(1, len(SINE_SERIES)):
                shortening = shortening * quarter + SINE_SERIES[-1 - k]
            length = length * shortening
        if not length <= conditions.limits[c]:
            return False
    return True


@cached_part
def _count_inside(s: Array, count: Scalar, counting: Counting, inside: NDArray[np.int64]) -> None:
    for k in range(counting.limits.size):
        begin, end = counting.conditions.starts[k], counting.conditions.starts[k + 1]
        if begin < end:
            for sample in range(count):
                inside[k] += 1 if _keeps(s, _place_of(sample, True), counting.conditions, begin, end) else 0
            continue
        row, limit = counting.limit_rows[k] * _STRIDE, counting.limits[k]
        count_inside = 0
        for i in range(_TILE):
            count_inside += 1 if abs(s[row + i]) <= limit else 0
        for sample in range(count, TILE):
            count_inside -= 1 if abs(s[row + _place_of(sample, True)]) <= limit else 0
        inside[k] += count_inside


@cached_part
def _add_products(s: Array) -> None:
    """Add the products of the residuals to their lanes: of two components each, then the square of each norm."""
    # 64 samples at a time: the 23 sums of a lane are read and written once for four samples
    for begin in range(_ZERO, _TILE, _U(4 * LANES)):
        for lane in range(_LANE):
            xx, xy, xz = s[_P0 + lane], s[_P1 + lane], s[_P2 + lane]
            xa, xb, xc = s[_P3 + lane], s[_P4 + lane], s[_P5 + lane]
            yy, yz, ya, yb, yc = s[_P6 + lane], s[_P7 + lane], s[_P8 + lane], s[_P9 + lane], s[_P10 + lane]
            zz, za, zb, zc = s[_P11 + lane], s[_P12 + lane], s[_P13 + lane], s[_P14 + lane]
            aa, ab, ac = s[_P15 + lane], s[_P16 + lane], s[_P17 + lane]
            bb, bc = s[_P18 + lane], s[_P19 + lane]
            cc = s[_P20 + lane]
            dd, tt = s[_P21 + lane], s[_P22 + lane]
            for turn in range(_FOUR):
                i = begin + turn * _LANE + lane
                d, x, y, z = s[_R0 + i], s[_R1 + i], s[_R2 + i], s[_R3 + i]
                t, a, b, c = s[_R4 + i], s[_R5 + i], s[_R6 + i], s[_R7 + i]
                xx, xy, xz, xa, xb, xc = xx + x * x, xy + x * y, xz + x * z, xa + x * a, xb + x * b, xc + x * c
                yy, yz, ya, yb, yc = yy + y * y, yz + y * z, ya + y * a, yb + y * b, yc + y * c
                zz, za, zb, zc = zz + z * z, za + z * a, zb + z * b, zc + z * c
                aa, ab, ac = aa + a * a, ab + a * b, ac + a * c
                bb, bc = bb + b * b, bc + b * c
                cc = cc + c * c
                dd, tt = dd + d * d, tt + t * t
            s[_P0 + lane], s[_P1 + lane], s[_P2 + lane] = xx, xy, xz
            s[_P3 + lane], s[_P4 + lane], s[_P5 + lane] = xa, xb, xc
            s[_P6 + lane], s[_P7 + lane], s[_P8 + lane], s[_P9 + lane], s[_P10 + lane] = yy, yz, ya, yb, yc
            s[_P11 + lane], s[_P12 + lane], s[_P13 + lane], s[_P14 + lane] = zz, za, zb, zc
            s[_P15 + lane], s[_P16 + lane], s[_P17 + lane] = aa, ab, ac
            s[_P18 + lane], s[_P19 + lane] = bb, bc
            s[_P20 + lane] = cc
            s[_P21 + lane], s[_P22 + lane] = dd, tt


@cached_part
def _fold(s: Array, sums: Array) -> None:
    """Fold the lanes of each sum in halves, add them to the sums and clear them."""
    for k in range(_U(SUMS)):
        lanes = _LANES + k * _LANE
        # in halves: this order of additions is the same for every vector width
        half = LANES // 2
        while half:
            for lane in range(_U(half)):
                s[lanes + lane] += s[lanes + _U(half) + lane]
            half //= 2
        sums[k] = s[lanes]
        for lane in range(_LANE):
            s[lanes + lane] = 0.0


@cached_part
def _empty_lanes(s: Array, lowest: Array, highest: Array) -> None:
    """Set the sums to zero, and the extremes to the given smallest and largest values."""
    for i in range(_U(SUMS * LANES)):
        s[_LANES + i] = 0.0
    for q in range(_U(8)):
        for lane in range(_LANE):
            s[_LANES + (_U(SUMS) + q) * _LANE + lane] = lowest[q]
            s[_LANES + (_U(SUMS + 8) + q) * _LANE + lane] = highest[q]


@cached_part
def _fold_extremes(s: Array, lowest: Array, highest: Array) -> None:
    for q in range(_U(8)):
        for lane in range(_LANE):
            low = s[_LANES + (_U(SUMS) + q) * _LANE + lane]
            high = s[_LANES + (_U(SUMS + 8) + q) * _LANE + lane]
            lowest[q] = low if low < lowest[q] else lowest[q]
            highest[q] = high if high > highest[q] else highest[q]


@strict
def _failed_formula(w: Array, formulas: Formulas, skipped: Scalar, count: Scalar, sampled: bool) -> Scalar:
    """Return the first sample with an operation whose result is not finite, or -1."""
    for sample in range(skipped, count):
        i = _place_of(sample, sampled)
        for step in range(formulas.results.size):
            if not abs(w[formulas.results[step] + i]) < np.inf:
                return sample
    return -1


@cached_entry
def run(
    s: Array,
    bins: Bins,
    products: Offsets,
    w: Array,
    draws: Draws,
    formulas: Formulas,
    superposition: Superposition,
    motions: Motions,
    datum: Datum | None,
    stage: Scalar,
    rare: Wanted,
    linear: Wanted,
    seed: Scalar,
    words: Offsets,
    first: Scalar,
    skip: Scalar,
    count: Scalar,
    given: Array,
    component_output: Array,
    error_output: Array,
    counting: Counting,
    sums: Array,
    lowest: Array,
    highest: Array,
    sketch: NDArray[np.uint32],
    inside: NDArray[np.int64],
    largest: Array,
    largest_units: NDArray[np.int64],
) -> tuple[Scalar, Scalar]:
    """Sample tile by tile; return the reason for stopping, 0 if the run is complete, and the sample.

    Args:
        s, bins, products, w: Work arrays: `SCRATCH` rows; ``(8 · (HELD + 1) · TILE,)``; ``(3/2 · TILE,)``; the rows of
            the offsets. All except the bins are aligned to 64 bytes.
        draws, formulas, superposition, motions, datum: Arrays of the error model; the superposition holds the datum.
        stage: Last stage: `DRAW` draws only, `LINEAR` and `EXACT` compute errors.
        rare, linear: True for rare laws, and for the linear model; otherwise None.
        seed, words: Key, and the last counter word of each stream.
        first, skip, count: First unit, a multiple of `TILE`; unrequested samples at the beginning, which may fail;
            samples including these.
        given: ``(d, count)`` component values to use; without columns they are drawn.
        component_output, error_output: ``(d, count)`` and ``(6, count)`` arrays to fill; none without columns.
        counting, sums, lowest, highest, sketch, inside, largest, largest_units: Centres, bins and limits; ``(atoms,
            SUMS)`` partial sums, without rows nothing is counted; ``(8,)``; ``(8,)``; ``(8 · COLUMNS,)``; ``(S,)``;
            ``(2, LARGEST)`` and their units. The last six are updated.
    """
    # the rows of constants are filled once; drawing does not change them
    for row in range(draws.fixed_rows.size):
        for i in range(_TILE):
            w[draws.fixed_rows[row] + i] = draws.fixed_values[row]
    _clear(s, _X0)
    counted = sums.shape[0] > 0
    if counted:
        _empty_lanes(s, lowest, highest)
    sampled = given.shape[1] == 0
    components = given.shape[0]
    tiles = (count + TILE - 1) // TILE
    for tile in range(tiles):
        begin = tile * TILE
        size = TILE if count - begin > TILE else count - begin
        skipped = skip if tile == 0 else 0
        if sampled:
            uniforms(w, draws.stream_rows, draws.streams, words, seed, (first >> _ONE) + _U(tile) * _PAIRS, products)
            apply_laws(w, draws, rare)
        else:
            for k in range(components):
                offset = _U(k * STRIDE)
                for i in range(size):
                    w[offset + _U(i)] = given[k, begin + i]
                # the rest of the last tile repeats a sample, so that its values are valid
                for i in range(size, TILE):
                    w[offset + _U(i)] = given[k, begin]
        if component_output.shape[1]:
            for k in range(components):
                offset = _U(k * STRIDE)
                for i in range(size):
                    component_output[k, begin + i] = w[offset + _place_of(i, sampled)]
        if stage == DRAW:
            continue
        # a failure in an unrequested sample does not stop the run
        if _derive(w, formulas):
            sample = _failed_formula(w, formulas, skipped, size, sampled)
            if sample >= 0:
                return FORMULA, begin + sample
        if linear is not None:
            _superpose(s, w, superposition, _ZERO)
        else:
            if datum is not None:
                sample = _visit(s, w, datum, skipped, size, sampled)
                if sample >= 0:
                    return ANGLE, begin + sample
            sample = _displace(s, w, motions, skipped, size, sampled)
            if sample >= 0:
                return ANGLE, begin + sample
            if datum is not None:
                _add_datum(s, w, datum, _ZERO)
        failures = _measure(s, counting.centre, size) if counted else _norms(s)
        if failures:
            sample = _not_finite(s, skipped, size, sampled)
            if sample >= 0:
                return NOT_FINITE, begin + sample
        if error_output.shape[1]:
            for c in range(6):
                offset = _U((c + 1 + c // 3) * STRIDE)
                for i in range(size):
                    error_output[c, begin + i] = s[offset + _place_of(i, sampled)]
        if counted:
            _keep_largest(s, size, first + _U(begin), largest, largest_units)
            _count_inside(s, size, counting, inside)
            _add_products(s)
            # bins are counted for several tiles at once: a quantity's part of the sketch then stays in the cache
            held = tile % HELD
            _find_bins(s, bins, held, counting.inverse_scale)
            if held == HELD - 1 or tile == tiles - 1:
                _count_all_bins(bins, held + 1, size, sketch)
            # this assumes that a counted run starts at the first unit of an atom
            if (begin + TILE) % ATOM == 0 or tile == tiles - 1:
                _fold(s, sums[begin // ATOM])
    if counted:
        _fold_extremes(s, lowest, highest)
    return 0, 0


# many poses ----------------------------------------------------------------------------------------------------------


@strict
def _keep_lanes(s: Array, lanes: Array) -> None:
    for k in range(_U(LANE_DOUBLES)):
        lanes[k] = s[_LANES + k]


@cached_entry
def run_poses(
    s: Array,
    bins: Bins,
    products: Offsets,
    w: Array,
    lanes: Array,
    unit_draws: Draws,
    draws: Draws,
    unit_formulas: Formulas,
    formulas: Formulas,
    superposition: Superposition,
    motions: Motions,
    datum: Datum | None,
    rare: Wanted,
    linear: Wanted,
    seed: Scalar,
    unit_words: Offsets,
    words: Offsets,
    first: Scalar,
    count: Scalar,
    centre: Array,
    inverse_scale: Array,
    limit_rows: Offsets,
    limits: Array,
    conditions: Conditions,
    sums: Array,
    lowest: Array,
    highest: Array,
    sketch: NDArray[np.uint32],
    inside: NDArray[np.int64],
) -> tuple[Scalar, Scalar, Scalar]:
    """Sample P poses tile by tile; return the reason for stopping, 0 if the run is complete, the pose and the sample.

    Args:
        s, bins, products, w: Work arrays as in `run`.
        lanes: ``(P, LANE_DOUBLES)`` work array.
        unit_draws, unit_formulas, unit_words: Draws of unit scope and formulas, evaluated once for a tile.
        draws, formulas, words: Draws and formulas evaluated at every pose; ``words`` is ``(P, streams)``.
        superposition, motions: Entries of all poses, concatenated; motions have starts ``(P, 2 K + 1)``, arms ``(P, K,
            3)``, series ``(P, K + 1)``.
        datum: As in `run`; its draws and formulas are of unit scope.
        rare, linear, seed, first, count: As in `run`.
        centre, inverse_scale: ``(P, 8)`` centres and reciprocals of the scales.
        limit_rows, limits, conditions: ``(S,)`` quantities and their limits; conditions of others at all poses.
        sums, lowest, highest, sketch, inside: As in `run`, with a first axis of length P; the sketches are the small
            ones of the two norms.
    """
    # variables, because literal constants are other types to numba, for which it would compile the callees again
    nobody, sampled = np.int64(0), count > 0
    for row in range(unit_draws.fixed_rows.size):
        for i in range(_TILE):
            w[unit_draws.fixed_rows[row] + i] = unit_draws.fixed_values[row]
    _clear(s, _X0)
    poses = centre.shape[0]
    for pose in range(poses):
        _empty_lanes(s, lowest[pose], highest[pose])
        _keep_lanes(s, lanes[pose])
    tiles = (count + TILE - 1) // TILE
    for tile in range(tiles):
        begin = tile * TILE
        size = TILE if count - begin > TILE else count - begin
        pair = (first >> _ONE) + _U(tile) * _PAIRS
        uniforms(w, unit_draws.stream_rows, unit_draws.streams, unit_words, seed, pair, products)
        apply_laws(w, unit_draws, rare)
        if _derive(w, unit_formulas):
            sample = _failed_formula(w, unit_formulas, 0, size, True)
            if sample >= 0:
                return FORMULA, 0, begin + sample
        if datum is not None and linear is None:
            sample = _visit(s, w, datum, nobody, size, sampled)
            if sample >= 0:
                return ANGLE, 0, begin + sample
        for pose in range(poses):
            at = _at_pose(motions, pose)
            here = Conditions(conditions.starts, conditions.matrices[pose], conditions.limits, conditions.tilts)
            counting = Counting(centre[pose], inverse_scale[pose], limit_rows, limits, here)
            own_lanes = lanes[pose]
            if draws.stream_rows.size:
                uniforms(w, draws.stream_rows, draws.streams, words[pose], seed, pair, products)
                apply_laws(w, draws, rare)
            if _derive(w, formulas):
                sample = _failed_formula(w, formulas, 0, size, True)
                if sample >= 0:
                    return FORMULA, pose, begin + sample
            if linear is not None:
                _superpose(s, w, superposition, _U(pose))
            else:
                sample = _displace(s, w, at, nobody, size, sampled)
                if sample >= 0:
                    return ANGLE, pose, begin + sample
                if datum is not None:
                    _add_datum(s, w, datum, _U(pose))
            # restore the pose's sums after its preceding tile
            for k in range(_U(LANE_DOUBLES)):
                s[_LANES + k] = own_lanes[k]
            if _measure(s, counting.centre, size):
                sample = _not_finite(s, 0, size, True)
                if sample >= 0:
                    return NOT_FINITE, pose, begin + sample
            _count_inside(s, size, counting, inside[pose])
            _add_products(s)
            _sketch_norms(s, bins, size, counting.inverse_scale, sketch[pose])
            if (begin + TILE) % ATOM == 0 or tile == tiles - 1:
                _fold(s, sums[pose, begin // ATOM])
            _keep_lanes(s, own_lanes)
    for pose in range(poses):
        for k in range(_U(LANE_DOUBLES)):
            s[_LANES + k] = lanes[pose, k]
        _fold_extremes(s, lowest[pose], highest[pose])
    return 0, 0, 0
