"""XML text to a tree with line numbers: no DTD, no entities, bounded in every direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from .data import Limits
from .findings import Findings, shown

__all__ = ["Node", "parse_xml"]

UTF8_MARK = b"\xef\xbb\xbf"
WIDE_MARKS = (b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff", b"<\x00", b"\x00<")
UTF8_NAMES = {"utf-8", "utf8", "us-ascii", "ascii"}
EIGHT_BIT_NAMES = {"iso-8859-1", "latin-1", "latin1", "iso-8859-15", "windows-1252", "cp1252"}
# below these children of <robot> nothing is read, so nothing is kept
OPAQUE = {"gazebo", "transmission", "ros2_control", "sensor"}


@dataclass(slots=True)
class Node:
    """One XML element: its tag, attributes, line (from 1) and child elements."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Node] = field(default_factory=list)

    def get(self, attribute: str) -> str | None:
        """Return an attribute's text, or None."""
        return self.attributes.get(attribute)

    def named(self, tag: str) -> Iterator[Node]:
        """Yield the children with this tag, in order."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Node | None:
        """Return the first child with this tag, or None."""
        return next(self.named(tag), None)


class _Refused(Exception):
    """Ends the parser from inside a handler."""

    def __init__(self, code: str, message: str, line: int | None) -> None:
        super().__init__(message)
        self.code, self.message, self.line = code, message, line


def parse_xml(data: bytes, findings: Findings, limits: Limits) -> Node | None:
    """Return the root element, or add one finding and return None.

    Parameters
    ----------
    data
        The whole file. UTF-8, with or without a byte order mark; any line ends.
    findings
        Receives ``E_XML_EMPTY``, ``E_XML_SYNTAX``, ``E_XML_ENCODING``, ``E_XML_DTD``, ``E_XML_DEPTH``,
        ``E_TOO_BIG`` or ``E_XACRO``.
    limits
        The size limits.
    """
    try:
        return _Builder(_plain_utf8(data, limits), limits).root
    except _Refused as problem:
        findings.error(problem.code, problem.message, problem.line)
    return None


def _plain_utf8(data: bytes, limits: Limits) -> bytes:
    if len(data) > limits.file_bytes:
        message = f"the file is over {limits.file_bytes} bytes; the limits can be raised"
        raise _Refused("E_TOO_BIG", message, None)
    if data.startswith(WIDE_MARKS):
        raise _Refused("E_XML_ENCODING", "the text is UTF-16 or UTF-32; save it as UTF-8", 1)
    data = data.removeprefix(UTF8_MARK)
    if not data.strip():
        raise _Refused("E_XML_EMPTY", "the file is empty; a <robot> element is needed", 1)
    nul = data.find(b"\0")
    if nul >= 0:
        raise _Refused("E_XML_SYNTAX", "a NUL byte in the text; this is not XML", _line_of(data, nul))
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as problem:
        byte = data[problem.start]
        message = f"byte 0x{byte:02x} is not UTF-8; save the file as UTF-8"
        raise _Refused("E_XML_ENCODING", message, _line_of(data, problem.start)) from None
    return data


def _line_of(data: bytes, position: int) -> int:
    before = data[:position].replace(b"\r\n", b"\n")
    return 1 + before.count(b"\n") + before.count(b"\r")


class _Builder:
    """Runs expat over one text; ``root`` is the result."""

    root: Node

    def __init__(self, data: bytes, limits: Limits) -> None:
        self._limits = limits
        self._ascii = data.isascii()
        self._depth = 0
        self._opaque_depth: int | None = None
        self._elements = 0
        self._open: list[Node] = []
        self._xacro: list[tuple[int, str]] = []
        parser = expat.ParserCreate(encoding="utf-8")
        self._parser = parser
        parser.XmlDeclHandler = self._declaration
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        try:
            parser.Parse(data, True)
        except expat.ExpatError as problem:
            text = expat.ErrorString(problem.code)
            message = f"not well-formed XML: {text} (column {problem.offset + 1})"
            raise _Refused("E_XML_SYNTAX", message, problem.lineno) from None
        if self._xacro:
            line, what = self._xacro[0]
            more = f" (and {len(self._xacro) - 1} more)" if len(self._xacro) > 1 else ""
            message = f"unprocessed xacro: {what}{more}; run `xacro FILE > robot.urdf` and give that file"
            raise _Refused("E_XACRO", message, line)

    def _declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        declared = (encoding or "utf-8").lower()
        if declared in UTF8_NAMES or (declared in EIGHT_BIT_NAMES and self._ascii):
            return
        message = f"the declared encoding {shown(declared)} is not read; save the file as UTF-8"
        raise _Refused("E_XML_ENCODING", message, 1)

    def _doctype(self, name: str, system: str | None, public: str | None, internal: int) -> None:
        line = self._parser.CurrentLineNumber
        if name.lower() == "html":
            raise _Refused("E_XML_SYNTAX", "this is an HTML page (a failed download?), not a URDF", line)
        message = "a DOCTYPE is not allowed in a URDF; delete it (entities are never expanded)"
        raise _Refused("E_XML_DTD", message, line)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._parser.CurrentLineNumber
        self._depth += 1
        self._elements += 1 + len(attributes)
        self._within_limits(tag, attributes, line)
        self._note_xacro(tag, attributes, line)
        if self._opaque_depth is not None:
            return
        node = Node(tag, attributes, line)
        if self._open:
            self._open[-1].children.append(node)
        else:
            self.root = node
        self._open.append(node)
        if self._depth == 2 and tag in OPAQUE:
            self._opaque_depth = self._depth

    def _end(self, tag: str) -> None:
        if self._opaque_depth is None or self._depth == self._opaque_depth:
            self._open.pop()
            self._opaque_depth = None
        self._depth -= 1

    def _within_limits(self, tag: str, attributes: dict[str, str], line: int) -> None:
        limits = self._limits
        if self._depth > limits.xml_depth:
            message = f"elements are nested more than {limits.xml_depth} deep"
            raise _Refused("E_XML_DEPTH", message, line)
        if self._elements > limits.elements:
            message = f"more than {limits.elements} elements and attributes; the limits can be raised"
            raise _Refused("E_TOO_BIG", message, line)
        if max(map(len, (tag, *attributes, *attributes.values()))) > limits.text_length:
            message = f"a name or attribute of <{tag[:40]}> is over {limits.text_length} characters"
            raise _Refused("E_TOO_BIG", message, line)

    def _note_xacro(self, tag: str, attributes: dict[str, str], line: int) -> None:
        if tag.startswith("xacro:"):
            self._xacro.append((line, f"element <{tag[:40]}>"))
        for name, value in attributes.items():
            if "${" in value or "$(" in value:
                self._xacro.append((line, f"{name[:40]}={shown(value)}"))
