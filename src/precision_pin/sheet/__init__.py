"""The YAML sheet: which robot, which poses, which error sources with which laws.

Reading collects every finding with its line before it refuses.
"""

from precision_pin.sheet.reader import Sheet, read
from precision_pin.sheet.schema import json_schema

__all__ = ["Sheet", "json_schema", "read"]
