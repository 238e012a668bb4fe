"""Error budget: the contribution of each tolerance to the pose error."""

from precision_pin.analyses.declaration import AT_POSES, INPUTS, SAMPLING, Declaration, Option

DECLARATION = Declaration(
    name="budget",
    function=f"{__name__}.budget:budget",
    result=f"{__name__}.budget_result:BudgetResult",
    title="Budget",
    heading="Error budget",
    summary="Share of each draw, source and joint in the spread of the error; what a halved tolerance would give.",
    description=f"""Show which draw, source and joint causes how much of the spread, and what a halved tolerance would change.

    {INPUTS}""",
    options=(
        *AT_POSES,
        Option(
            "--samples", "samples", "Points a set, rounded up to 32 × a power of two.", int, 16_384, "N",
            check=f"{__name__}.budget:round_up_points", group=SAMPLING,
        ),
        Option("--k", "k", "Unbounded laws reach k standard deviations in the share of the worst case.", float, 3.0),
        Option(
            "--quantity", "quantities",
            "position, attitude (the default: both), position.norm or |d|, position.x, dx or x, …; repeats.",
            metavar="QUANTITY", is_repeated=True, is_of_table=True, check=f"{__name__}.budget:check_quantities",
        ),
    ),
    steps=f"{__name__}.budget:count_steps",
    unit="robots",
    causes="causes:rank_causes",
)  # fmt: skip
