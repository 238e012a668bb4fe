"""The laws that random numbers follow.

A law is a distribution of ``size`` numbers together. Each gives: a sample from as many independent variates, mean,
covariance, the support function h(w) = max over its support of w·x (infinite if unbounded) and the characteristic
function E exp(i t·x). Numbers are SI.
"""

from precision_pin.draws.laws.asymmetric import Empirical, Lognormal, TwoPoint
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Law
from precision_pin.draws.laws.several import Circle, Disc, JointNormal, Rows
from precision_pin.draws.laws.symmetric import Arcsine, Fixed, Normal, Triangular, TruncatedNormal, Uniform

__all__ = [
    "FARTHEST_NORMAL",
    "Arcsine",
    "Circle",
    "Disc",
    "Empirical",
    "Fixed",
    "JointNormal",
    "Law",
    "Lognormal",
    "Normal",
    "Rows",
    "Triangular",
    "TruncatedNormal",
    "TwoPoint",
    "Uniform",
]
