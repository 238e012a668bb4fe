"""One check for every kind of source, against numbers worked by hand and against a second route.

Each takes the module to check, so that the suite can show that it notices a planted fault. Failures are AssertionErrors.
"""

from collections.abc import Callable
from types import ModuleType

from support.checks import beam, bearings, drives, loads, places

CHECKS: dict[str, Callable[[ModuleType], None]] = {
    name.removeprefix("check_"): check
    for module in (beam, bearings, drives, loads, places)
    for name, check in vars(module).items()
    if name.startswith("check_")
}
