"""Base class of the results of all analyses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

from precision_pin.analyses.declaration import Declaration, load
from precision_pin.analyses.provenance import PoseLabel, Provenance
from precision_pin.analyses.registry import declarations
from precision_pin.base.arguments import check_whole
from precision_pin.base.arrays import Keys, Record
from precision_pin.base.errors import Finding, UnknownNameError, shown, visible
from precision_pin.render.columns import Column, frame_row, notebook_table
from precision_pin.render.html import Table, rendered
from precision_pin.render.result_io import JsonResult
from precision_pin.render.tables import MOST_POSES, UNITS, data_frame, dataset, joint_text, pose_labels
from precision_pin.sampling.table import pose_text

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class PoseResult(Protocol):
    """Result of an analysis at one pose."""

    @property
    def pose(self) -> PoseLabel:
        """Name and joint values of the pose."""

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``poses`` in the JSON."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Outcome(Record, JsonResult):
    """Base of every result, with or without a table; a subclass declares the keys of its JSON, ``"*head"`` first.

    Attributes:
        provenance: Robot, seed and software versions.
        findings: Findings passed in, such as those of the sheet; for a calibration also its own warnings.
        warnings: One line each: the findings, then the warnings of the analysis; empty where all are findings.
    """

    provenance: Provenance
    findings: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def head(self) -> dict[str, Any]:
        """First keys of the JSON: schema, robot, seed, versions."""
        return self.provenance.to_dict(self.schema)

    @property
    def new_warnings(self) -> tuple[str, ...]:
        """Warnings that are not among the findings passed in."""
        return self.warnings[len(dict.fromkeys(map(str, self.findings))) :]

    def _output(self, place: str) -> Any:
        """Return ``module:name`` from the result's own folder; imported late, because outputs depend on results."""
        return load(f"{type(self).__module__.rpartition('.')[0]}.{place}")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AnalysisResult(Outcome):
    """Result of an analysis that converts to a data frame and a figure.

    The keys of its JSON are ``"*head"``, its settings, ``assumptions``, ``warnings``, ``findings`` and its values.

    Attributes:
        ASSUMPTIONS: Assumptions that hold for every result of the class.
    """

    ASSUMPTIONS: ClassVar[tuple[str, ...]] = ()

    @property
    def met(self) -> bool | None:
        """Whether every specification is met; true without any, ``None`` where none could be judged."""
        return True

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions behind the numbers, one sentence each."""
        return self.ASSUMPTIONS

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        raise NotImplementedError

    def __repr__(self) -> str:
        run = self.provenance
        return f"<{type(self).__name__} of {run.robot!r}, {run.base!r} to {run.tip!r}: {self.summary}>"

    def settings(self) -> dict[str, Any]:
        """Return the settings for the JSON and data frames: its keys from the head to the findings."""
        return self.encoded(self.KEYS[: self.KEYS.index("findings") + 1])

    def to_pandas(self) -> pandas.DataFrame:
        """Return the result as a data frame, m and rad.

        Raises:
            InputError: pandas is not installed.
        """
        raise NotImplementedError

    def to_xarray(self) -> xarray.Dataset:
        """Return the result as a dataset, m and rad.

        The dimensions are the index levels of :meth:`to_pandas`, the variables its columns.

        Raises:
            InputError: xarray is not installed.
        """
        return dataset(self.to_pandas())

    def plot(self) -> Axes | Figure:
        """Draw the result."""
        return self._output("figure:figure")(self)

    @property
    def declaration(self) -> Declaration:
        """Declaration of the analysis."""
        return next(entry for entry in declarations().values() if load(entry.result) is type(self))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Result(AnalysisResult):
    """Result of an analysis at one or several poses, with all settings that reproduce it.

    A subclass adds its own settings, :meth:`to_pandas`, and title and notes of the notebook view. Its table there and the
    data frame follow from the columns and :meth:`rows`, unless it has others.

    Attributes:
        COLUMNS: Columns of the table of a pose, for all outputs.
        samples, confidence: Number of samples at each pose; confidence of each single interval.
        poses: One entry for each pose.
    """

    KEYS: ClassVar[Keys] = ("*head", "samples", "confidence", "assumptions", "warnings", "findings", "poses")

    COLUMNS: ClassVar[tuple[Column, ...]] = ()

    samples: int
    confidence: float
    poses: Sequence[PoseResult]

    def rows(self, pose: Any) -> Iterable[Any]:
        """Return the rows of the table of an entry of ``poses``, each with its ``quantity``."""
        raise NotImplementedError

    def plot(
        self, pose: int = 0, *, quantity: Literal["position", "attitude"] = "position", axes: Axes | None = None
    ) -> Axes | Figure:
        """Draw the result at one of its poses.

        Args:
            pose: Index of the pose, from 0.
            quantity: Panel to draw on given axes; a new figure shows both.
            axes: Matplotlib axes for one panel; ``None`` creates a figure with all panels, a legend and a caption.

        Returns:
            The given axes, or the new figure, which a notebook shows and ``savefig`` writes.

        Raises:
            UnknownNameError: There is no such quantity.
            InputError: There is no such pose.
        """
        if quantity not in UNITS:
            raise UnknownNameError("quantity", quantity, tuple(UNITS))
        number = check_whole("pose", pose, 0, len(self.poses) - 1)
        if axes is None:
            return self.declaration.figure(self, number)
        self.declaration.draw(axes, self, number, quantity)
        return axes

    @property
    def labels(self) -> list[str]:
        """Distinct names of the poses for data frames."""
        return pose_labels([entry.pose.name for entry in self.poses])

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of a data frame: the JSON with only the joint values of the poses."""
        joints = {label: dict(entry.pose.q) for label, entry in zip(self.labels, self.poses, strict=True)}
        return self.settings() | {"poses": joints}

    def _frame(
        self,
        levels: Sequence[str] = ("quantity",),
        columns: Sequence[Column] | None = None,
        rows: Callable[[Any], Iterable[tuple[tuple[str, ...], Any]]] | None = None,
    ) -> pandas.DataFrame:
        """Return a data frame indexed by pose and ``levels``; ``rows`` gives the labels and row of each row of a pose."""
        rows = rows or (lambda pose: (((row.quantity,), row) for row in self.rows(pose)))
        lines = [
            ((label, *labels), frame_row(columns or self.COLUMNS, row))
            for label, pose in zip(self.labels, self.poses, strict=True)
            for labels, row in rows(pose)
        ]
        return data_frame(["pose", *levels], lines, self.attributes())

    def _title(self) -> str:
        """Return the heading of the notebook view, without the robot."""
        raise NotImplementedError

    def _table(self, pose: Any) -> Table:
        """Return the table of the notebook view for an entry of ``poses``."""
        return notebook_table(self.COLUMNS, self.rows(pose), name_pose(pose.pose))

    def _notes(self) -> list[str]:
        """Return the lines below the tables, without the warnings."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        hidden = len(self.poses) - MOST_POSES
        return rendered(
            f"{self._title()} of {self.provenance.arm}",
            [self._table(pose) for pose in self.poses[:MOST_POSES]],
            [*([f"… and {hidden:,} more poses"] if hidden > 0 else []), *self._notes(), *self.warnings],
        )


def name_pose(pose: PoseLabel) -> str:
    """Return name and joint values of a pose, the heading of its table in a notebook."""
    return (f"pose {pose.name!r}: " if pose.name else "") + joint_text(pose.q, pose.sliding_joints, pose.approach)


def list_warnings(findings: Iterable[Finding], messages: Iterable[str]) -> tuple[str, ...]:
    """Return findings and further warnings as lines without repetitions."""
    return tuple(dict.fromkeys((*map(str, findings), *messages)))


def subject(provenance: Provenance, pose: PoseLabel) -> str:
    """Return the arm, the ends of its chain and the pose of a result."""
    label = pose_text(pose.name, pose.q, pose.sliding_joints, pose.approach)
    return f"{visible(provenance.arm)}, pose {label}"


def answer_of(labels: Sequence[PoseLabel], sizes: Sequence[float], sentences: Sequence[str]) -> str:
    """Return the sentence for the pose with the largest size, with its name if there are several."""
    worst = max(range(len(sizes)), key=sizes.__getitem__)
    if len(labels) == 1:
        return sentences[worst]
    name = shown(labels[worst].name) if labels[worst].name else str(worst + 1)
    return f"worst pose, {name}: {sentences[worst]}"
