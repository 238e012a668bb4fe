"""All results that a report shows, computed for one pose, its numbers as text, and the causes of the error in words."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import numpy as np

from precision_pin.analyses.provenance import Pose
from precision_pin.analyses.registry import declarations
from precision_pin.analyses.result import Result
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, visible
from precision_pin.draws.draw import Draw
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.render import tables
from precision_pin.render.tables import MISSING, ROUNDING, shown
from precision_pin.robot import mcpc
from precision_pin.robot.mcpc import Mcpc
from precision_pin.sampling import Progress, monte_carlo
from precision_pin.sampling.result import MonteCarloResult
from precision_pin.sampling.table import statistic as terminal_statistic
from precision_pin.sheet import Sheet
from precision_pin.statistics import Distribution, Specification
from precision_pin.statistics.intervals import Estimate, format_interval

Found = TypeVar("Found")
Step = Callable[[str, int], AbstractContextManager[Progress]]
"""Takes a step's name and number of samples (0: none), and returns its progress function."""

CLOUD: Final = 5_000
"""Largest number of samples in the 3-D view."""


@dataclass(frozen=True)
class Missing:
    """Marker of a result that does not exist for this model; the reason is one line."""

    reason: str


@dataclass(frozen=True, eq=False)
class Results:
    """The results that a report shows.

    Attributes:
        sheet, model, at: Sheet, its model, and the model at the pose.
        analysis: The sampled distribution.
        found: Results of the other analyses by name, or why there is none.
        mcpc: The chain's parameters, or why there are none.
        cloud: The first of the sampled errors ``(6, n)``, m and rad, base axes.
        command: Command line that reproduces the report.
        package_dirs: Folders of mesh packages.
        digests: Names of the files read, each with its SHA-256.
        prefix: Prefix of the HTML identifiers in a page of several poses.
    """

    sheet: Sheet
    model: ErrorModel
    at: PoseModel
    analysis: MonteCarloResult
    found: Mapping[str, Result | Missing]
    mcpc: Mcpc | Missing
    cloud: Array
    command: tuple[str, ...]
    package_dirs: tuple[str, ...]
    digests: tuple[tuple[str, str], ...]
    prefix: str = ""

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Causes of the error in words, with their tolerances."""
        return find_causes(self.model)

    def rank_causes(self, vector: str) -> list[CauseShare]:
        """Return the causes with their shares in the variance of a vector, the largest first; empty if unknown."""
        for name, result in self.found.items():
            place = declarations()[name].causes
            if place and not isinstance(result, Missing):
                shares: list[CauseShare] = declarations()[name].output(place)(self.causes, result.poses[0], vector)
                return shares
        return []

    def errors_with(self, most_samples: int) -> Callable[[Iterable[Cause]], Array]:
        """Return a function from causes to the errors ``(6, n)`` of the first robots with these tolerances halved."""
        space, layout = self.at.space, sampler.to_arrays(self.at)
        x = space.sample(self.analysis.seed, 0, min(self.analysis.samples, most_samples))
        columns = dict(zip((draw.name for draw in space.draws), space.slices, strict=True))
        model: Literal["exact", "linear"] = "exact" if self.analysis.model == "exact" else "linear"

        def errors(halved: Iterable[Cause]) -> Array:
            factors = np.ones((space.size, 1))
            for name in (name for cause in halved for name in cause.names):
                factors[columns[name]] = 0.5
            return sampler.errors_at(layout, model, space.mean[:, None] + factors * (x - space.mean[:, None]))

        return errors

    @property
    def folders(self) -> tuple[str, ...]:
        """Local folders, which a report does not name."""
        files = (self.sheet.file, self.model.chain.robot.file)
        dirs = [folder for path in files for folder in (os.path.dirname(path), os.path.dirname(os.path.realpath(path)))]
        candidates = [*dirs, *self.package_dirs, os.getcwd(), os.path.expanduser("~")]
        absolute = {os.path.abspath(folder) for folder in candidates} | {folder for folder in candidates if folder}
        return tuple(sorted(absolute - {os.curdir, os.sep}, key=lambda folder: (-len(folder), folder)))


def collect(
    sheet: Sheet,
    pose: Pose,
    *,
    samples: int,
    seed: int,
    model: Literal["exact", "linear"],
    specifications: Sequence[Specification],
    command: Sequence[str],
    package_dirs: Sequence[str],
    step: Step,
    error_model: ErrorModel | None = None,
) -> Results:
    """Run every analysis of a report at one pose.

    Args:
        pose: A pose's name, joint values, or None for the sheet's first.
        samples, seed, model, specifications: As for :func:`~precision_pin.sampling.monte_carlo`. The other analyses
            take those that they declare, with their own model.
        command: Command line that reproduces the report.
        package_dirs: Folders of mesh packages.
        step: Called at each step.
        error_model: The sheet's model, if already built.

    Raises:
        InputError: A wrong pose, number of samples or seed; errors too large to compute with. Another analysis than the
            sampling that rejects the model is left out with its reason instead.
    """
    error_model = error_model or ErrorModel.from_sheet(sheet)
    with step("sampling", samples) as progress:
        analysis = monte_carlo(
            error_model, pose, samples=samples, seed=seed, model=model, specifications=specifications,
            findings=sheet.findings, progress=progress,
        )  # fmt: skip
    pose_model = error_model.at(pose)
    results: dict[str, Result | Missing] = {}
    settings: dict[str, Any] = {"samples": samples, "specifications": tuple(specifications)}
    for name in _chapters(specifications):
        declaration = declarations()[name]
        arguments = {key: settings[key] for key in declaration.report_settings}
        with step(declaration.heading.lower(), declaration.count_steps(error_model.space, 1, arguments)) as progress:
            common = {**arguments, "findings": sheet.findings, "progress": progress}
            results[name] = _try_analysis(partial(declaration.run, error_model, [pose], seed=seed, **common))
    with step("MCPC parameters", 0):
        geometry = _try_analysis(lambda: mcpc.from_chain(error_model.chain))
    x = pose_model.space.sample(seed, 0, min(samples, CLOUD))
    return Results(
        sheet=sheet,
        model=error_model,
        at=pose_model,
        analysis=analysis,
        found=results,
        mcpc=geometry,
        cloud=pose_model.linear(x) if model == "linear" else pose_model.exact(x),
        command=tuple(command),
        package_dirs=tuple(package_dirs),
        digests=tuple(_digest(file) for file in (error_model.chain.robot.file, sheet.file)),
    )


def collect_poses(sheet: Sheet, poses: Sequence[Pose], *, step: Step, **settings: Any) -> list[Results]:
    """Run every analysis of a report at several poses, and return the worst pose first.

    The worst pose misses most specifications, or by the widest margin. Without specifications it has the largest 95 %
    quantile. The arguments are those of :func:`collect`.
    """
    error_model = ErrorModel.from_sheet(sheet)

    def named(pose: Pose) -> Step:
        label = error_model.pose_name(pose)
        if len(poses) == 1 or not label:
            return step
        return lambda what, count: step(f"{what}, pose {visible(label)}", count)

    all_results = [collect(sheet, pose, step=named(pose), error_model=error_model, **settings) for pose in poses]
    ranking = sorted(all_results, key=_goodness)
    return [ranking[0], *(replace(results, prefix=f"pose{k}-") for k, results in enumerate(ranking[1:], start=2))]


def _goodness(results: Results) -> tuple[int, float, float]:
    """Return the sort key of a pose: specifications missed, smallest margin, then the error; the worst sorts first."""
    verdicts = results.analysis.summary.specifications
    norm = results.analysis.position.norm
    size = norm.resolved_quantile(0.95)
    spare = min((result.probability - result.required for result in verdicts), default=0.0)
    return (-sum(not result.met for result in verdicts), spare, -(norm.max if size is None else size))


def count_steps(specifications: Sequence[Specification], poses: int = 1) -> int:
    """Return the number of steps of a report: sampling, other analyses, the chain's parameters, and the page."""
    return (len(_chapters(specifications)) + 2) * poses + 1


def _chapters(specifications: Sequence[Specification]) -> list[str]:
    """Return the names of the analyses in a report; those that judge specifications need some."""
    chapters = {name: entry for name, entry in declarations().items() if entry.heading}
    return [name for name, entry in chapters.items() if specifications or "specifications" not in entry.report_settings]


def _try_analysis(analysis: Callable[[], Found]) -> Found | Missing:
    try:
        return analysis()
    except InputError as error:
        return Missing("; ".join(finding.message for finding in error.findings))


def _digest(file: str) -> tuple[str, str]:
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"{file} cannot be read any more: {error.strerror or error}") from None
    return os.path.basename(file), hashlib.sha256(content).hexdigest()


def outward(low: float, high: float, per_si: float = 1e3) -> tuple[str, str]:
    """Return the ends of an interval as text, rounded outwards; an interval within rounding is 0."""
    if max(abs(low), abs(high)) < ROUNDING:
        return "0", "0"
    return format_interval(low, high, per_si)


def bracketed(low: float, high: float, per_si: float = 1e3) -> str:
    """Return an interval as ``[low, high]``, rounded outwards."""
    return "[{}, {}]".format(*outward(low, high, per_si))


def milli_interval(distribution: Distribution, level: float) -> str:
    """Return the interval of a quantile in mm or mrad."""
    interval = distribution.quantile_interval(level)
    return MISSING if interval is None else bracketed(*interval)


def statistic(distribution: Distribution, which: str | float) -> str:
    """Return a statistic (``mean``, ``std``, …, or a quantile's probability) in mm or mrad, to its resolved digits."""
    return shown(terminal_statistic(distribution, which))


def percent(share: float | None) -> str:
    """Return a share in per cent."""
    return shown(tables.percent(share))


@dataclass(frozen=True)
class Part:
    """A draw's name in the sheet and its description."""

    name: str
    words: str


@dataclass(frozen=True)
class Cause:
    """The draws that one tolerance makes, and how often they are drawn.

    Attributes:
        words, tolerance: Such as ``tilt of joint2 about z`` and ``±0.3 mm``; the latter empty for an unknown unit.
    """

    words: str
    tolerance: str
    scope: str
    parts: tuple[Part, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its draws."""
        return tuple(part.name for part in self.parts)

    @property
    def text(self) -> str:
        """Words and tolerance."""
        return f"{self.words}, {self.tolerance}" if self.tolerance else self.words


@dataclass(frozen=True)
class CauseShare:
    """A cause's contribution to the variance of a vector.

    Attributes:
        share: Closed form; ``None`` where nothing varies.
        halved: Standard deviation with the tolerance halved, m or rad; ``None`` where its draws are correlated.
        first, total: Sobol indices of the exact model; ``None`` for several draws together and where not resolved.
    """

    cause: Cause
    share: float | None
    halved: float | None
    first: Estimate | None
    total: Estimate | None

    @property
    def rank(self) -> float:
        """Sort key: the share, or the total index where there is none."""
        if self.share is not None:
            return self.share
        return -1.0 if self.total is None else self.total.value


def find_causes(model: ErrorModel) -> tuple[Cause, ...]:
    """Return the causes of a model, in the order of their first draws.

    A source's own draws (bearings of an axis, a phase) that share a law, or have no tolerance, are one cause; a phase belongs to
    the error of which its description speaks.
    """
    names = {
        draw.name: label
        for source, label in zip(model.sources, model.labels, strict=True)
        for draw in source.own_draws(label)
    }
    groups: dict[object, list[tuple[Draw, str]]] = {}
    first_of: dict[tuple[str, str], object] = {}
    for draw, description, owners in zip(model.space.draws, model.draw_words, model.owners, strict=True):
        label, stem = names.get(draw.name), _stem(description)
        key: object = draw.name
        if label is not None:
            tolerance = draw.tolerance
            key = (label, draw.law, draw.scope) if tolerance else first_of.get((label, stem), draw.name)
        if len(owners) == 1:
            for near in ("", stem or description):
                first_of.setdefault((owners[0], near), key)
        groups.setdefault(key, []).append((draw, description))
    return tuple(_cause(members) for members in groups.values())


def _cause(members: Sequence[tuple[Draw, str]]) -> Cause:
    draw, description = members[0]
    parts = tuple(Part(draw.name, description) for draw, description in members)
    # the two bearings of an axis merge into the axis, an amplitude and its phase into the amplitude
    stems = {_stem(text) for _, text in members}
    name = stems.pop() if len(stems) == 1 and (len(members) > 1 or not draw.tolerance) else ""
    return Cause(name or description, draw.tolerance, draw.scope.value, parts)


def _stem(description: str) -> str:
    return description.rpartition(",")[0]


def sum_by_cause(causes: Sequence[Cause], values: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the values of draws summed by cause, as text, largest first."""
    text_of = {name: cause.text for cause in causes for name in cause.names}
    sums: dict[str, float] = {}
    for names, value in values.items():
        cause_texts = [text_of.get(name, name) for name in ([names] if names in text_of else names.split(", "))]
        text = " and ".join(dict.fromkeys(cause_texts))
        sums[text] = sums.get(text, 0.0) + value
    return sorted(sums.items(), key=lambda entry: -round(abs(entry[1]), 15))
