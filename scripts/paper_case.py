"""What error does the paper's arm have in the paper's pose? (Figs 5 and 6 of Wei, Jia and Chen, 2015)

    python scripts/paper_case.py [FOLDER]

Prints the statistics with the paper's 2,000 samples and with 100,000, and draws both figures into FOLDER.
"""

from __future__ import annotations

import sys
from pathlib import Path

import precision_pin as pp
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import figures
from precision_pin.sampling.table import analysis_table


def main(folder: Path) -> None:
    model = pp.ErrorModel.load(PAPER_SHEET)
    for samples in (2_000, 100_000):
        print(analysis_table(pp.monte_carlo(model, "paper", samples=samples, seed=0)), end="\n\n")
    result = pp.monte_carlo(model, "paper", samples=100_000, seed=0)
    folder.mkdir(parents=True, exist_ok=True)
    figures.save(
        figures.figure_position(result.summary, title="Position error, the paper's arm", seed=0), folder / "fig5"
    )
    figures.save(
        figures.figure_attitude(result.summary, title="Attitude error, the paper's arm", seed=0), folder / "fig6"
    )
    print(f"wrote {folder / 'fig5'} and {folder / 'fig6'} as .png and .svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("paper_case"))
