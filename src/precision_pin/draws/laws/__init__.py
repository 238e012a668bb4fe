"""Probability distributions of draws.

A law is a distribution of ``size`` components, in SI. Each law gives samples from ``size`` independent variates, mean,
covariance, the support function h(w) = max over its support of w·x (infinite if unbounded) and the characteristic
function E exp(i t·x).
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

from precision_pin.base.extensions import Extension, find_extensions
from precision_pin.draws.laws.law import Law
from precision_pin.draws.laws.lognormal import Lognormal
from precision_pin.draws.laws.measured import Empirical, JointNormal, Rows, TwoPoint
from precision_pin.draws.laws.projection import FARTHEST_NORMAL
from precision_pin.draws.laws.sphere import Sphere
from precision_pin.draws.laws.symmetric import (
    Arcsine,
    Circle,
    Disc,
    Fixed,
    Normal,
    Triangular,
    TruncatedNormal,
    Uniform,
)

__all__ = [
    "FARTHEST_NORMAL",
    "LAWS",
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
    "Sphere",
    "Triangular",
    "TruncatedNormal",
    "TwoPoint",
    "Uniform",
    "laws_of_sheets",
]

LAWS: Final[tuple[type[Law], ...]] = (
    Fixed,
    Uniform,
    Normal,
    TruncatedNormal,
    Triangular,
    Lognormal,
    Arcsine,
    TwoPoint,
    Empirical,
    Disc,
    Circle,
    Sphere,
    JointNormal,
    Rows,
)
"""Every law, in the order of messages, schema and documentation."""


def laws_of_sheets() -> Mapping[str, type[Law]]:
    """Return all laws that a sheet can name, by key, including those installed by other packages."""
    installed = (extension.value for extension in extensions() if not extension.error)
    return _by_key((*LAWS, *installed))


def extensions() -> tuple[Extension, ...]:
    """Return the laws installed by other packages, usable or not."""
    return find_extensions("laws", _check)


def _check(law: object) -> str:
    if not (inspect.isclass(law) and issubclass(law, Law)):
        return "not a subclass of precision_pin.draws.laws.Law"
    if not law.form.key:
        return "its form has no key, so sheets cannot name it"
    return f"the key {law.form.key!r} is taken" if law.form.key in _by_key(LAWS) else ""


@cache  # sheets have thousands of laws
def _by_key(laws: tuple[type[Law], ...]) -> Mapping[str, type[Law]]:
    return MappingProxyType({law.form.key: law for law in laws if law.form.key})
