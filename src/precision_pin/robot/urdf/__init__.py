"""Strict reader of URDF files, run before any C++ code; their canonical form; changes of root.

`read` refuses a file that a lenient parser would turn into a silently wrong robot; `check` lists all findings
about a file; `canonical` writes the only form that Pinocchio reads.
"""

from precision_pin.robot.urdf.meshes import locate_mesh
from precision_pin.robot.urdf.reader import check, parse, read
from precision_pin.robot.urdf.robot import (
    Box,
    Cylinder,
    Inertial,
    Joint,
    Limit,
    Limits,
    Link,
    Mesh,
    Robot,
    Shape,
    Sphere,
    Vector,
    ask_for_tip,
    draft_command,
    gripper_joint,
    likeliest_tip,
)
from precision_pin.robot.urdf.transforms import canonical, rerooted, rpy_of, snapped

__all__ = [
    "Box",
    "Cylinder",
    "Inertial",
    "Joint",
    "Limit",
    "Limits",
    "Link",
    "Mesh",
    "Robot",
    "Shape",
    "Sphere",
    "Vector",
    "ask_for_tip",
    "canonical",
    "check",
    "draft_command",
    "gripper_joint",
    "likeliest_tip",
    "locate_mesh",
    "parse",
    "read",
    "rerooted",
    "rpy_of",
    "snapped",
]
