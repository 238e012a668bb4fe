"""Terminal table of the ISO 9283 forecast."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.analyses.iso9283.result import LEAST, SINGLE, Comparison, Iso9283Result
from precision_pin.base.errors import shown, visible
from precision_pin.render.tables import ROUNDING, milli, plain
from precision_pin.render.text_table import aligned, limited
from precision_pin.sampling.table import verdict_line
from precision_pin.statistics import SampleLaw, SpecificationResult, format_inside
from precision_pin.statistics.intervals import format_interval

# maximum number of differing figures that the verdict names
_MOST_DIFFERING: Final = 6


def iso9283_table(result: Iso9283Result) -> str:
    """Return a buyer's summary, then the figures of each pose."""
    of = result.provenance
    distances = distance_rows(result)
    lines = [
        *answers(result),
        "",
        *setting_lines(result),
        "",
        *aligned(position_rows(result)),
        "",
        *aligned(angle_rows(result)),
        "",
        *(aligned(distances) if len(distances) > 1 else []),
        *([] if result.measured is None else ["", *_measured_rows(result.measured)]),
        "",
        *(f"{name}: none, {why}" for name, why in result.absent.items()),
        *of.resting_lines,
    ]
    return "\n".join(lines)


def answers(result: Iso9283Result) -> list[str]:
    """Return the summary: RP and AP that robots will show, the verdicts, and whether a measured robot agrees."""
    return [
        headline(result, "RP"),
        headline(result, "AP"),
        *(_verdict_line(spec, len(result.poses)) for spec in result.specifications),
        *([] if result.measured is None else [verdict(result.measured)]),
    ]


def setting_lines(result: Iso9283Result) -> list[str]:
    """Return the test settings."""
    of = result.provenance
    target = ", ".join(plain(1e3 * x) for x in result.target)
    point = f"; target {target} mm in tool axes" if result.target.any() else ""
    poses = "1 pose" if len(result.poses) == 1 else f"{len(result.poses)} poses"
    cube = []
    if result.cube is not None:
        centre = ", ".join(plain(1e3 * x) for x in np.round(result.cube.centre, 4))
        side = f"side {1e3 * result.cube.side:.0f} mm, centre ({centre}) mm"
        cube = [f"largest cube within reach: {side}; P2 to P5 in the plane along {result.cube.plane_name}"]
    load = f"; load {plain(result.mass)} kg" if result.mass else ""
    fit = "; base aligned by the best fit over the poses" if result.fit_base else "; base not aligned"
    return [
        f"ISO 9283 of {visible(of.arm)}, {poses}{point}{load}{fit}",
        f"{result.robots:,} robots, each tested once with {result.cycles} cycles, seed {of.seed}, exact model, statics "
        f"{of.statics}",
        *cube,
        f"quantiles over robots and tests; [intervals] at {result.confidence:.0%} confidence",
    ]


def headline(result: Iso9283Result, figure: str) -> str:
    """Return as a sentence which RP or AP 95 % of robots will show."""
    if figure == "RP" and not result.worst[figure].values.any():
        return "RP is 0: nothing in the sheet changes from visit to visit, so it does not say how a robot repeats"
    value, interval = _quantile(result.worst[figure], 0.95)
    if value == "-":
        return f"{result.robots:,} robots are too few for the 95 % quantile of {figure}"
    where = "" if len(result.poses) == 1 else ", at every pose"
    return f"95 % of robots built will show {figure} of {value} mm or less in a test{where} {interval}"


def verdict(measured: Comparison) -> str:
    """Return as a sentence whether the measured robot agrees with the forecast."""
    count = f"{len(measured.figures)} figures"
    if measured.agrees is None:
        return f"measured: {measured.robots} simulated robots are too few to judge {count}"
    if measured.agrees:
        return (
            f"measured: AGREES - none of {count} lies outside what the sheet forecasts (p = {measured.probability:.2g}, "
            f"corrected for their number); a robot that agrees does not prove the sheet"
        )
    parts = [
        f"{entry.name}{f' at {entry.pose}' if entry.pose else ''} {milli(entry.value, 3)} {_unit(entry.name)} "
        f"({'above' if entry.below > 0.5 else 'below'} {_percent(max(entry.below, 1 - entry.below))})"
        for entry in measured.differing[: limited(_MOST_DIFFERING)]
    ]
    unlisted = len(measured.differing) - len(parts)
    return (
        f"measured: DIFFERS - {len(measured.differing)} of {count} outside what the sheet forecasts (p = "
        f"{measured.probability:.2g}, corrected for their number; limit {LEAST:g}), above or below so many of the "
        f"simulated robots: {'; '.join(parts)}"
        f"{f'; and {unlisted} more: --all' if unlisted > 0 else ''}"
    )


def _verdict_line(result: SpecificationResult, poses: int) -> str:
    every = " at every pose" if result.quantity not in SINGLE and poses > 1 else ""
    within = f"{1e3 * result.limit:.6g} {_unit(result.quantity)}"
    demand = f"spec {result.quantity} within {within} for {100 * result.required:.10g} %{every}"
    hint = ": more robots decide it" if result.verdict == "undecided" else ""
    of = "groups of five robots" if result.quantity == "E" else "robots"
    return verdict_line(demand, result, f"{{share}} % of {of} keep it in a test, interval {{low}} to {{high}} %{hint}")


def position_rows(result: Iso9283Result) -> list[list[str]]:
    """Return AP and RP at each pose, mm, headings first."""
    rows = [["mm", "", "AP median", "95 %", "interval", "RP median", "95 %", "interval", "many cycles"]]
    for pose, at in result.poses.items():
        figures = [cell for law in (at.AP, at.RP) for cell in (_quantile(law, 0.5)[0], *_quantile(law, 0.95))]
        name = shown(at.label.name) if at.label.name not in ("", None, pose) else ""
        rows.append([pose, name, *figures, milli(at.RP_limit.mean, 4)])
    return rows


def angle_rows(result: Iso9283Result) -> list[list[str]]:
    """Return AP and RP of the angles at each pose, mrad, headings first."""
    rows = [["mrad", "5 % to 95 %", *(f"AP_{axis}" for axis in "abc"), "95 %", *(f"RP_{axis}" for axis in "abc")]]
    for pose, at in result.poses.items():
        laws = [getattr(at, f"AP_{axis}") for axis in "abc"]
        spans = [f"{_quantile_text(law, 0.05)} to {_quantile_text(law, 0.95)}" for law in laws]
        rows.append([pose, "", *spans, "", *(_quantile_text(getattr(at, f"RP_{axis}"), 0.95) for axis in "abc")])
    return rows


def distance_rows(result: Iso9283Result) -> list[list[str]]:
    """Return the figures of a whole test, mm, headings first."""
    rows = [["mm", "", "5 %", "median", "95 %", "interval"]]
    meanings = {
        "AD": "distance accuracy P2 to P4",
        "RD": "distance repeatability P2 to P4",
        "E": "five robots at P1",
        "vAP": "three paths of approach at P1",
        "RP_bidirectional": "the cycles of these paths together",
        "drift": "eight hours from cold at P1",
    }
    for name, meaning in meanings.items():
        law = getattr(result, name)
        if law is not None:
            rows.append([name, meaning, _quantile_text(law, 0.05), _quantile_text(law, 0.5), *_quantile(law, 0.95)])
    return rows


def _measured_rows(measured: Comparison) -> list[str]:
    rows = [["measured", "unit", "AP", "robots below", "RP", "robots below"]]
    headings = [
        (pose, f"{pose}{suffix.replace('_', ' ')}", (f"AP{suffix}", f"RP{suffix}"))
        for pose in measured.poses
        for suffix in ("", "_a", "_b", "_c")
    ]
    for pose, heading, names in (*headings, ("", "AD, RD", ("AD", "RD"))):
        figures = [measured.figure(pose, name) for name in names]
        cells = [cell for f in figures if f is not None for cell in (milli(f.value, 4), _percent(f.below))]
        rows += [[heading, _unit(names[0]), *cells]] if cells else []
    return aligned(rows)


def _quantile(law: SampleLaw, level: float) -> tuple[str, str]:
    value, interval = law.resolved_quantile(level), law.quantile_interval(level)
    if value is None or interval is None:
        return "-", "-"
    if max(map(abs, interval)) < ROUNDING:
        return "0", "[0, 0]"
    low, high = format_interval(*interval, 1e3)
    return format_inside(1e3 * value, (1e3 * interval[0], 1e3 * interval[1]), most=5), f"[{low}, {high}]"


def _quantile_text(law: SampleLaw, level: float) -> str:
    return _quantile(law, level)[0]


def _percent(share: float) -> str:
    return "all" if share == 1 else f"{100 * share:.4g} %"


def _unit(figure: str) -> str:
    return "mrad" if figure[-2:] in ("_a", "_b", "_c") else "mm"
