"""Tolerances of a population as text for a terminal."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.calibration.population import Population
from precision_pin.base.text_escape import shortened, visible
from precision_pin.render.text_table import aligned

_NAME: Final = 44
_ROWS: Final = 60


def population_table(result: Population) -> str:
    """Return how many tolerances are other than the sheet's, and each with its interval."""
    of = result.provenance
    other = [one for one in result.tolerances if not one.agrees]
    verdict = f"{len(other):,} of {len(result.tolerances):,} tolerances are other than the sheet's"
    rows = [["draw", "", "measured std", "of the sheet's", f"{100 * result.confidence:g} %", "interval", ""]]
    order = sorted(result.tolerances, key=lambda one: (one.agrees, -one.scale))
    for one in order[:_ROWS]:
        high = f"{one.high:.3g}" if one.high < float("inf") else "no limit"
        mark = "" if one.agrees else "other"
        name = shortened(" and ".join(one.names), _NAME)
        rows.append([name, "", f"{one.std:.3g}", f"{one.scale:.3g}", f"{one.low:.3g}", high, mark])
    lines = [
        f"{result.robots:,} robots {visible(of.robot)}, {visible(of.base)} to {visible(of.tip)}: {verdict}",
        f"means {'estimated too, restricted likelihood' if result.means == 'estimated' else 'of the sheet'}; likelihood ratio "
        f"to the sheet's {result.log_likelihood_ratio:.4g} (chi-square of {len(result.tolerances)} where the sheet is right)",
        "",
        *aligned(rows),
        *([f"… and {len(order) - _ROWS:,} more in the JSON"] if len(order) > _ROWS else []),
        "std in SI units; of the sheet's: measured over the sheet's standard deviation; profile likelihood",
    ]
    if result.unseen:
        lines.append(f"no reading shows {', '.join(map(visible, result.unseen))}")
    lines += [f"hardly more than a joint tolerance of {', '.join(group.names)}" for group in result.groups]
    return "\n".join(lines)
