"""Distribution of the first-order error, by Fourier inversion."""

from precision_pin.analyses.declaration import AT_POSES, INPUTS, SAMPLING, Declaration, Option

DECLARATION = Declaration(
    name="exact-law",
    function=f"{__name__}.exact_law:exact_law",
    result=f"{__name__}.exact_law:ExactLawResult",
    title="Exact law",
    heading="Exact law against sampling",
    summary="Compute the law of every component of the first-order error, tails included, without sampling.",
    description=f"Compute the law of every component of the first-order error, tails included, without sampling.\n\n{INPUTS}",
    options=(*AT_POSES, Option("--samples", "samples", "Samples to compare with.", int, 100_000, "N", group=SAMPLING)),
    steps=f"{__name__}.exact_law:count_steps",
    has_warnings_in_table=True,
    table_name="exact_law:table",
)
