"""The forecast of a test by ISO 9283:1998: the law of every figure over built robots and over tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, final

from numpy.typing import ArrayLike

from precision_pin.analyses.iso9283.comparison import Comparison, compare_with
from precision_pin.analyses.iso9283.figure_law import LEVELS, FigureLaw
from precision_pin.analyses.iso9283.pose_forecast import OF_POSE, SINGLE, PoseForecast
from precision_pin.analyses.iso9283.standard_poses import Cube
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import warns_at_end
from precision_pin.base.errors import Finding
from precision_pin.render.notebook import Table, rendered
from precision_pin.render.result_io import JsonResult
from precision_pin.render.tables import data_frame, dataset, interval_columns, milli, number
from precision_pin.statistics import SpecificationResult

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.figure import Figure


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Iso9283Result(JsonResult):
    """The law of every figure of ISO 9283:1998 over built robots and over tests; base axes, m and rad.

    Attributes
    ----------
    provenance
        Robot, seed and software versions.
    cycles, robots
        Cycles of a test, and built robots, each tested once.
    confidence
        Confidence of every interval by itself.
    target
        The measured point in tool axes, m, ``(3,)``.
    mass
        Load: mass at the target beside the loads of the sheet, kg.
    fit_base
        Whether the barycentres were aligned to the commanded positions by the best fit over the poses.
    poses
        By the name in the standard, P1 …
    worst
        AP and RP of the pose where a robot's is the largest.
    AD, RD
        Distance accuracy and repeatability between P2 and P4; ``None`` with fewer than four poses.
    E
        Exchangeability: the largest distance of the barycentres of five robots at P1; ``None`` where the sheet cannot say.
    vAP
        Multi-directional accuracy at P1 over paths along the three base axes; ``None`` where no error follows the direction.
    RP_bidirectional
        RP at P1 of the cycles over these three paths together, by the formula of RP; ``None`` where vAP is.
    drift
        max |AP_0 - AP_t| at P1 over eight hours from cold; ``None`` where no thermal source has a time constant.
    cube
        The cube found within reach; ``None`` where the poses were given.
    measured
        A measured robot beside the forecast, of :meth:`compare`.
    specifications
        The share of robots that keep each limit in a test.
    absent
        Why a figure is ``None``, by its name.
    findings
        Findings passed in, such as those of the sheet.
    warnings
        One line each: the findings, then the warnings of the forecast.
    """

    schema: ClassVar[str] = "precision-pin/iso9283/1"

    provenance: Provenance
    cycles: int
    robots: int
    confidence: float
    target: Array
    mass: float
    fit_base: bool
    poses: Mapping[str, PoseForecast]
    worst: Mapping[str, FigureLaw]
    AD: FigureLaw | None
    RD: FigureLaw | None
    E: FigureLaw | None
    vAP: FigureLaw | None = None
    RP_bidirectional: FigureLaw | None = None
    drift: FigureLaw | None = None
    cube: Cube | None = None
    measured: Comparison | None = None
    specifications: tuple[SpecificationResult, ...] = ()
    absent: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def met(self) -> bool:
        """Whether every specification is met; true without any."""
        return all(one.met for one in self.specifications)

    def laws(self) -> Iterator[tuple[str, str, FigureLaw]]:
        """Yield pose and name of every figure, with its law; the pose is empty for those of no pose."""
        for pose, forecast in self.poses.items():
            for name in OF_POSE:
                yield pose, name, getattr(forecast, name)
        for name in SINGLE:
            law = getattr(self, name)
            if law is not None:
                yield "", name, law

    @warns_at_end
    def compare(self, attained: Mapping[str, ArrayLike]) -> Iso9283Result:
        """Return the result with the measured cycles of a robot beside the forecast, as ``measured``.

        Parameters
        ----------
        attained
            Attained positions of the target ``(n, 3)``, or poses ``(n, 4, 4)``, in base axes, m, row j of cycle j; by the name
            of the pose in the sheet, P1, P2, …, or its number as text. Some of the poses are enough, but for a best fit.

        Raises
        ------
        InputError
            Another shape, another number of cycles than that of the forecast, or no poses.
        UnknownNameError
            A pose that the forecast does not have.
        """
        laws = {name: law for name, law in (("AD", self.AD), ("RD", self.RD)) if law is not None}
        return replace(
            self, measured=compare_with(self.poses, laws, attained, cycles=self.cycles, fit_base=self.fit_base)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the result in the ``precision-pin/iso9283/1`` schema, SI units; null where the sheet cannot say."""
        single = {name: getattr(self, name) for name in SINGLE}
        return self._head() | {
            "poses": {name: forecast.to_dict() for name, forecast in self.poses.items()},
            "worst": {name: law.to_dict() for name, law in self.worst.items()},
            **{name: None if law is None else law.to_dict() for name, law in single.items()},
            "absent": dict(self.absent),
            "spec": [one.to_dict() for one in self.specifications],
            "cube": None if self.cube is None else self.cube.to_dict(),
            "measured": None if self.measured is None else self.measured.to_dict(),
        }

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad: a row for each pose and figure, the pose empty for AD, RD and E.

        The columns are ``mean``, ``std``, and ``quantile_0.95``, … with ``…_lower`` and ``…_upper``.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        rows = [((pose, name), _columns(law)) for pose, name, law in self.laws()]
        return data_frame(["pose", "figure"], rows, self._head())

    def to_xarray(self) -> xarray.Dataset:
        """Return the result as a dataset with the dimensions ``pose`` and ``figure``, m and rad; NaN where there is none.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        return dataset(self.to_pandas())

    def plot(self) -> Figure:
        """Draw the laws of AP and RP at the poses.

        Returns
        -------
        Figure
            The figure, which a notebook shows and ``savefig`` writes.
        """
        # plots rest on results, not results on plots
        drawn: Figure = import_module("precision_pin.analyses.iso9283.figure").figure(self)
        return drawn

    def _head(self) -> dict[str, Any]:
        return {
            **self.provenance.to_dict(self.schema),
            "model": "exact",
            **{name: getattr(self, name) for name in ("cycles", "robots", "confidence", "fit_base")},
            "load": self.mass,
            "target": self.target.tolist(),
            "warnings": list(self.warnings),
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def _repr_html_(self) -> str:
        """Return the notebook view: AP and RP at every pose, mm."""
        rows = [
            [pose, *(milli(law.quantile(p)) for law in (at.AP, at.RP) for p in (0.5, 0.95)), milli(at.RP_limit.mean)]
            for pose, at in self.poses.items()
        ]
        columns = ["pose", "AP median [mm]", "AP 95 %", "RP median [mm]", "RP 95 %", "RP of endless cycles, mean"]
        of = self.provenance
        note = f"{self.robots:,} robots, each tested once with {self.cycles} cycles, seed {of.seed}"
        title = f"ISO 9283 of {of.robot}: {of.base} to {of.tip}"
        return rendered(title, [Table(columns, rows)], [note, *self.warnings])

    def __repr__(self) -> str:
        of = self.provenance
        return (
            f"<Iso9283Result of {of.robot!r}, {of.base!r} to {of.tip!r}: {len(self.poses)} poses, {self.robots:,} robots, "
            f"{self.cycles} cycles, seed {of.seed}>"
        )


def _columns(law: FigureLaw) -> dict[str, float]:
    found = {"mean": law.mean, "std": number(law.std)}
    for level in LEVELS:
        found |= interval_columns(f"quantile_{level}", law.quantile(level), law.quantile_interval(level))
    return found
