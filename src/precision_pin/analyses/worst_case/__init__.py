"""Largest error that bounded tolerances can cause together."""

from precision_pin.analyses.declaration import AT_POSES, INPUTS, SAMPLING, Declaration, Option

DECLARATION = Declaration(
    name="worst-case",
    function=f"{__name__}.worst_case:worst_case",
    result=f"{__name__}.worst_case:WorstCaseResult",
    title="Worst case",
    heading="Worst case",
    summary="Bound the pose error if every tolerance does its worst at once.",
    description=f"Bound the pose error if every tolerance does its worst at once.\n\n{INPUTS}",
    options=(
        *AT_POSES,
        Option("--k", "k", "Cut unbounded laws at k standard deviations.", float, 3.0),
        Option(
            "--samples", "samples", "Samples for comparison.", int, 100_000, "N",
            check="precision_pin.sampling.blocks:check_samples", group=SAMPLING,
        ),
    ),
    report_settings=("samples",),
)  # fmt: skip
