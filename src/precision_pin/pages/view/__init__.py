"""View: one self-contained HTML page of the arm and its sampled errors, exaggerated together.

The page needs no network, server or plug-in, and runs in a sandboxed frame. The scene is a list of MeshCat commands,
which the bundled viewer (MeshCat and three.js) of the ``meshcat`` package replays in the browser; the page's own
scripts add the errors from numbers.
"""

from precision_pin.pages.view.page import page as page
from precision_pin.pages.view.page import script_hashes as script_hashes
from precision_pin.pages.view.poses import ViewPose as ViewPose
from precision_pin.pages.view.poses import limits_kept as limits_kept
from precision_pin.pages.view.poses import remarks_on as remarks_on
from precision_pin.pages.view.poses import sample_views as sample_views
from precision_pin.pages.view.scales import DEFAULT_POINTS as DEFAULT_POINTS
from precision_pin.pages.view.scales import MOST_POINTS as MOST_POINTS
from precision_pin.pages.view.scales import MOST_POSES as MOST_POSES
from precision_pin.pages.view.scales import check_factor as check_factor
