"""One self-contained HTML page: the arm, its end-effector frame, and the exaggerated cloud of sampled errors.

The page needs no network, no server and no plug-in, and runs in a sandboxed frame: the scene is a list of MeshCat
commands, which the bundled viewer (MeshCat and three.js) of the ``meshcat`` package replays in the reader's browser.
"""

from .page import page, write_page
from .scales import DEFAULT_POINTS, MOST_POINTS

__all__ = ["DEFAULT_POINTS", "MOST_POINTS", "page", "write_page"]
