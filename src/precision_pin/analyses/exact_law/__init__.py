"""Distribution of the first-order error, by Fourier inversion."""

from precision_pin.analyses.declaration import Declaration, Option

DECLARATION = Declaration(
    name="exact-law",
    function=f"{__name__}.exact_law:exact_law",
    result=f"{__name__}.exact_law_result:ExactLawResult",
    outputs="precision_pin.analyses.exact_law",
    title="Exact law",
    heading="Exact law against sampling",
    summary="Compute the law of every component of the first-order error, tails included, without sampling.",
    description="Compute the law of every component of the first-order error, tails included, without sampling.",
    options=(Option("--samples", "samples", "Samples to compare with.", int, 100_000, "N", is_of_sampling=True),),
    steps=f"{__name__}.exact_law:count_steps",
    has_warnings_in_table=True,
)
