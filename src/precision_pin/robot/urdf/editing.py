"""Editor of placements and inertias in a URDF's text; every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from precision_pin.robot.urdf.robot import Vector
from precision_pin.robot.urdf.xmltree import UTF8_MARK, utf8_text

START_TAG: Final = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
ATTRIBUTE: Final = re.compile(rb"""([^\s=<>"'/]+)\s*=\s*("[^"]*"|'[^']*')""")
DECLARATION: Final = re.compile(rb"<\?xml\s.*?\?>", re.DOTALL)
Edit = tuple[int, int, bytes]
"""Replacement of the bytes from the first position to before the second."""


@dataclass(frozen=True)
class Placement:
    """New position (m) and roll, pitch, yaw (rad) of a joint's ``<origin>``; ``None`` keeps a vector as written."""

    xyz: Vector | None
    rpy: Vector | None


@dataclass(frozen=True)
class AddedFrame:
    """A massless link, and the fixed joint that carries it at a pose (m, rad) in its parent's axes."""

    link: str
    joint: str
    parent: str
    xyz: Vector
    rpy: Vector


@dataclass(frozen=True)
class _JointText:
    first_child: int
    origin: int | None


@dataclass(frozen=True, eq=False)
class UrdfText:
    """The text of a URDF read without error, in UTF-8, and the byte positions of what can be edited.

    ``joints`` and ``inertias`` (of links) are by name, ``end`` is that of the root's end tag; ``meshes`` are distinct
    file names as written.
    """

    data: bytes
    joints: Mapping[str, _JointText]
    inertias: Mapping[str, int]
    end: int
    meshes: tuple[str, ...]

    @classmethod
    def scan(cls, data: bytes) -> UrdfText:
        """Return the text, which `parse` accepts except for inertias, with the positions of what can be edited."""
        text = utf8_text(data)
        scanner = _Scanner(text)
        return cls(text, scanner.joints, scanner.inertias, scanner.end, tuple(dict.fromkeys(scanner.meshes)))

    def edited(
        self,
        placements: Mapping[str, Placement],
        added: Sequence[AddedFrame] = (),
        comment: Iterable[str] = (),
        inertias: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    ) -> bytes:
        """Return the text with other placements of joints; one without ``<origin>`` gets one.

        ``inertias`` are the attributes of links' ``<inertia>``, by link name. ``added`` frames go to the end of the
        robot, the ``comment`` lines to the top, after the XML declaration; a blank separates two dashes in a row, which
        would end the comment.
        """
        edits: list[Edit] = []
        for name, placement in placements.items():
            edits += self._edit_placement(self.joints[name], placement)
        for name, parts in inertias.items():
            values = {part.encode(): _written([number]) for part, number in parts.items()}
            edits += self._edit_attributes(self.inertias[name], b"<inertia", values)
        newline = b"\r\n" if b"\r\n" in self.data else b"\n"
        if added:
            lines = [self._encode(line, "xmlcharrefreplace") for frame in added for line in _frame_lines(frame)]
            edits.append((self.end, self.end, b"".join(line + newline for line in lines)))
        if listed := [self._encode(_make_safe(line), "backslashreplace") for line in comment]:
            edits.append(self._comment(listed, newline))
        result = self.data
        for start, stop, text in sorted(edits, reverse=True):
            result = result[:start] + text + result[stop:]
        return result

    def _edit_placement(self, joint: _JointText, placement: Placement) -> list[Edit]:
        given = {b"xyz": placement.xyz, b"rpy": placement.rpy}
        values = {name: _written(vector) for name, vector in given.items() if vector is not None}
        if joint.origin is not None:
            return self._edit_attributes(joint.origin, b"<origin", values)
        if not values:
            return []
        # before the first child, on its own line if the child has one
        before = self.data[: joint.first_child]
        blanks = before[len(before.rstrip()) :]
        return [(joint.first_child, joint.first_child, b"<origin" + _attributes(values) + b"/>" + blanks)]

    def _edit_attributes(self, position: int, tag: bytes, values: dict[bytes, bytes]) -> list[Edit]:
        match = START_TAG.match(self.data, position)
        assert match is not None
        edits: list[Edit] = []
        tail = position + len(tag)
        for attribute in ATTRIBUTE.finditer(self.data, tail, match.end()):
            tail = attribute.end()
            value = values.pop(attribute[1], None)
            if value is not None:
                edits.append((attribute.start(2) + 1, attribute.end(2) - 1, value))
        if values:
            edits.append((tail, tail, _attributes(values)))
        return edits

    def _comment(self, lines: Sequence[bytes], newline: bytes) -> Edit:
        start = len(UTF8_MARK) if self.data.startswith(UTF8_MARK) else 0
        text = newline.join([b"<!--", *(b"  " + line for line in lines), b"-->"])
        declaration = DECLARATION.match(self.data, start)
        if declaration is None:
            return (start, start, text + newline)
        return (declaration.end(), declaration.end(), newline + text)

    def _encode(self, text: str, replacing: str) -> bytes:
        # stays ASCII, since a file of ASCII characters may declare another encoding than UTF-8
        return text.encode("ascii", replacing) if self.data.isascii() else text.encode()


def _written(numbers: Iterable[float]) -> bytes:
    return b" ".join(repr(float(number)).encode() for number in numbers)


def _attributes(values: Mapping[bytes, bytes]) -> bytes:
    return b"".join(b' %s="%s"' % item for item in values.items())


def _frame_lines(frame: AddedFrame) -> list[str]:
    xyz, rpy = (_written(vector).decode() for vector in (frame.xyz, frame.rpy))
    breaks = {"\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
    link, joint, parent = (quoteattr(name, breaks) for name in (frame.link, frame.joint, frame.parent))
    return [
        f"  <link name={link}/>",
        f'  <joint name={joint} type="fixed"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f"<parent link={parent}/><child link={link}/></joint>",
    ]


def _make_safe(line: str) -> str:
    """Return a line that ends neither a comment nor the line."""
    visible = "".join(character if character.isprintable() else " " for character in line)
    return re.sub("-(?=-)", "- ", visible)


class _Scanner:
    """Scanner of one text with expat, which records byte positions."""

    end: int

    def __init__(self, data: bytes) -> None:
        self.joints: dict[str, _JointText] = {}
        self.inertias: dict[str, int] = {}
        self.meshes: list[str] = []
        self._open: list[str] = []
        self._name = ""
        self._first_child: int | None = None
        self._origin: int | None = None
        self._parser = parser = expat.ParserCreate(encoding="utf-8")
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._stop
        parser.Parse(data, True)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        position = self._parser.CurrentByteIndex
        self._open.append(tag)
        kind = self._open[1] if len(self._open) > 1 else ""
        if kind in ("joint", "link") and len(self._open) == 2:
            self._name, self._first_child, self._origin = attributes["name"], None, None
        elif kind == "joint" and len(self._open) == 3:
            self._first_child = position if self._first_child is None else self._first_child
            self._origin = position if tag == "origin" else self._origin
        elif kind == "link" and self._open[2:] == ["inertial", "inertia"]:
            self.inertias[self._name] = position
        elif kind == "link" and tag == "mesh" and "filename" in attributes:
            self.meshes.append(attributes["filename"])

    def _stop(self, tag: str) -> None:
        self._open.pop()
        if tag == "joint" and len(self._open) == 1 and self._first_child is not None:
            self.joints[self._name] = _JointText(self._first_child, self._origin)
        elif not self._open:
            self.end = self._parser.CurrentByteIndex
