"""Assumptions and warnings."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.analyses.collect import Missing, Results
from precision_pin.analyses.registry import declarations
from precision_pin.pages.report.wording import subject, without_folders
from precision_pin.render.html import Child, Html, definitions, element, items, joined, paragraph, section
from precision_pin.render.tables import milli, resting_on

_MODELS = {
    "exact": "exact: the displaced chain is multiplied out for every sampled robot",
    "linear": "linear: the displacements are superposed to first order, as in the paper",
}
_STATICS = {
    "nominal": "nominal: loads act on the undeflected arm",
    "equilibrium": "equilibrium: loads act on the arm as it comes to rest under them",
}
_RULE = (
    "met when the lower end of the interval of the share inside reaches what is required, not met when the upper end does "
    "not, undecided between"
)
_SCOPES = {"unit": "once for each built robot", "pose": "once for each robot and pose", "visit": "at each visit"}


def assumptions(poses: Sequence[Results]) -> Html:
    """Return poses, model, statics, scopes, confidence, the error at the means and all warnings."""
    results = poses[0]
    analysis = results.analysis
    entries: list[tuple[str, Child]] = [
        *(("Pose", subject(one)) for one in poses),
        ("Model", _MODELS[analysis.model]),
        ("Statics", _STATICS[analysis.statics]),
        ("Axes", f"errors are position d and rotation vector δ of {analysis.tip}, in the axes of {analysis.base}"),
        (
            "Nominal",
            "zero error is the chain of the URDF, rigid and without tolerances, at the joint values of the pose",
        ),
        *(("Error at the means", _at_means(one, len(poses) > 1)) for one in poses),
        *(("Assumed", line) for line in resting_on(analysis.assumed, analysis.sources, analysis.origins)),
        ("Random numbers", _scopes(results)),
        *([("Verdict", _RULE)] if analysis.summary.specifications else []),
        ("Confidence", f"{100 * analysis.summary.confidence:g} % for each interval by itself"),
        ("Digits", "only those that the samples support; – is not resolved by this many samples"),
    ]
    entries += [("Correlation", pair) for group in analysis.correlations for pair in group.pairs]
    return section("assumptions", "Assumptions and warnings", definitions(entries), _warnings(poses), folded=False)


def _at_means(results: Results, is_named: bool) -> str:
    nominal = [milli(value, 5) for value in results.analysis.nominal]
    where = f"pose {results.analysis.pose_name}: " if is_named and results.analysis.pose_name else ""
    return f"{where}with every parameter at its mean: d = ({', '.join(nominal[:3])}) mm, δ = ({', '.join(nominal[3:])}) mrad"


def _scopes(results: Results) -> str:
    drawn = [f"{count:,} {_SCOPES[scope]}" for scope, count in results.analysis.scopes.items() if count]
    return ", ".join(drawn) if drawn else "none: nothing varies"


def _warnings(poses: Sequence[Results]) -> Html:
    lines = [(line, results) for results in poses for line in results.analysis.warnings]
    for results in poses:
        for name, result in results.found.items():
            # what a section says itself is not said twice
            if not isinstance(result, Missing) and not declarations()[name].has_warnings_in_table:
                lines += [(line, results) for line in result.warnings]
    shown = list(dict.fromkeys(without_folders(line, results) for line, results in lines))
    heading = element("h3", "Warnings")
    if not shown:
        return joined([heading, paragraph("None of the sheet, the URDF, the pose or the statics.")])
    return joined([heading, items(shown, "warnings")])
