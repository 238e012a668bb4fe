"""Result of a Monte Carlo run at one pose, with all settings that reproduce it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from precision_pin.base.arguments import check_flag, check_memory
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, visible
from precision_pin.base.versions import versions
from precision_pin.draws.space import Space
from precision_pin.model.datum import DatumRecord, datum_text
from precision_pin.model.pose_model import OriginShares
from precision_pin.render import tables
from precision_pin.render.columns import QUANTITY, Column, frame_row, notebook_table
from precision_pin.render.html import element, rendered
from precision_pin.render.result_io import JsonResult
from precision_pin.robot.configurations import approach_entry
from precision_pin.statistics import (
    NORMS,
    QUANTITIES,
    Distribution,
    SpecificationResult,
    Summary,
    VectorDistribution,
    format_share,
    quantity_values,
)
from precision_pin.statistics.distribution import CONTENTS
from precision_pin.statistics.precision import Precision

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Correlated(Record):
    """Group of correlated parameters.

    Attributes:
        scores: Correlation matrix of their normal scores, as given, row by row.
        pearson: Correlation matrix of the parameters themselves, from `scores` and the laws.
    """

    parameters: tuple[str, ...]
    scores: tuple[tuple[float, ...], ...]
    pearson: tuple[tuple[float, ...], ...]

    @property
    def pairs(self) -> Iterator[str]:
        """A line of text for each pair of parameters."""
        for i, j in itertools.combinations(range(len(self.parameters)), 2):
            yield (
                f"{self.parameters[i]} and {self.parameters[j]}: {self.scores[i][j]:.4g} of their normal scores, "
                f"{self.pearson[i][j]:.4g} of the numbers (Pearson)"
            )

    @classmethod
    def all_of(cls, space: Space) -> tuple[Correlated, ...]:
        """Return every correlation of a space."""
        groups = []
        for correlation in space.correlations:
            columns = [space.index[name] for name in correlation.names]
            pearson = space.pearson_within(columns)
            groups.append(cls(correlation.names, correlation.matrix, tuple(map(tuple, pearson.tolist()))))
        return tuple(groups)


@dataclass(frozen=True)
class Until(Record):
    """Target precision, as text, and the precision reached."""

    KEYS: ClassVar[Keys] = ("target=text", "*_reached")

    text: str
    precision: Precision

    @property
    def _reached(self) -> dict[str, Any]:
        return asdict(self.precision)


@dataclass(frozen=True)
class RelativeTo(Record):
    """Pose whose errors are subtracted: its name or empty, joint values (rad, m), and ``+`` or ``-`` approaches."""

    KEYS: ClassVar[Keys] = ("name", "q", "*_approach")

    name: str
    q: Mapping[str, float]
    approach: Mapping[str, str] = field(default_factory=dict)

    @property
    def _approach(self) -> dict[str, Any]:
        return approach_entry(self.approach)


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloResult(Record, JsonResult):
    """Distribution of the pose error at one pose.

    Attributes:
        robot, base, tip: The URDF and the ends of the chain.
        pose_name, q, approach: The pose: its name or empty, each joint's value (rad, m), and ``+`` or ``-`` where an
            approach is given.
        seed, model, statics: Settings of the run: 64-bit seed, ``"exact"`` or ``"linear"``, ``"nominal"`` or
            ``"equilibrium"``.
        scopes: Number of random numbers drawn once for each unit, pose and visit.
        nominal: ``(6,)`` error with every parameter at its mean.
        summary: Statistics of the samples, base axes.
        position, attitude: Distributions of |d|, dx, dy, dz (m), and of |δ|, δx, δy, δz (rad).
        sliding_joints: Sliding joints of ``q``: their values are in m, all others in rad.
        correlations: Correlations of the space.
        makers: Parameters, by name, of the units with the largest errors (``summary.largest_position`` and
            ``largest_attitude``), by unit. ``space.sample(seed, unit, 1)`` draws a unit again.
        assumed: Labels of the sources that the sheet marks as assumptions.
        sources: Number of sources.
        origins: Fraction of the first-order variance of position and attitude by provenance; empty if the sheet states
            none.
        versions: Versions of Python and the libraries that computed the result.
        until: Targets at which sampling was to end.
        findings: Findings passed in, such as those of the sheet.
        warnings: One line each: the findings, then the warnings of the analysis.
        errors, space: ``(6, N)`` every sample, and the model's space, if they were kept.
        relative_to: The pose whose errors are subtracted (:func:`precision_pin.relative`), if any.
        datum: What the errors are counted against; None for base axes.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> result = pp.monte_carlo(model, samples=2000, keep_samples=True)
        >>> print(result.errors.shape, result.position.norm.levels)
        (6, 2000) (0.5, 0.95, 0.99, 0.9973)
    """

    schema: ClassVar[str] = "precision-pin/analysis/1"
    complete: ClassVar[bool] = True
    axes: ClassVar[str] = "base"

    KEYS: ClassVar[Keys] = (
        *(
            "schema",
            "complete",
            "robot",
            "base",
            "tip",
            "axes",
            "datum",
            "pose=_pose",
            "*_relative_to",
            "samples",
            "seed",
        ),
        *("model", "statics", "scopes", "confidence=summary.confidence", "versions", "warnings", "findings", "assumed"),
        *("*_origins", "nominal=_nominal", "*summary", "largest=_largest", "*_until", "*_correlations"),
    )

    robot: str
    base: str
    tip: str
    pose_name: str
    q: Mapping[str, float]
    seed: int
    model: str
    statics: str
    scopes: Mapping[str, int]
    nominal: Array
    summary: Summary
    sliding_joints: tuple[str, ...] = ()
    approach: Mapping[str, str] = field(default_factory=dict)
    correlations: tuple[Correlated, ...] = ()
    makers: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    sources: int = 0
    origins: OriginShares = field(default_factory=dict)
    until: tuple[Until, ...] = ()
    warnings: tuple[str, ...] = ()
    errors: Array | None = field(default=None, repr=False)
    findings: tuple[Finding, ...] = ()
    versions: Mapping[str, str] = field(default_factory=versions)
    relative_to: RelativeTo | None = None
    datum: DatumRecord | None = None
    space: Space | None = field(default=None, repr=False)
    # fields, because interpreters complete names after a property from its class only, which has no fields
    position: VectorDistribution = field(init=False, repr=False)
    attitude: VectorDistribution = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", self.summary.position)
        object.__setattr__(self, "attitude", self.summary.attitude)
        super().__post_init__()

    @property
    def samples(self) -> int:
        """Number of samples drawn."""
        return self.summary.samples

    @property
    def covariance(self) -> Array | None:
        """Sample covariance, ``(6, 6)``; ``None`` for one sample."""
        return self.summary.covariance

    @property
    def _pose(self) -> dict[str, Any]:
        return {"name": self.pose_name, "q": self.q, **approach_entry(self.approach)}

    @property
    def _relative_to(self) -> dict[str, Any]:
        return {} if self.relative_to is None else {"relative_to": self.relative_to}

    @property
    def _origins(self) -> dict[str, Any]:
        return tables.origins_entry(self.origins)

    @property
    def _nominal(self) -> dict[str, Array]:
        return {"position": self.nominal[:3], "attitude": self.nominal[3:]}

    @property
    def _largest(self) -> dict[str, Any]:
        extremes_of = {"position": self.summary.largest_position, "attitude": self.summary.largest_attitude}
        return {
            name: [
                {"unit": extreme.sample, "value": extreme.value, "parameters": self.makers.get(extreme.sample, {})}
                for extreme in extremes
            ]
            for name, extremes in extremes_of.items()
        }

    @property
    def _until(self) -> dict[str, Any]:
        return {"until": self.until} if self.until else {}

    @property
    def _correlations(self) -> dict[str, Any]:
        return {"correlations": self.correlations} if self.correlations else {}

    @property
    def arm(self) -> str:
        """Robot and pose, shortened, without marks that change the direction of text."""
        pose = f" at pose {visible(self.pose_name, 40)}" if self.pose_name else ""
        other = self.relative_to
        relative = f" relative to {visible(other.name, 40) or 'another pose'}" if other else ""
        return f"{visible(self.robot, 60)}{pose}{relative}{datum_text(self.datum)}"

    def plot(self, quantity: str = "position", *, axes: Axes | None = None) -> Axes | Figure:
        """Draw the sampled distribution.

        Args:
            quantity: ``"position"`` or ``"attitude"`` for |d| or |δ|, ``"components"`` for all six components, or one
                component, such as ``"position.x"``.
            axes: Matplotlib axes to draw the histogram on; ``None`` makes a figure with title, legend and caption.

        Returns:
            The axes given, or the new figure, which a notebook shows and ``savefig`` writes.

        Raises:
            UnknownNameError: There is no such quantity.
            InputError: All six components are to be drawn on one pair of axes.
        """
        # late: matplotlib takes half a second to import
        return import_module("precision_pin.sampling.figures").plot(self.summary, self.seed, self.arm, quantity, axes)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad, NaN where not resolved: a row for each quantity.

        The columns are ``mean``, ``std``, ``mode`` and ``quantile_0.95``, …, each with the ends ``…_lower`` and
        ``…_upper`` of its interval, and ``min`` and ``max``. ``attrs`` gives the settings of the run.

        Raises:
            InputError: pandas is not installed.
        """
        levels = sorted({level for name in QUANTITIES for level in self.summary.distribution(name).levels})
        rows = [((name,), frame_row(_columns(levels), self.summary.distribution(name))) for name in QUANTITIES]
        return tables.data_frame(["quantity"], rows, {**self._attributes(), "warnings": list(self.warnings)})

    def samples_to_pandas(self, *, inputs: bool = False) -> pandas.DataFrame:
        """Return every sampled error as a data frame: a row a robot, dx, dy, dz in m and rx, ry, rz in rad.

        Args:
            inputs: For regressions and sensitivity analyses: first a column for each component of the model's space,
                SI, named as there (of a relative error: at its pose); last ``position.norm`` and ``attitude.norm``.

        Raises:
            InputError: The samples were not kept, the frame does not fit into memory, or pandas is not installed.

        Examples:
            >>> model = pp.ErrorModel.load("4dof.errors.yaml")
            >>> frame = pp.monte_carlo(model, samples=2000, keep_samples=True).samples_to_pandas(inputs=True)
            >>> print(frame.shape, frame.columns[0], frame.columns[-1])
            (2000, 34) a0 attitude.norm
        """
        if self.errors is None:
            raise InputError("the samples were not kept; sample with keep_samples=True")
        names, parts, pandas = list(_COMPONENTS), [self.errors], tables.optional("pandas")
        if check_flag("inputs", inputs) and self.space is not None:
            size, count = self.space.size, self.samples
            # the frame, the components and the variates from which they are computed
            check_memory(32.0 * (size + 8) * count, f"a frame of {count:,} samples with {size} inputs", "keep fewer")
            norms = list(NORMS)
            names = [*self.space.components, *names, *(QUANTITIES[row] for row in norms)]
            parts = [self.space.sample(self.seed, 0, count), self.errors, quantity_values(self.errors)[norms]]
        frame = pandas.DataFrame(np.concatenate(parts).T, columns=names)
        frame.index.name = "sample"
        frame.attrs = {**self._attributes(), "units": dict(tables.UNITS)}
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Return the result as a dataset, m and rad, NaN where not resolved.

        The variables and their dimensions: ``mean``, ``std``, ``min``, ``max`` and ``mode`` over ``quantity`` (position.norm
        … attitude.z); ``quantile`` over quantity and ``probability``; ``quantile_interval`` over these and ``end`` (lower,
        upper); ``mean_interval``, ``std_interval`` and ``mode_interval`` over quantity and end; ``tolerance_bounds`` over
        quantity, ``content`` and end; ``nominal`` over ``component`` (dx … rz); ``covariance`` over component and
        ``component_2``; ``covariance_interval`` over these and end; ``error`` over component and ``sample``, if the samples
        were kept. The attributes give the settings of the run.

        Raises:
            InputError: xarray is not installed.
        """
        distributions = [self.summary.distribution(name) for name in QUANTITIES]
        levels = sorted({level for distribution in distributions for level in distribution.levels})
        unknown = (np.nan, np.nan)

        def over(values: Callable[[Distribution], Any], *dimensions: str) -> tuple[tuple[str, ...], list[Any]]:
            return ("quantity", *dimensions), [values(distribution) for distribution in distributions]

        covariance, interval, nowhere = self.covariance, self.summary.covariance_interval, np.full((6, 6, 2), np.nan)
        variables: dict[str, Any] = {
            name: over(lambda law: tables.number(getattr(law, name)))  # noqa: B023 - called at once
            for name in ("mean", "std", "min", "max", "mode")
        }
        variables["quantile"] = over(
            lambda law: [tables.number(law.resolved_quantile(level)) for level in levels], "probability"
        )
        variables["quantile_interval"] = over(
            lambda law: [law.quantile_interval(level) or unknown for level in levels], "probability", "end"
        )
        variables["nominal"] = ("component", self.nominal)
        pair = ("component", "component_2")
        variables["covariance"] = (pair, nowhere[..., 0] if covariance is None else covariance)
        for name in ("mean", "std", "mode"):
            variables[f"{name}_interval"] = over(lambda law: law.interval(name) or unknown, "end")  # noqa: B023
        variables["covariance_interval"] = ((*pair, "end"), nowhere if interval is None else interval)
        variables["tolerance_bounds"] = over(
            lambda law: [law.tolerance_bounds(content) or unknown for content in CONTENTS], "content", "end"
        )
        if self.errors is not None:
            variables["error"] = (("component", "sample"), self.errors)
        coordinates: dict[str, Any] = {
            "quantity": list(QUANTITIES),
            "probability": levels,
            "end": ["lower", "upper"],
            "content": list(CONTENTS),
            "component": list(_COMPONENTS),
            "component_2": list(_COMPONENTS),
        }
        return tables.optional("xarray").Dataset(variables, coordinates, tables.described(self._attributes()))

    def __repr__(self) -> str:
        norm = self.position.norm
        quantile = norm.resolved_quantile(0.95)
        phrase = "" if quantile is None else f", |d| within {1e3 * quantile:.4g} mm for 95 %"
        return (
            f"<MonteCarloResult of {self.robot!r}, {self.base!r} to {self.tip!r}, pose {self.pose_name!r}{self._other_pose}: "
            f"{self.samples:,} samples, seed {self.seed}, {self.model} model{phrase}>"
        )

    def _repr_html_(self) -> str:
        """Return the notebook view: mm and mrad, half-widths of intervals after ±."""
        pose = repr(self.pose_name) if self.pose_name else "without a name"
        results = self.summary.specifications
        specifications = [notebook_table(specification_columns(), results)] if results else []
        return rendered(
            f"Pose error of {self.robot}: {self.base} to {self.tip}, pose {pose}{self._other_pose}",
            [notebook_table(_columns(), map(self.summary.distribution, QUANTITIES)), *specifications],
            [
                f"{tables.joint_text(self.q, self.sliding_joints, self.approach)}; base axes",
                f"{self.samples:,} samples, seed {self.seed}, {self.model} model, statics {self.statics}; "
                f"± half of an interval at {100 * self.summary.confidence:g} % confidence, - not resolved",
                *tables.resting_on(self.assumed, self.sources, self.origins),
                *self.warnings,
            ],
        )

    @property
    def _other_pose(self) -> str:
        """Text about the pose of ``relative_to``, or empty."""
        if self.relative_to is None:
            return ""
        return f" relative to {repr(self.relative_to.name) if self.relative_to.name else 'a pose without a name'}"

    def _attributes(self) -> dict[str, Any]:
        return self.encoded(key for key in self.KEYS if key.strip("*_").partition("=")[0] in _ATTRIBUTES)


def _columns(levels: Iterable[float] = ()) -> list[Column]:
    """Return the columns of a distribution; in data frames also the quantiles of these levels."""
    headings: dict[str | float, str] = {"mean": "mean", "std": "std", 0.5: "50 %", 0.95: "95 %", 0.9973: "99.73 %"}
    return [
        *QUANTITY,
        *(Column(partial(_with_half_width, statistic), notebook=heading) for statistic, heading in headings.items()),
        *(Column(partial(_with_interval, name), frame=name, has_interval=True) for name in ("mean", "std")),
        Column("min", tables.milli, notebook="smallest seen", frame="min"),
        Column("max", tables.milli, notebook="largest seen", frame="max"),
        Column(partial(_with_interval, "mode"), frame="mode", has_interval=True),
        *(Column(partial(_with_interval, level), frame=f"quantile_{level}", has_interval=True) for level in levels),
    ]


def _with_interval(key: str | float, law: Distribution) -> tuple[float | None, tuple[float, float] | None]:
    # as in the JSON, low quantiles of a norm are not reported
    return law.value_and_interval(key) if isinstance(key, str) or key in law.levels else (None, None)


def _with_half_width(key: str | float, law: Distribution) -> str | None:
    (value, _), half_width = law.value_and_interval(key), law.half_width(key)
    if value is None or half_width is None:
        return None
    return "0" if max(-law.min, law.max) < tables.ROUNDING else tables.plus_minus(1e3 * value, 1e3 * half_width)


def specification_columns(confidence: float = 0.95) -> list[Column]:
    """Return the columns of the table of specifications."""

    def inside(form: str) -> Callable[[SpecificationResult], str]:
        return lambda result: form.format(*format_share(result.probability, result.interval, result.required))

    return [
        Column(lambda result: tables.absolute(result.quantity), notebook="specification"),
        Column(lambda result: f"{tables.milli(result.limit)} {tables.unit(result.quantity)}", notebook="limit"),
        Column(limit_text, report="limit"),
        Column("required", lambda share: f"{100 * share:.10g} %", notebook="required", report="required inside"),
        Column(inside("{} %"), notebook="inside", report="inside"),
        Column(inside("{1} to {2} %"), notebook="interval"),
        Column(inside("[{1}, {2}] %"), report=f"interval at {100 * confidence:g} % confidence"),
        Column(lambda result: result.verdict if result.met else result.verdict.upper(), notebook=""),
        Column(
            lambda result: (result.verdict, result.met),
            lambda pair: element("strong", pair[0], class_="good" if pair[1] else "bad"),
            report="verdict", is_words=True,
        ),
    ]  # fmt: skip


def limit_text(result: SpecificationResult) -> str:
    """Return quantity and limit as text."""
    return tables.bounded(result.quantity, result.limit)


_COMPONENTS: Final = ("dx", "dy", "dz", "rx", "ry", "rz")
_ATTRIBUTES: Final = (
    "schema", "robot", "base", "tip", "axes", "datum", "pose", "relative_to", "samples", "seed", "model", "statics", "confidence",
    "versions",
)  # fmt: skip
