"""Strict reading of URDF before any C++ sees it, its canonical form, and changes of root.

`read` refuses what a lenient parser would turn into a silently wrong robot; `check` lists what there is to
say about a file; `canonical` writes the one form that Pinocchio gets to see.
"""

from .angles import snapped
from .canonical import UNLIMITED, canonical
from .data import (
    Box,
    Cylinder,
    Geometry,
    Inertial,
    Joint,
    JointKind,
    Limit,
    Limits,
    Link,
    Mesh,
    Mimic,
    Shape,
    Sphere,
    Vector,
)
from .meshes import locate_mesh
from .reader import check, parse, read
from .reroot import rerooted, rpy_of
from .robot import Robot

__all__ = [
    "UNLIMITED",
    "Box",
    "Cylinder",
    "Geometry",
    "Inertial",
    "Joint",
    "JointKind",
    "Limit",
    "Limits",
    "Link",
    "Mesh",
    "Mimic",
    "Robot",
    "Shape",
    "Sphere",
    "Vector",
    "canonical",
    "check",
    "locate_mesh",
    "parse",
    "read",
    "rerooted",
    "rpy_of",
    "snapped",
]
