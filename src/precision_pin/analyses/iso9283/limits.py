"""Limit of RP for many cycles.

For normal positions with covariance Λ the distance l from the barycentre has mean m = E|z| and variance tr Λ - m², so

    RP → m + 3 √(tr Λ - m²).

With z = √Λ g and g split into length and direction, m = E|g| · mean over the sphere of √(λ₁n₁² + λ₂n₂² + λ₃n₃²), and that
mean is Carlson's elliptic integral R_G(λ₁, λ₂, λ₃) (https://dlmf.nist.gov/19.16.E3).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.special import elliprg

from precision_pin.base.arrays import Array

_MEAN_LENGTH: Final = 2 * math.sqrt(2 / math.pi)
"""E|g| of three independent standard normal numbers."""


def mean_distance(covariances: Array) -> Array:
    """Return E|z| of normal vectors with covariances ``(…, 3, 3)``, which may be singular."""
    values = _eigenvalues(covariances)
    # scaled to their trace: covariances of 1e-12 m² are far above the least of what the integral takes, products of them are not
    trace = values.sum(axis=-1)
    shares = values / np.where(trace > 0, trace, 1.0)[..., None]
    result: Array = _MEAN_LENGTH * np.sqrt(trace) * elliprg(shares[..., 0], shares[..., 1], shares[..., 2])
    return result


def repeatability_limit(covariances: Array) -> Array:
    """Return the limit of RP for many cycles with normal positions of covariances ``(…, 3, 3)``."""
    mean = mean_distance(covariances)
    trace = _eigenvalues(covariances).sum(axis=-1)
    result: Array = mean + 3 * np.sqrt(np.maximum(trace - mean * mean, 0.0))
    return result


def _eigenvalues(covariances: Array) -> Array:
    result: Array = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    return result
