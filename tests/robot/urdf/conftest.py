import importlib.metadata
from collections.abc import Callable
from pathlib import Path

import pytest

from precision_pin.base.errors import Finding, UrdfError
from precision_pin.robot.urdf import parse

# two turning joints, one sliding, a tool; nothing in it deserves a finding
ARM = """\
<?xml version="1.0"?>
<robot name="arm">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="foot"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.2 0 0" rpy="0 0 0"/>
      <mass value="2.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/>
    </inertial>
    <visual>
      <origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>
      <geometry><cylinder radius="0.05" length="0.4"/></geometry>
      <material name="grey"/>
    </visual>
  </link>
  <link name="fore">
    <inertial>
      <origin xyz="0.15 0 0"/>
      <mass value="1.5"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>
    </inertial>
  </link>
  <link name="ram"/>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="foot"/>
    <child link="upper"/>
    <origin xyz="0 0 0.3" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="1.5"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/>
    <child link="fore"/>
    <origin xyz="0.4 0 0" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 -1 0"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="fore"/>
    <child link="ram"/>
    <origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.25" effort="80" velocity="0.2"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="ram"/>
    <child link="tip"/>
    <origin xyz="0.05 0 0" rpy="0 0.5 0"/>
  </joint>
</robot>
"""


@pytest.fixture(scope="session")
def arm() -> str:
    return ARM


@pytest.fixture(scope="session")
def findings_of() -> Callable[[str | bytes], tuple[Finding, ...]]:
    def find(text: str | bytes) -> tuple[Finding, ...]:
        try:
            return parse(text.encode() if isinstance(text, str) else text, "arm.urdf").findings
        except UrdfError as refused:
            return refused.findings

    return find


@pytest.fixture(scope="session")
def shipped() -> Path:
    """Folder of example-robot-data's robots."""
    distribution = importlib.metadata.distribution("example-robot-data")
    files = distribution.files or []
    package = next(file for file in files if file.name == "package.xml" and "example-robot-data" in str(file))
    return Path(str(distribution.locate_file(package))).parent / "robots"
