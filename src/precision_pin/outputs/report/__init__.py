"""One self-contained HTML page about one pose of an arm: everything that the other commands find out.

Each section is one file, a function from :class:`Results` to markup. Markup is made of values (:mod:`.elements`) that escape
all text, so that no name of a URDF or a sheet is ever markup.
"""

from .page import page
from .results import STEPS, Results, Step, collect

__all__ = ["STEPS", "Results", "Step", "collect", "page"]
