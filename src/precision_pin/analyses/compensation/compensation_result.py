"""Corrected joint values of many poses, and the law of the error that remains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, final

import numpy as np

from precision_pin.analyses.compensation.correction import Correction
from precision_pin.analyses.result import AnalysisResult
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys
from precision_pin.render.notebook import Table, rendered
from precision_pin.render.tables import data_frame, milli
from precision_pin.robot.approach import approach_entry, written_approach
from precision_pin.robot.pose_set import PoseSet

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

Mode = Literal["position", "pose"]
"""What is corrected: the position alone, or position and attitude."""


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CompensationResult(AnalysisResult):
    """Corrected joint values of P poses and what remains, base axes, m and rad.

    Attributes:
        joints, prismatic, poses: Joints in chain order, which of them slide, and the poses as they were asked for.
        mode, weights: What was corrected, and the weights of the components, ``(6,)``; ``None`` where they must vanish.
        correction: Corrected joint values, errors at the means before and after, statuses.
        within_before, within_after: 95 % quantiles of |d| and |δ| from the pose wanted, without and with the
            correction, ``(2, P)``: closed form, first order about the error at the means, normal; NaN where nothing was
            corrected.
        sources, shares: Names of the sources, and their shares in the variance of the position that remains, ``(lines,
            P)``.
    """

    schema: ClassVar[str] = "precision-pin/compensation/1"

    KEYS: ClassVar[Keys] = (
        "*head",
        "mode",
        "weights",
        "sources",
        "poses=entries",
        "assumptions",
        "warnings",
        "findings",
    )

    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    poses: PoseSet
    mode: Mode
    weights: Array | None
    correction: Correction
    within_before: Array
    within_after: Array
    sources: tuple[str, ...]
    shares: Array

    @property
    def corrected(self) -> Array:
        """Corrected joint values, ``(n, P)``, rad and m; NaN where there are none."""
        return self.correction.q

    @property
    def is_complete(self) -> bool:
        """Whether every pose has corrected joint values."""
        return all(status == "corrected" for status in self.correction.status)

    @property
    def dominant_source(self) -> tuple[str, ...]:
        """Name of the source with the largest share in the variance that remains; empty where nothing varies or is known."""
        if not self.sources:
            return ("",) * len(self.poses)
        shares = np.nan_to_num(self.shares)
        largest = shares.argmax(axis=0).tolist()
        return tuple(self.sources[line] if shares[line, pose] > 0 else "" for pose, line in enumerate(largest))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions of the numbers, one sentence each."""
        return (
            "the error that is corrected is that with every component at its mean, of the exact model",
            "95 % quantiles are those of the first-order model about it with a normal error, in closed form",
            "the controller moves each joint by exactly the correction, on top of its drive's errors in the sheet",
        )

    @property
    def entries(self) -> list[dict[str, Any]]:
        """The poses as in the JSON; null where nothing was corrected."""
        return [self._entry(pose, dominant) for pose, dominant in enumerate(self.dominant_source)]

    def _entry(self, pose: int, dominant: str) -> dict[str, Any]:
        of, made = self.poses, self.correction
        known = made.status[pose] == "corrected"
        approach = () if of.approaches is None else tuple(of.approaches[:, pose].tolist())

        def split(values: Array) -> dict[str, Array]:
            position, attitude = np.split(values[:, pose], 2)
            return {"position": position.squeeze(), "attitude": attitude.squeeze()}

        return {
            "name": of.names[pose],
            **({} if of.times is None else {"time": float(of.times[pose])}),
            "q": of.q[:, pose],
            **approach_entry(written_approach(self.joints, approach)),
            "q_corrected": made.q[:, pose] if known else None,
            "before": split(made.before),
            "first_order": split(made.first_order),
            "after": split(made.after) if known else None,
            "within_95_before": split(self.within_before),
            "within_95_after": split(self.within_after) if known else None,
            "shares": self.shares[:, pose] if known else None,
            "dominant_source": dominant or None,
            "iterations": int(made.iterations[pose]),
            "status": made.status[pose],
            "is_least": bool(made.is_least[pose]) if known else None,
        }

    def to_pandas(self) -> pandas.DataFrame:
        """Return a data frame, m and rad: a row for each pose.

        Raises:
            InputError: pandas is not installed.
        """
        made = self.correction
        rows, dominant = [], self.dominant_source
        for pose, label in enumerate(self.poses.labels):
            columns: dict[str, Any] = dict(zip(self.joints, self.poses.q[:, pose].tolist(), strict=True))
            columns |= {f"{name} corrected": float(made.q[k, pose]) for k, name in enumerate(self.joints)}
            for when, error in (("before", made.before), ("first order", made.first_order), ("after", made.after)):
                columns[f"position {when}"] = float(np.linalg.norm(error[:3, pose]))
                columns[f"attitude {when}"] = float(np.linalg.norm(error[3:, pose]))
            for norm, name in enumerate(("position", "attitude")):
                columns[f"{name} 0.95 before"] = float(self.within_before[norm, pose])
                columns[f"{name} 0.95 after"] = float(self.within_after[norm, pose])
            columns |= {"dominant source": dominant[pose], "status": made.status[pose]}
            rows.append(((label,), columns))
        return data_frame(["pose"], rows, self.head)

    @property
    def summary(self) -> str:
        """What `repr` says of the result, beside the arm."""
        count = self.correction.status.count("corrected")
        return f"{count:,} of {len(self.poses):,} poses corrected in {self.mode}"

    def _repr_html_(self) -> str:
        """Return the notebook view, mm and mrad."""
        made, labels = self.correction, self.poses.labels
        rows = []
        for pose in range(min(len(labels), _MOST_ROWS)):
            numbers = [
                milli(float(np.linalg.norm(error[rows_of, pose])))
                for rows_of in (slice(0, 3), slice(3, 6))
                for error in (made.before, made.after)
            ]
            within = [milli(float(of[0, pose])) for of in (self.within_before, self.within_after)]
            rows.append([labels[pose], *numbers, *within, self.dominant_source[pose], made.status[pose]])
        columns = ["pose", "|d| before [mm]", "after", "|δ| before [mrad]", "after", "95 % |d| before", "after"]
        of = self.provenance
        title = f"Compensation of {of.robot}: {of.base} to {of.tip}, {len(labels):,} poses, {self.mode}"
        return rendered(title, [Table([*columns, "what remains", "status"], rows)], [*self.assumptions, *self.warnings])


_MOST_ROWS = 20
