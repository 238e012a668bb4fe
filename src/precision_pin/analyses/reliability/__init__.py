"""Probability of exceeding the limit of a specification."""

from precision_pin.analyses.declaration import AT_POSES, INPUTS, SAMPLING, Declaration, Option

DECLARATION = Declaration(
    name="reliability",
    function=f"{__name__}.reliability:reliability",
    result=f"{__name__}.reliability:ReliabilityResult",
    title="Reliability",
    heading="Reliability",
    summary="Probability that a limit is exceeded, by several methods, down to one in ten million and below.",
    description=f"Estimate how probable it is that the error exceeds a limit, down to one in ten million and below.\n\n{INPUTS}",
    options=(
        *AT_POSES,
        "beyond",
        Option(
            "--spec", "specifications", "A limit to judge; repeats.", metavar='"0.5 mm @ 99.73 %"', is_repeated=True,
            check="precision_pin.statistics.plan:listed_specifications",
        ),
        Option(
            "--samples", "samples", "Plain samples.", int, 100_000, "N",
            check="precision_pin.sampling.blocks:check_samples", group=SAMPLING,
        ),
    ),
    report_settings=("samples", "specifications"),
)  # fmt: skip
