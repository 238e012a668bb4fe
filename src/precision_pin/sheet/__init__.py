"""The YAML sheet: robot, poses, and error sources with their laws.

The reader collects every finding with its line before it raises an error.
"""

from precision_pin.sheet.chain_entry import Overrides, parse_pose
from precision_pin.sheet.changes import Change, parse_change
from precision_pin.sheet.reader import Sheet, read, read_data
from precision_pin.sheet.schema import json_schema
from precision_pin.sheet.sheet_lint import pose_remark
from precision_pin.sources import catalogue

__all__ = [
    "Change",
    "Overrides",
    "Sheet",
    "catalogue",
    "json_schema",
    "parse_change",
    "parse_pose",
    "pose_remark",
    "read",
    "read_data",
]
