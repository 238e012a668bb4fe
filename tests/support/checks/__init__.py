"""One check for every kind of source, against numbers worked by hand and against a second route.

Each takes the module to check, so that the suite can show that it notices a planted fault. Failures are AssertionErrors.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from support.checks.axis_install import check_axis_install
from support.checks.backlash import check_backlash
from support.checks.beam import check_beam
from support.checks.bearing_stiffness import check_bearing_stiffness
from support.checks.clearance import check_clearance
from support.checks.covariance import check_covariance
from support.checks.encoder import check_encoder
from support.checks.frame import check_frame
from support.checks.joint_compliance import check_joint_compliance
from support.checks.joint_offset import check_joint_offset
from support.checks.length import check_length
from support.checks.levelling import check_levelling
from support.checks.mcpc import check_mcpc
from support.checks.mounting import check_mounting
from support.checks.payload import check_payload
from support.checks.table import check_table
from support.checks.thermal import check_thermal
from support.checks.transmission import check_transmission

CHECKS: dict[str, Callable[[ModuleType], None]] = {
    "axis_install": check_axis_install,
    "backlash": check_backlash,
    "beam": check_beam,
    "bearing_stiffness": check_bearing_stiffness,
    "clearance": check_clearance,
    "covariance": check_covariance,
    "encoder": check_encoder,
    "frame": check_frame,
    "joint_compliance": check_joint_compliance,
    "joint_offset": check_joint_offset,
    "length": check_length,
    "levelling": check_levelling,
    "mcpc": check_mcpc,
    "mounting": check_mounting,
    "payload": check_payload,
    "table": check_table,
    "thermal": check_thermal,
    "transmission": check_transmission,
}
