"""The page, the table as CSV, and the two pictures."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.measured.declared import KNOWN, declaration
from benchmarks.measured.judge import Outcome
from benchmarks.plots import DOTS, NUMPY, OTHERS, OURS, STYLE

__all__ = ["csv_text", "tables", "write", "write_docs"]

MINUTES: Final = 3
"""Processor time of a set beyond which the page says so."""

HEADS: Final = (
    *(
        "robot",
        "instrument",
        "readings",
        "judged at",
        "forecast by",
        "forecast low",
        "forecast median",
        "forecast high",
    ),
    *("before", "as measured", "geometry", "geometry and drives", "published", "within 95 %", "verdict"),
    *("median", "gross"),
)
"""Columns of the CSV; lengths in mm."""


def millimetres(length: float | None) -> str:
    """Return a length to three digits, mm."""
    if length is None:
        return ""
    value = 1e3 * length
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(value))))}f}" if value > 0 else "0"


def cells(outcome: Outcome) -> list[str]:
    """Return a row of the CSV."""
    lengths = (
        *outcome.forecast,
        outcome.before,
        outcome.as_measured,
        outcome.geometry,
        outcome.complete,
        outcome.published,
    )
    return [
        *(outcome.robot, outcome.instrument, str(outcome.readings), outcome.judged, outcome.forecast_by),
        *map(millimetres, lengths),
        *("" if outcome.within is None else f"{100 * outcome.within:.1f}", outcome.verdict),
        *(millimetres(outcome.median), "" if outcome.gross is None else str(outcome.gross)),
    ]


def csv_text(outcomes: Sequence[Outcome]) -> str:
    """Return the CSV."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(HEADS)
    writer.writerows(map(cells, outcomes))
    return file.getvalue()


def tables(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Return tables in Markdown by name: robots that were calibrated, and robots by their factory's files."""
    calibrated = [
        "| robot, instrument | readings, judged at | forecast (95 %) | before | geometry | + drives | published | in 95 % "
        "| verdict |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    factory = ["| robot | forecast, 95 % band | measured | verdict |", "| --- | --- | --- | --- |"]
    for outcome in outcomes:
        row = dict(zip(HEADS, cells(outcome), strict=True))
        band = f"{row['forecast median']} ({row['forecast low']} to {row['forecast high']})"
        if outcome.geometry is None:
            factory.append(f"| {row['robot']} | {band}, {row['forecast by']} | {row['before']} | {row['verdict']} |")
            continue
        calibrated.append(
            f"| {row['robot']}, {row['instrument']} | {row['readings']}, {row['judged at']} | {band} | {row['before']} "
            f"| {row['geometry']} | **{row['geometry and drives'] or '—'}** | {row['published'] or '—'} | {row['within 95 %']} "
            f"| {row['verdict']} |"
        )
    named = {"calibrated": calibrated, "factory": factory}
    return {name: "\n".join(lines) for name, lines in named.items() if len(lines) > 2}


def draw_forecast(outcomes: Sequence[Outcome], path: Path) -> None:
    """Draw the band of each forecast, and the robot that was measured."""
    with mpl.rc_context(STYLE):
        picture = Figure(figsize=(7, 1.2 + 0.24 * len(outcomes)), layout="constrained")
        axes = picture.subplots()
        for row, outcome in enumerate(reversed(outcomes)):
            low, middle, high = (1e3 * value for value in outcome.forecast)
            axes.plot([low, high], [row, row], color=OURS, linewidth=7, alpha=0.35, solid_capstyle="butt")
            axes.plot([middle], [row], "|", color=OURS, markersize=9, markeredgewidth=2)
            axes.plot([1e3 * outcome.before], [row], "o", color=NUMPY)
        axes.set_yticks(range(len(outcomes)), [f"{outcome.robot}" for outcome in reversed(outcomes)])
        axes.tick_params(axis="y", length=0)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("mean position error, not calibrated (mm)")
        band = Line2D([], [], color=OURS, linewidth=7, alpha=0.35)
        middle_mark = Line2D([], [], color=OURS, marker="|", linestyle="", markersize=9, markeredgewidth=2)
        measured = Line2D([], [], color=NUMPY, marker="o", linestyle="")
        names = ["forecast: 95 % of robots", "median", "measured robot"]
        picture.legend([band, middle_mark, measured], names, frameon=False, loc="outside upper center", ncols=3)
        picture.savefig(path, dpi=DOTS)


def draw_unseen(outcomes: Sequence[Outcome], path: Path) -> None:
    """Draw the distances at unseen poses in order, before and after, for each robot that was calibrated."""
    shown = [outcome for outcome in outcomes if outcome.geometry is not None]
    labels: tuple[tuple[str, str, Any], ...] = (
        ("before", "base and target alone", OTHERS),
        ("geometry", "geometry", NUMPY),
        ("complete", "geometry and drives", OURS),
    )
    with mpl.rc_context(STYLE):
        rows = -(-len(shown) // 2)
        picture = Figure(figsize=(7, 0.8 + 2.3 * rows), layout="constrained")
        lines: list[Any] = []
        for axes, outcome in zip(picture.subplots(rows, 2, squeeze=False).flat, [*shown, None], strict=False):
            if outcome is None:
                axes.axis("off")
                continue
            lines = []
            for name, label, colour in labels:
                if name not in outcome.distances:
                    continue
                values = np.sort(1e3 * outcome.distances[name])
                share = (np.arange(values.size) + 0.5) / values.size
                lines += axes.plot(100 * share, values, ".-", color=colour, markersize=4, label=label)
            if outcome.published is not None:
                published = 1e3 * outcome.published
                lines.append(
                    axes.axhline(published, color="black", linewidth=0.8, linestyle=":", label="published mean")
                )
            axes.set(title=outcome.robot, yscale="log", xlabel="poses (%)", ylabel="error at unseen poses (mm)")
            axes.yaxis.set_major_formatter("{x:g}")
        legend = {line.get_label(): line for axes in picture.axes for line in axes.lines}
        picture.legend(legend.values(), legend.keys(), frameon=False, loc="outside upper center", ncols=2)
        picture.savefig(path, dpi=DOTS)


def write(outcomes: Sequence[Outcome], skipped: Sequence[str], out: Path) -> None:
    """Write ``measured.md``, ``measured.csv`` and the pictures into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "measured.csv").write_text(csv_text(outcomes), encoding="utf-8")
    pictures = [f"![{text}]({name})" for name, text in draw(outcomes, out).items()]
    parts = (
        "# Measured robots",
        "Mean distances in mm.",
        *tables(outcomes).values(),
        *pictures,
        notes(outcomes, skipped),
    )
    (out / "measured.md").write_text("\n\n".join(filter(None, parts)) + "\n", encoding="utf-8")


def draw(outcomes: Sequence[Outcome], folder: Path) -> dict[str, str]:
    """Draw the pictures that there are data for; return their names and what they show."""
    pictures = {"measured-forecast.png": "Band of the forecast and measured error of each robot"}
    draw_forecast(outcomes, folder / "measured-forecast.png")
    if any(outcome.geometry is not None for outcome in outcomes):
        draw_unseen(outcomes, folder / "measured-unseen.png")
        pictures["measured-unseen.png"] = "Error at unseen poses, in order"
    return pictures


def notes(outcomes: Sequence[Outcome], skipped: Sequence[str]) -> str:
    """Return a list of what was remarkable, took long or was skipped."""
    lines = [f"- {outcome.robot}: {note}" for outcome in outcomes for note in outcome.notes]
    lines += [
        f"- {outcome.robot}: the fits take more than {MINUTES} minutes"
        for outcome in outcomes
        if outcome.seconds > 60 * MINUTES
    ]
    return "\n".join([*lines, *(f"- skipped: {text}" for text in skipped)])


def data_table() -> str:
    """Return where the known sets are published, by the folder that holds them."""
    held = []
    for name in KNOWN:
        declared, home = declaration(name, Path())
        held.append(f"| `{home.name}` | {declared.source} | {declared.licence} |")
    return "\n".join(["| folder in FOLDER | published at | licence |", "| --- | --- | --- |", *dict.fromkeys(held)])


def write_docs(outcomes: Sequence[Outcome], skipped: Sequence[str], docs: Path) -> None:
    """Put tables, notes, CSV and pictures into the page ``real-robots.md`` of a folder of documentation."""
    page = docs / "real-robots.md"
    text = page.read_text(encoding="utf-8")
    for name, part in {**tables(outcomes), "notes": notes(outcomes, skipped), "data": data_table()}.items():
        mark = re.escape(f"<!-- bench: {name} -->")
        text = re.sub(
            f"({mark}\n).*?(<!-- bench end -->)",
            lambda found, part=part: f"{found[1]}\n{part}\n\n{found[2]}",
            text,
            flags=re.DOTALL,
        )
    page.write_text(text, encoding="utf-8")
    (docs / "real-robots.csv").write_text(csv_text(outcomes), encoding="utf-8")
    draw(outcomes, docs / "images")
