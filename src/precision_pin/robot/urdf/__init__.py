"""Strict reader of URDF files, run before any C++ code; their canonical form; changes of root.

`read` refuses a file that a lenient parser would turn into a silently wrong robot; `check` lists all findings about a
file; `canonical` writes the only form that Pinocchio reads.
"""

from precision_pin.robot.urdf.checks import snapped as snapped
from precision_pin.robot.urdf.meshes import locate_mesh as locate_mesh
from precision_pin.robot.urdf.reader import check as check
from precision_pin.robot.urdf.reader import parse as parse
from precision_pin.robot.urdf.reader import read as read
from precision_pin.robot.urdf.robot import Box as Box
from precision_pin.robot.urdf.robot import Cylinder as Cylinder
from precision_pin.robot.urdf.robot import Inertial as Inertial
from precision_pin.robot.urdf.robot import Joint as Joint
from precision_pin.robot.urdf.robot import Limit as Limit
from precision_pin.robot.urdf.robot import Limits as Limits
from precision_pin.robot.urdf.robot import Link as Link
from precision_pin.robot.urdf.robot import Mesh as Mesh
from precision_pin.robot.urdf.robot import Robot as Robot
from precision_pin.robot.urdf.robot import Shape as Shape
from precision_pin.robot.urdf.robot import Sphere as Sphere
from precision_pin.robot.urdf.robot import Vector as Vector
from precision_pin.robot.urdf.robot import ask_for_tip as ask_for_tip
from precision_pin.robot.urdf.robot import canonical as canonical
from precision_pin.robot.urdf.robot import draft_command as draft_command
from precision_pin.robot.urdf.robot import gripper_joint as gripper_joint
from precision_pin.robot.urdf.robot import likeliest_tip as likeliest_tip
from precision_pin.robot.urdf.robot import rerooted as rerooted
from precision_pin.robot.urdf.robot import rpy_of as rpy_of
