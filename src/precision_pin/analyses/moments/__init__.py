"""Mean and covariance of the exact error."""

from precision_pin.analyses.declaration import AT_POSES, INPUTS, SAMPLING, Declaration, Option

DECLARATION = Declaration(
    name="moments",
    function=f"{__name__}.moments:moments",
    result=f"{__name__}.moments:MomentsResult",
    title="Moments",
    heading="Moments, exact model against first order",
    summary="Mean and covariance of the exact error, and its bias against the first order, from few samples.",
    description=f"Estimate mean and covariance of the exact error, with far fewer samples than plain sampling takes.\n\n{INPUTS}",
    options=(
        *AT_POSES,
        Option(
            "--method", "method", "How; the last takes no samples.", default="control",
            choices=("control", "sobol", "sobol-control", "plain", "closed"),
        ),
        Option(
            "--samples", "samples", "Rounded up to 32 × a power of two.", int, 65_536, "N",
            check=f"{__name__}.moments:round_up_total", group=SAMPLING,
        ),
    ),
    steps=f"{__name__}.moments:count_steps",
    table_name="moments:table",
)  # fmt: skip
