"""A folder with the paper's arm, and the same arm with a sliding finger behind the tool."""

from collections.abc import Callable
from pathlib import Path

import pytest

from precision_pin.base.errors import InputError
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import Sheet, read

ARM = (PAPER_SHEET.parent / "4dof.urdf").read_text(encoding="utf-8")
FINGER = """
  <link name="fingertip"/>
  <joint name="finger" type="prismatic">
    <parent link="tool"/>
    <child link="fingertip"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="10" velocity="1"/>
  </joint>
</robot>"""

Write = Callable[[str], Path]
Load = Callable[[str], Sheet]


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sheets")
    (path / "4dof.urdf").write_text(ARM, encoding="utf-8")
    (path / "finger.urdf").write_text(ARM.replace("</robot>", FINGER), encoding="utf-8")
    return path


@pytest.fixture
def write(folder):
    def write_sheet(text):
        path = folder / "sheet.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write_sheet


@pytest.fixture
def load(write):
    return lambda text: read(write(text))


@pytest.fixture
def refuse(write):
    """Return the findings of a sheet that must be refused, each of one line, in the sheet's own file."""

    def findings(text):
        path = write(text)
        with pytest.raises(InputError) as caught:
            read(path)
        found = list(caught.value.findings)
        for finding in found:
            assert "\n" not in str(finding)
            assert finding.severity == "error"
            assert finding.file == str(path), finding
            assert finding.line is not None
            assert 1 <= finding.line <= text.count("\n") + 1
        return found

    return findings
