"""One self-contained HTML page: the arm, and its sampled errors in many guises, exaggerated together.

The page needs no network, no server and no plug-in, and runs in a sandboxed frame: the scene is a list of MeshCat
commands, which the bundled viewer (MeshCat and three.js) of the ``meshcat`` package replays in the reader's browser;
scripts of the page's own add what shows errors, from numbers.
"""

from precision_pin.pages.view.page import page, script_hashes
from precision_pin.pages.view.poses import ViewPose, limits_kept
from precision_pin.pages.view.scales import DEFAULT_POINTS, MOST_POINTS, MOST_POSES, check_factor

__all__ = [
    "DEFAULT_POINTS",
    "MOST_POINTS",
    "MOST_POSES",
    "ViewPose",
    "check_factor",
    "limits_kept",
    "page",
    "script_hashes",
]
