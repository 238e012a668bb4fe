"""Strict reader of numbers: plain ASCII decimals, of the right count, finite."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.xmltree import Node

ZERO3 = (0.0, 0.0, 0.0)
PLAIN = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
NOT_FINITE = re.compile(r"[+-]?(?:nan(?:\([0-9a-z_]*\))?|inf(?:inity)?|1\.#(?:inf|ind|qnan).*)", re.IGNORECASE)
BLANKS = re.compile(r"[ \t\r\n]+")


@dataclass(frozen=True)
class BadNumbers:
    """Reason that a text is not numbers, with its code (``E_NUMBER`` or ``E_NOT_FINITE``)."""

    code: str
    reason: str


def parse_numbers(text: str, count: int, *, infinite: bool = False) -> tuple[float, ...] | BadNumbers:
    """Return ``count`` numbers, or the reason that the text is something else.

    Parameters
    ----------
    text
        Decimals such as ``-1``, ``.5``, ``+2.5e-3`` with blanks, tabs or newlines between and around.
    count
        Number of numbers expected.
    infinite
        True to accept ``inf`` and ``-inf``. An overflow such as ``1e400`` is never accepted.
    """
    words = BLANKS.split(text.strip(" \t\r\n"))
    if words == [""]:
        return BadNumbers("E_NUMBER", f"is empty; {_describe_count(count)}")
    values = []
    for word in words:
        if PLAIN.fullmatch(word):
            value = float(word)
            if math.isinf(value):
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which overflows; {_describe_count(count)}")
        elif NOT_FINITE.fullmatch(word):
            if not infinite or "inf" not in word.lower() or "#" in word:
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which is not finite; {_describe_count(count)}")
            value = float(word)
        else:
            comma = " with a decimal point, and blanks (no commas) between them" if "," in word else ""
            return BadNumbers("E_NUMBER", f"holds {shown(word)}, not a plain number; {_describe_count(count)}{comma}")
        values.append(value)
    if len(values) != count:
        return BadNumbers("E_NUMBER", f"holds {len(values)} numbers; {_describe_count(count)}")
    return tuple(values)


def _describe_count(count: int) -> str:
    return "one finite decimal number is needed" if count == 1 else f"{count} finite decimal numbers are needed"


def read_numbers(
    node: Node, attribute: str, count: int, owner: str, findings: Findings, *, infinite: bool = False
) -> tuple[float, ...] | None:
    """Return an attribute's numbers, or add an error naming its owner and return None.

    A missing attribute is an error like an empty one; for an optional attribute check before that it is there.
    """
    text = node.get(attribute)
    if text is None:
        findings.error("E_NUMBER", f"{owner}: <{node.tag}> has no {attribute}; {_describe_count(count)}", node.line)
        return None
    result = parse_numbers(text, count, infinite=infinite)
    if isinstance(result, BadNumbers):
        message = f"{owner}: <{node.tag}> {attribute}={shown(text)} {result.reason}"
        findings.error(result.code, message, node.line)
        return None
    if node.has_breaks or is_misread(text, count):
        message = (
            "white space after a number, or other than blanks between numbers, is accepted here, but urdfdom "
            "(ROS, Gazebo, Pinocchio) drops the inertial or refuses the file; delete it"
        )
        findings.grouped_warning("W_NUMBER_BLANKS", message, f"{owner}: <{node.tag}> {attribute}", node.line)
    return result


def is_misread(text: str, count: int) -> bool:
    """Return whether urdfdom fails on valid numbers, since it splits them at blanks only."""
    pieces = [text] if count == 1 else text.split(" ")
    return any(piece[-1].isspace() or len(piece.split()) > 1 for piece in pieces if piece)


def read_vector(node: Node | None, attribute: str, owner: str, findings: Findings) -> tuple[float, float, float]:
    """Return three numbers, zeros if the element or attribute is missing or wrong."""
    if node is None or node.get(attribute) is None:
        return ZERO3
    values = read_numbers(node, attribute, 3, owner, findings)
    return ZERO3 if values is None else (values[0], values[1], values[2])
