"""The YAML sheet: robot, poses, and error sources with their laws.

The reader collects every finding with its line before it raises an error.
"""

from precision_pin.sheet.chain_entry import Overrides as Overrides
from precision_pin.sheet.chain_entry import parse_pose as parse_pose
from precision_pin.sheet.changes import Change as Change
from precision_pin.sheet.changes import parse_change as parse_change
from precision_pin.sheet.reader import Sheet as Sheet
from precision_pin.sheet.reader import read as read
from precision_pin.sheet.reader import read_data as read_data
from precision_pin.sheet.schema import json_schema as json_schema
from precision_pin.sheet.sheet_lint import pose_remark as pose_remark
from precision_pin.sources import catalogue as catalogue
