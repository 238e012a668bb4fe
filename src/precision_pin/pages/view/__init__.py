"""One self-contained HTML page: the arm, and its sampled errors in many guises, exaggerated together.

The page needs no network, no server and no plug-in, and runs in a sandboxed frame: the scene is a list of MeshCat
commands, which the bundled viewer (MeshCat and three.js) of the ``meshcat`` package replays in the reader's browser;
scripts of the page's own add what shows errors, from numbers.
"""

from precision_pin.pages.view.page import page as page
from precision_pin.pages.view.page import script_hashes as script_hashes
from precision_pin.pages.view.poses import ViewPose as ViewPose
from precision_pin.pages.view.poses import limits_kept as limits_kept
from precision_pin.pages.view.scales import DEFAULT_POINTS as DEFAULT_POINTS
from precision_pin.pages.view.scales import MOST_POINTS as MOST_POINTS
from precision_pin.pages.view.scales import MOST_POSES as MOST_POSES
from precision_pin.pages.view.scales import check_factor as check_factor
