"""The result of a calibration."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar, Literal, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.calibration.checks import DOUBTFUL, probability
from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.identifiability import Identifiability
from precision_pin.analyses.calibration.intervals import interval_after, normal_interval
from precision_pin.analyses.calibration.posterior import LEVEL, ErrorLeft, Posterior
from precision_pin.analyses.calibration.set_up import SetUp
from precision_pin.analyses.declaration import load
from precision_pin.analyses.provenance import Provenance
from precision_pin.base import se3
from precision_pin.base.arguments import check_name, check_number, check_path
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.base.files import write_files
from precision_pin.model.error_model import ErrorModel
from precision_pin.render.notebook import preformatted
from precision_pin.render.result_io import JsonResult
from precision_pin.sheet.measurement import Measurement

Verdict = Literal["agrees", "disagrees", "better than stated"]


@final
@dataclass(frozen=True)
class GrossError:
    """A reading that was given no weight.

    Attributes
    ----------
    line
        Row of the data, from 1; in a file its line.
    size
        Length of its residual in the fit without it, m.
    deviations
        Its size in standard deviations.
    """

    line: int
    size: float
    deviations: float

    def to_dict(self) -> dict[str, float]:
        """Return the reading as in the JSON."""
        return {"line": self.line, "size": self.size, "deviations": self.deviations, "weight": 0.0}


@final
@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult(JsonResult):
    """A calibrated robot.

    Attributes
    ----------
    provenance
        Robot and versions.
    measurement
        Instrument and set-up as given.
    has_prior
        Whether the sheet was the prior.
    posterior
        Mean and covariance of the numbers drawn once for each robot.
    without_bounds
        Estimates of these numbers where no law had bounds, ``(U,)``.
    identifiability
        What the readings determine, at the estimate.
    set_up
        The set-up as estimated.
    chi_square, degrees_of_freedom
        Sum of squares of whitened residuals (with a prior, of the numbers' deviations too), and its expectation.
    residuals
        Reading less prediction of the calibrated arm, in base axes, ``(P, m)``.
    residuals_before
        The same of the sheet's means, with the first guess of the set-up.
    left_out
        Reading less the prediction of a fit without this reading, or without its group where the data have groups, ``(P, m)``,
        first order.
    gross_errors
        Readings that were given no weight.
    at_bounds
        Numbers estimated at a bound of their law.
    poses
        The error before and after at each of the user's poses.
    original
        The model before the calibration.
    model
        The arm that is left: means moved, remaining uncertainty correlated; every other analysis runs on it.
    data
        The readings as given.
    steps
        Gauss-Newton steps.
    findings
        Warnings.
    """

    schema: ClassVar[str] = "precision-pin/calibration/1"
    provenance: Provenance
    measurement: Measurement
    has_prior: bool
    posterior: Posterior
    without_bounds: Array
    identifiability: Identifiability
    set_up: SetUp
    chi_square: float
    degrees_of_freedom: int
    residuals: Array
    residuals_before: Array
    left_out: Array
    gross_errors: tuple[GrossError, ...]
    at_bounds: tuple[str, ...]
    poses: tuple[ErrorLeft, ...]
    original: ErrorModel
    model: ErrorModel
    data: CalibrationData
    steps: int
    findings: tuple[Finding, ...]

    @property
    def rank(self) -> int:
        """How many independent combinations of the numbers the readings determine."""
        return self.identifiability.rank

    @property
    def observability(self) -> dict[str, float]:
        """O1 to O5."""
        return self.identifiability.observability

    @property
    def probability(self) -> float:
        """Probability that a right model gives a larger chi-square."""
        return probability(self.chi_square, self.degrees_of_freedom)

    @property
    def verdict(self) -> Verdict:
        """Whether model and data agree."""
        if self.probability < DOUBTFUL:
            return "disagrees"
        return "better than stated" if self.degrees_of_freedom > 0 and 1 - self.probability < DOUBTFUL else "agrees"

    def interval(self, name: str, probability: float = LEVEL) -> tuple[float, float]:
        """Return the interval of a number drawn once for each robot, SI, with the same probability outside on both sides.

        It heeds the number's own law: of a number of which little is learned it is that of the law. Without a prior it is that
        of a normal number where anything is learned.

        Raises
        ------
        InputError
            There is no such number, or the probability is not between 0 and 1.
        """
        number = self.posterior.names.index(check_name("component", name, self.posterior.names))
        check_number("the probability", probability, "between 0 and 1", lambda value: 0 < value < 1)
        # where the number itself stops at a bound, how far the readings would have it beyond says how much lies near the bound
        estimate = float(self.without_bounds[number]) if name in self.at_bounds else self.posterior.mean[name]
        left = 1 - self.posterior.learned[name]
        if not self.has_prior and left < 1:
            return normal_interval(estimate, self.posterior.std[name], probability)
        draw = next(one for one in self.original.space.draws if name in one.components)
        std = self.posterior.prior_std[name]
        return interval_after(draw.law, draw.components.index(name), estimate, std, left, probability)

    @cached_property
    def components(self) -> Array:
        """Estimated values of all components of the original model's space, ``(d,)``; of other scopes their means."""
        space = self.original.space
        x = space.mean.copy()
        for name, value in self.posterior.mean.items():
            x[space.index[name]] = value
        return x

    def predict(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return the tip of the calibrated arm in the base, ``(4, 4)``; ``q`` as for :meth:`ErrorModel.at`."""
        at = self.original.at(q)
        error = at.exact(self.components[:, None])[:, 0]
        pose = at.posture.pose
        return se3.pose(se3.exp_rotation(error[3:]) @ pose[:3, :3], pose[:3, 3] + error[:3])

    def to_urdf(
        self, path: str | os.PathLike[str], q: ArrayLike | Mapping[str, float] | str | None = None
    ) -> tuple[str, ...]:
        """Write the calibrated arm as a URDF, and return the labels of the sources that hold at one pose only.

        What loads cause, and what changes with the pose, is written as it is at the pose ``q``, the model's first if left
        out; everything else holds at every pose.

        Raises
        ------
        OutputError
            The file cannot be written.
        InputError
            The robot's file has changed.
        """
        name = check_path("the path of the URDF", path)
        writer = load("precision_pin.export.as_built:AsBuilt").prepare(self.original, q)
        write_files({name: writer.fitted(self.components)})
        frozen: tuple[str, ...] = writer.frozen
        return frozen

    def rms(self, which: Literal["before", "after", "left out"]) -> float:
        """Return the root mean square length (m) of the residuals of the readings that have weight."""
        values = {"before": self.residuals_before, "after": self.residuals, "left out": self.left_out}[which]
        gross = {error.line for error in self.gross_errors}
        used = [k for k, line in enumerate(self.data.lines) if line not in gross]
        return float(np.sqrt((values[used][:, :3] ** 2).sum(axis=1).mean()))

    def _data(self) -> dict[str, Any]:
        """Return joint values and readings as given, a row for each reading; ``std`` and ``group`` where they are given."""
        data = self.data
        given = {"std": data.std, "group": data.group}
        return {
            "joints": list(self.original.chain.joint_names),
            "q": data.q.T.tolist(),
            "readings": data.readings.tolist(),
            **{name: values.tolist() for name, values in given.items() if values.size},
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the result in its JSON schema, SI units, base axes; joint values and readings as given under ``data``."""
        return {
            **self.provenance.to_dict(self.schema),
            "measurement": self.measurement.to_dict(),
            "prior": self.has_prior,
            "readings": len(self.data),
            "verdict": self.verdict,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "probability": self.probability,
            "steps": self.steps,
            "rms_residual": {
                "before": self.rms("before"),
                "after": self.rms("after"),
                "left_out": self.rms("left out"),
            },
            "gross_errors": [error.to_dict() for error in self.gross_errors],
            "at_bounds": list(self.at_bounds),
            "set_up": self.set_up.to_dict(),
            "rank": self.rank,
            "observability": self.observability,
            "identifiability": self.identifiability.to_dict(),
            "posterior": self.posterior.to_dict(),
            "intervals": {
                "probability": LEVEL,
                "numbers": {name: list(self.interval(name)) for name in self.posterior.names},
            },
            "poses": [entry.to_dict() for entry in self.poses],
            "residuals": self.residuals.tolist(),
            "residuals_before": self.residuals_before.tolist(),
            "residuals_left_out": self.left_out.tolist(),
            "lines": list(self.data.lines),
            "data": self._data(),
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def _repr_html_(self) -> str:
        """Return the notebook view: the table of the command."""
        # texts rest on results, not results on texts
        made = import_module("precision_pin.analyses.calibration.table").calibration_table(self)
        return preformatted(str(made))

    def __repr__(self) -> str:
        return (
            f"<CalibrationResult of {self.provenance.robot}: {len(self.data)} readings, residuals "
            f"{1e3 * self.rms('before'):.3g} mm before, {1e3 * self.rms('after'):.3g} mm after, model and data: {self.verdict}>"
        )
