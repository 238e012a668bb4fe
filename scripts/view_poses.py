"""Where does the hand end up in two poses, and how does that look? Writes one 3-D page for each.

Usage: python view_poses.py [FOLDER]

The paper's arm and its error sources come with the package; 5,000 units are sampled for the paper's pose and for a
folded one. Open the pages in any browser; they need no network.
"""

import sys
from pathlib import Path

import numpy as np

from precision_pin.base.files import write_text
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose, page
from precision_pin.robot.examples import PAPER_SHEET

SEED = 1
SAMPLES = 5_000


def main(folder: Path) -> None:
    """Write the pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    model = ErrorModel.load(PAPER_SHEET)
    poses = {"paper": model.configuration("paper"), "folded": np.radians([-60.0, -40.0, 110.0, -70.0])}
    for pose, (name, q) in enumerate(poses.items()):
        at = model.at(q)
        errors = at.exact(model.space.sample(SEED, 0, SAMPLES, pose=pose))
        text = page(
            [ViewPose(at, errors, name, pose)], title=f"The paper's arm, pose “{name}”", seed=SEED, model_name="exact"
        )
        path = folder / f"view_{name}.html"
        write_text(path, text)
        median = 1e3 * np.median(np.linalg.norm(errors[:3], axis=0))
        print(f"{path}: half of the units miss by more than {median:.2f} mm")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
