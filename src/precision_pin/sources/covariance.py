"""Measured covariance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from precision_pin.draws.laws import JointNormal
from precision_pin.sources.places import AtPlace
from precision_pin.terms import Draw, InputError, LabelledSpace, Posture, Scope, Term, units

_SIX: Final = units.PerEntry((units.LENGTH,) * 3 + (units.ANGLE,) * 3)
"""Quantities of x, y, z, rx, ry, rz."""


@dataclass(frozen=True, kw_only=True)
class Covariance(AtPlace):
    """Six jointly normal errors of any place, such as from a calibration or a tracker: mean and 6×6 covariance.

    The place's displacement is ``Trans(x, y, z)·Exp((rx, ry, rz))`` with (x, y, z, rx, ry, rz) normal in the place's own
    axes; displacements of the same place by other sources add. With standard deviations s and correlation C the covariance is
    ``s_i C_ij s_j``. Source: JCGM 101:2008 (GUM supplement 1), 6.4.8.

    Attributes:
        joint, link, frame: The place; give one of the three: the seat of a joint (its URDF origin frame before its
            motion; if the base is beyond the joint, the frame of its child link), the end of the chain link that a URDF
            link belongs to (the next joint's origin frame, or the tip), or the frame of a URDF link on the path to the
            tip.
        std: Standard deviations of x, y, z, rx, ry, rz.
        correlation: Correlation of the six, with ``std``: rows of plain numbers, symmetric, with 1 on the diagonal
            (default: none).
        matrix: Instead of ``std`` and ``correlation``: the covariance itself, rows of plain numbers in m², m·rad and
            rad².
        mean: Mean of the six (default: zero).
        scope: How often the errors are drawn: ``unit``, ``pose`` or ``visit``.

    Raises:
        InputError: Not one place, not one of std and matrix, or a matrix that is not 6×6, not symmetric or has a
            negative eigenvalue.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Covariance(frame="tool", std=(1e-4, 2e-4, 3e-4, 0.0, 0.0, 0.0))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.1 0.3 0.2]
    """

    words: ClassVar[Mapping[str, str]] = {"error": "error of {subject}, given as covariance"}

    std: Annotated[tuple[float, ...] | None, _SIX] = None
    correlation: Annotated[tuple[tuple[float, ...], ...] | None, units.RATIO] = None
    matrix: Annotated[tuple[tuple[float, ...], ...] | None, units.RATIO] = None
    mean: Annotated[tuple[float, ...] | None, _SIX] = None
    scope: Literal["unit", "pose", "visit"] = "unit"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.std is None) == (self.matrix is None):
            raise InputError("covariance needs either std: or matrix:")
        if self.matrix is not None and self.correlation is not None:
            raise InputError("correlation: of covariance is used only with std:, not with matrix:")
        for name in ("std", "mean"):
            entries = getattr(self, name)
            if entries is not None and len(entries) != 6:
                raise InputError(f"{name}: of covariance has {len(entries)} numbers, expected 6: x, y, z, rx, ry, rz")
        for name in ("correlation", "matrix"):
            rows = getattr(self, name)
            if rows is not None and (len(rows) != 6 or any(len(row) != 6 for row in rows)):
                raise InputError(f"{name}: of covariance must be 6 rows of 6 numbers: x, y, z, rx, ry, rz")
        if self.std is not None and not min(self.std) >= 0:
            raise InputError("a standard deviation of covariance is negative")
        if self.correlation is not None and any(self.correlation[k][k] != 1 for k in range(6)):
            raise InputError("correlation: of covariance must have 1 on its diagonal")
        if self.scope not in (scope.value for scope in Scope):
            raise InputError(f"scope: of covariance must be unit, pose or visit, got {self.scope!r}")
        self._law()

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the six errors as one draw."""
        return (Draw(f"{label}.error", self._law(), Scope(self.scope), _SIX.quantities),)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each of the six errors."""
        place = self.place(posture.chain)
        for row in range(6):
            yield Term.of(place, np.eye(6)[row], space.component(f"error.{row}"))

    def _law(self) -> JointNormal:
        matrix = self.matrix
        if self.std is not None:
            correlation = np.eye(6) if self.correlation is None else np.array(self.correlation)
            matrix = tuple(map(tuple, (correlation * np.outer(self.std, self.std)).tolist()))
        return JointNormal(matrix or (), self.mean or ())
