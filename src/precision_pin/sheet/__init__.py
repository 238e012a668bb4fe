"""The YAML sheet: which robot, which poses, which error sources with which laws.

Reading collects every finding with its line before it refuses.
"""

from precision_pin.sheet.reader import Overrides, Sheet, parse_pose, read
from precision_pin.sheet.remarks import pose_remark
from precision_pin.sheet.schema import json_schema
from precision_pin.sources import catalogue

__all__ = ["Overrides", "Sheet", "catalogue", "json_schema", "parse_pose", "pose_remark", "read"]
