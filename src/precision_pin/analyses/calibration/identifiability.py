"""Which combinations of a model's numbers measurements can tell apart: ranks and subspaces.

The readings' derivatives with respect to the numbers, each in units of its prior standard deviation, have a null space: the
combinations that no reading sees. A basis of it is arbitrary; its projector P is not. A number k with ``P_kk`` = 0 is
determined by itself, one with ``P_kk`` = 1 is not seen at all. All others fall into groups between which P has no entries:
of n numbers in a group, some combinations are determined and the rest are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import ClassVar, Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from precision_pin.analyses.calibration.design import (
    NEGLIGIBLE,
    Station,
    UnitNumbers,
    flat,
    measurement_of,
    project_out,
    read_poses,
    stack_at_means,
    stations_of,
)
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.record import Keys, Record
from precision_pin.base.text_escape import some
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import Measurement

_ENTRY: Final = 1e-6
"""Entry of a projector that counts as zero."""
_MOST_NAMED: Final = 4


@final
@dataclass(frozen=True)
class Combination(Record):
    """A weighted sum of numbers, each in units of its prior standard deviation; the squared weights sum up to 1."""

    KEYS: ClassVar[Keys] = ("*weight_by_name",)

    names: tuple[str, ...]
    weights: tuple[float, ...]

    @property
    def weight_by_name(self) -> dict[str, float]:
        """The weight of each number."""
        return dict(zip(self.names, self.weights, strict=True))

    def __str__(self) -> str:
        return " ".join(f"{weight:+.3g}·{name}" for name, weight in self.weight_by_name.items())


@final
@dataclass(frozen=True)
class Group(Record):
    """Numbers of which only some combinations are determined, and the combination that no reading sees, if there is only one."""

    names: tuple[str, ...]
    determined: int
    unseen: Combination | None

    def __str__(self) -> str:
        text = f"{self.determined} of {len(self.names)} combinations of {', '.join(self.names)}"
        return text if self.unseen is None else f"{text}; not seen: {self.unseen}"


@final
@dataclass(frozen=True, eq=False)
class Identifiability(Record):
    """What readings determine of a model's U numbers drawn once for each robot.

    Attributes:
        rank, singular_values: How many independent combinations the readings determine, and the singular values of
            their derivatives, in units of noise and of prior standard deviation, falling.
        projector: Onto the combinations that no reading sees, ``(U, U)``, in units of prior standard deviation.
        nuisances, nuisance_rank: Unknown numbers of the set-up, and how many combinations of them are determined.
        observability: O1 to O5 of the determined combinations.
    """

    KEYS: ClassVar[Keys] = (
        *("rank", "parameters", "singular_values", "determined", "unseen", "combinations"),
        *("nuisances", "nuisance_rank", "observability"),
    )

    names: tuple[str, ...]
    rank: int
    singular_values: Array
    projector: Array
    nuisances: tuple[str, ...]
    nuisance_rank: int
    observability: dict[str, float]

    @property
    def parameters(self) -> int:
        """How many numbers there are."""
        return len(self.names)

    @property
    def determined(self) -> tuple[str, ...]:
        """Numbers that are determined each by itself."""
        return self._named(np.diag(self.projector) <= _ENTRY)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Numbers that no reading sees."""
        return self._named(np.diag(self.projector) >= 1 - _ENTRY)

    def _named(self, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(compress(self.names, chosen))

    @property
    def combinations(self) -> tuple[Group, ...]:
        """Groups of numbers of which only combinations are determined."""
        return subspaces(self.names, self.projector)

    @property
    def is_complete(self) -> bool:
        """Whether the readings determine every number, of the model and of the set-up."""
        return self.rank == len(self.names) and self.nuisance_rank == len(self.nuisances)


def identifiability(model: ErrorModel, poses: object, measurement: Measurement | None = None) -> Identifiability:
    """Return which combinations of a model's unit-scope numbers measurements at some poses determine.

    First order, at the numbers' means.

    Args:
        model: The model; :func:`precision_pin.every_frame` returns one with all geometric errors.
        poses: A list of poses, an array ``(n, P)``, a mapping of joint values or a
            :class:`~precision_pin.robot.pose_set.PoseSet`.
        measurement: Instrument and set-up; those of the sheet if left out.

    Raises:
        InputError: Nothing varies from robot to robot, or the poses are wrong.
    """
    measurement = measurement_of(model, measurement)
    values, _ = read_poses(model, poses)
    unit = UnitNumbers.of(model.space)
    return determined_by(stations_of(model, values, measurement), unit, measurement)


def determined_by(stations: Sequence[Station], unit: UnitNumbers, measurement: Measurement) -> Identifiability:
    """Return what the readings at some stations determine, at the means."""
    # a number that another one fixes is a combination too, so the columns are numbers and not independent ones
    plain = replace(unit, root=np.diag(unit.std))
    by_number, by_nuisance = stack_at_means(stations, plain, measurement)
    return of_stack(unit.names, flat(by_number), flat(by_nuisance), measurement.nuisances, len(by_number))


def of_stack(
    names: tuple[str, ...], by_z: Array, by_nuisance: Array, nuisances: tuple[str, ...], poses: int
) -> Identifiability:
    """Return what whitened derivatives ``(M, U)`` and ``(M, k)`` determine."""
    projected, nuisance_rank = project_out(by_z, by_nuisance)
    if len(projected) > projected.shape[1]:
        _, projected = np.linalg.qr(projected)
    _, found, rows = np.linalg.svd(projected, full_matrices=True)
    scale = float(np.linalg.norm(by_z, 2))
    rank = int((found > NEGLIGIBLE * scale).sum())
    null = rows[rank:]
    values = np.zeros(len(names))
    values[: found.size] = found
    return Identifiability(
        names,
        rank,
        values,
        null.T @ null,
        nuisances,
        nuisance_rank,
        observability(found[:rank], poses),
    )


def refuse_where_nothing_is_seen(found: Identifiability) -> None:
    """Refuse readings that determine no combination of the arm's numbers."""
    if not found.rank:
        free = ", or with the base known" if any(name.startswith("base") for name in found.nuisances) else ""
        raise InputError(
            "no reading sees any number that varies from robot to robot: there is nothing to estimate; "
            f"measure at other poses, under another load, with another instrument{free}"
        )


def remarks_on(found: Identifiability) -> Iterator[Finding]:
    """Yield warnings about what the readings do not determine."""
    if found.nuisance_rank < len(found.nuisances):
        message = (
            f"the poses determine {found.nuisance_rank} of the {len(found.nuisances)} unknown numbers of the set-up "
            f"({', '.join(found.nuisances)}); add poses that differ more"
        )
        yield Finding("warning", "W_SETUP", message)
    if not found.rank:
        message = (
            "no reading sees any number that varies from robot to robot; measure at other poses or another quantity"
        )
        yield Finding("warning", "W_UNOBSERVABLE", message)
    elif found.unseen:
        listed = some(found.unseen, 3)
        keeps = "they keep their tolerances" if len(found.unseen) > 1 else "it keeps its tolerance"
        yield Finding("warning", "W_UNOBSERVABLE", f"no reading sees {listed}; {keeps}")


def rank_findings(found: Identifiability) -> Iterator[Finding]:
    """Yield a warning where the readings do not determine every number, which a fit without a prior needs."""
    if found.is_complete:
        return
    groups = [str(group) for group in found.combinations]
    parts = [f"not seen at all: {some(found.unseen, _MOST_NAMED)}"] if found.unseen else []
    parts += [f"only {some(groups, _MOST_NAMED, '; only ')}"] if groups else []
    if found.nuisance_rank < len(found.nuisances):
        parts.append(
            f"{found.nuisance_rank} of the {len(found.nuisances)} numbers of the set-up ({some(found.nuisances, _MOST_NAMED)})"
        )
    message = (
        f"without a prior, the readings determine {found.rank:,} combinations of {len(found.names):,} numbers: "
        f"{'; '.join(parts)}; measure other poses, hold these numbers fixed, or keep the prior"
    )
    yield Finding("warning", "W_RANK", message)


def observability(singular_values: Array, poses: int) -> dict[str, float]:
    """Return the observability indices O1 to O5 of singular values, in units of prior std and noise (Sun and Hollerbach 2008)."""
    s = np.sort(singular_values)[::-1]
    if not s.size or poses < 1:
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    return {
        "O1": float(np.exp(np.log(s).mean()) / np.sqrt(poses)),
        "O2": float(s[-1] / s[0]),
        "O3": float(s[-1]),
        "O4": float(s[-1] ** 2 / s[0]),
        "O5": float(1 / (1 / s).sum()),
    }


def subspaces(names: Sequence[str], projector: Array) -> tuple[Group, ...]:
    """Return the groups of numbers of which only combinations are determined, from the projector on what is not seen."""
    share = np.diag(projector)
    mixed = np.flatnonzero((share > _ENTRY) & (share < 1 - _ENTRY))
    if not mixed.size:
        return ()
    within = projector[np.ix_(mixed, mixed)]
    count, labels = connected_components(csr_array(np.abs(within) > _ENTRY), directed=False)
    return tuple(_group(names, mixed[labels == k], projector) for k in range(count))


def _group(names: Sequence[str], members: Array, projector: Array) -> Group:
    block = projector[np.ix_(members, members)]
    values, vectors = np.linalg.eigh(block)
    missing = int((values > 0.5).sum())
    chosen = tuple(names[int(k)] for k in members)
    unseen = None
    if missing == 1:
        weights = vectors[:, -1]
        weights = weights * np.sign(weights[int(np.argmax(np.abs(weights).round(9)))])
        unseen = Combination(chosen, tuple(weights.tolist()))
    return Group(chosen, len(chosen) - missing, unseen)
