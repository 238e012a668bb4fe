"""Parser of XML text into a tree with line numbers: no DTD, no entities, all sizes limited; the list of findings."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Final, Literal, final
from xml.parsers import expat

from precision_pin.base import files
from precision_pin.base.errors import Finding, nearest, one_line, shown, visible
from precision_pin.base.files import UnreadableFileError
from precision_pin.robot.urdf.robot import Limits

MOST_FINDINGS = 1000
MOST_NAMES = 6


_CODES: Final = {"missing": "E_FILE_MISSING", "kind": "E_FILE_KIND", "size": "E_TOO_BIG"}


def hint(name: str, valid: Collection[str]) -> str:
    """Return ``"; did you mean …?"``, or empty if the search would be slow or pointless."""
    if not valid or len(valid) > 500 or len(name) > 100 or any(len(candidate) > 100 for candidate in valid):
        return ""
    return "; " + nearest(name, valid)


@final
class Findings:
    """Collector of the findings about one file."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._findings: list[Finding] = []
        self._count: dict[str, int] = {"error": 0, "warning": 0}
        self._groups: dict[tuple[str, str], tuple[int | None, list[str]]] = {}

    @property
    def errors(self) -> int:
        """Number of errors so far."""
        return self._count["error"]

    def add(self, code: str, message: str, line: int | None = None, subjects: tuple[str, ...] = ()) -> None:
        """Add an error (a code ``E_…``) or a warning (``W_…``)."""
        severity = _severity(code)
        self._count[severity] += 1
        if self._count[severity] <= MOST_FINDINGS:
            self._findings.append(Finding(severity, code, one_line(message), self._file, line, subjects))

    def group(self, code: str, message: str, name: str, line: int | None) -> None:
        """Add ``name`` to the one warning of this code and message, at the line of the first name."""
        if len(self._groups) >= MOST_FINDINGS and (code, message) not in self._groups:
            self._count["warning"] += 1
            return
        names = self._groups.setdefault((code, message), (line, []))[1]
        if not names or names[-1] != name:
            names.append(name)

    def result(self) -> tuple[Finding, ...]:
        """Return all findings in the order of their lines."""
        for (code, message), (line, names) in self._groups.items():
            listed = ", ".join(map(visible, names[:MOST_NAMES]))
            more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            self.add(code, f"{message} ({listed}{more})", line, tuple(names))
        self._groups = {}
        ordered = sorted(self._findings, key=lambda finding: finding.line or 0)
        for code in ("E_MORE", "W_MORE"):
            severity = _severity(code)
            left_out = self._count[severity] - MOST_FINDINGS
            if left_out > 0:
                message = f"{left_out} more {severity}s are not listed"
                ordered.append(Finding(severity, code, message, self._file))
        return tuple(ordered)


def _severity(code: str) -> Literal["error", "warning"]:
    return "error" if code.startswith("E_") else "warning"


def read_regular_file(path: str | os.PathLike[str], findings: Findings, *, most_bytes: int) -> bytes | None:
    """Return the bytes of a regular file up to a size; ``~`` is not expanded.

    On failure adds ``E_FILE_MISSING``, ``E_FILE_KIND``, ``E_FILE_PERM`` or ``E_TOO_BIG`` and returns None.
    """
    try:
        return files.read_regular_file(path, most_bytes)
    except UnreadableFileError as error:
        name = os.fspath(path)
        code = _CODES.get(error.kind, "E_FILE_PERM")
        message = error.reason
        match error.kind:
            case "missing":
                note = " (~ is not expanded here: write the whole path)" if name.startswith("~") else ""
                message = f"there is no file {shown(name)}{note}"
            case "kind":
                message = f"this is {error.found}; a regular file is needed"
            case "permission":
                message = "no permission to read this file"
            case "size":
                message = f"the file is over {most_bytes} bytes; the limits can be raised"
            case _:
                code = "E_FILE_PERM" if os.path.isfile(path) else "E_FILE_MISSING"
        findings.add(code, message)
        return None


UTF8_MARK = codecs.BOM_UTF8
# encodings that may be declared, with Python's names; 16-bit encodings need a byte-order mark or a declaration
ENCODINGS = {
    "utf-8": "utf-8", "utf8": "utf-8", "us-ascii": "ascii", "ascii": "ascii", "iso-8859-1": "latin-1", "latin-1": "latin-1",
    "latin1": "latin-1", "iso-8859-15": "iso-8859-15", "windows-1252": "cp1252", "cp1252": "cp1252",
    "utf-16": "utf-16", "utf-16le": "utf-16-le", "utf-16be": "utf-16-be",
}  # fmt: skip
WIDE = {"utf-16-le": (codecs.BOM_UTF16_LE, b"<\0"), "utf-16-be": (codecs.BOM_UTF16_BE, b"\0<")}
READ = "UTF-8, UTF-16, ISO-8859-1, ISO-8859-15, windows-1252 and US-ASCII are read"
DECLARATION = re.compile(r"""<\?xml\s[^>]*?\sencoding\s*=\s*["']([A-Za-z][A-Za-z0-9._-]*)["']""")
PACKED = {
    b"\x1f\x8b": "a gzip file",
    b"PK\x03\x04": "a zip archive",
    b"BZh": "a bzip2 file",
    b"\xfd7zXZ\0": "an xz file",
}
LONGEST_DECLARATION = 400
# a start tag up to a tab or line end in one of its attributes
BREAK = re.compile(
    rb"""<[^"'>]*(?:(?:"[^"\t\r\n]*"|'[^'\t\r\n]*')[^"'>]*)*(?:"[^"\t\r\n]*[\t\r\n]|'[^'\t\r\n]*[\t\r\n])"""
)
# nothing is read below these children of <robot>, so nothing is stored
OPAQUE = {"gazebo", "transmission", "ros2_control", "sensor"}


@dataclass(slots=True)
class Node:
    """One XML element: tag, attributes, line (from 1) and child elements.

    ``has_breaks``: an inertial's origin has tabs or line ends, which XML turns into blanks, in its attributes.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Node] = field(default_factory=list)
    has_breaks: bool = False

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
    def __init__(self, code: str, message: str, line: int | None) -> None:
        super().__init__(message)
        self.code, self.message, self.line = code, message, line


def parse_xml(data: bytes, findings: Findings, limits: Limits) -> Node | None:
    """Return the root element of a file in an encoding of `utf8_text`, or add one finding and return None."""
    try:
        return _Builder(_plain_utf8(data, limits), limits).root
    except _Refused as problem:
        findings.add(problem.code, problem.message, problem.line)
    return None


def utf8_text(data: bytes) -> bytes:
    """Return a file that `parse_xml` accepts as UTF-8, with its declaration changed; UTF-8 and ASCII stay."""
    text = _decode(data)
    return data if data.removeprefix(UTF8_MARK) == text.encode() else _with_declared_utf8(text).encode()


def _plain_utf8(data: bytes, limits: Limits) -> bytes:
    if len(data) > limits.file_bytes:
        message = f"the file is over {limits.file_bytes} bytes; the limits can be raised"
        raise _Refused("E_TOO_BIG", message, None)
    packed = next((name for start, name in PACKED.items() if data.startswith(start)), None)
    if packed is not None:
        raise _Refused("E_XML_SYNTAX", f"this is {packed}, not a URDF; unpack it first", 1)
    text = _decode(data)
    if not text.strip():
        raise _Refused("E_XML_EMPTY", "the file is empty; a <robot> element is needed", 1)
    if text.startswith("\ufeff"):
        raise _Refused("E_XML_SYNTAX", "two byte-order marks at the beginning; one is allowed", 1)
    nul = text.find("\0")
    if nul >= 0:
        raise _Refused("E_XML_SYNTAX", "a NUL byte in the text; this is not XML", _line_of(text[:nul]))
    return _with_declared_utf8(text).encode()


def _decode(data: bytes) -> str:
    """Return the text without its byte-order mark, which must agree with the declared encoding."""
    if data.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE, b"<\0\0\0", b"\0\0\0<")):
        raise _Refused("E_XML_ENCODING", f"the text is UTF-32; {READ}", 1)
    wide = next((name for name, starts in WIDE.items() if data.startswith(starts)), None)
    marked = wide or ("utf-8" if data.startswith(UTF8_MARK) else None)
    start = data[:LONGEST_DECLARATION].decode(wide or "latin-1", "ignore")
    declared = _find_encoding(start.removeprefix("\ufeff").removeprefix(UTF8_MARK.decode("latin-1")))
    encoding = "utf-8" if declared is None else ENCODINGS.get(declared.lower())
    if encoding is None:
        raise _Refused("E_XML_ENCODING", f"the declared encoding {shown(declared or '')} is not read; {READ}", 1)
    if marked is not None and declared is not None and not marked.startswith(encoding):
        raise _Refused("E_XML_ENCODING", f"the text is {marked.upper()}, but declared as {shown(declared)}", 1)
    if wide is not None and declared is None and data.startswith(WIDE[wide][1]):
        raise _Refused("E_XML_ENCODING", f"the text is {wide.upper()}, but neither marked nor declared so", 1)
    if encoding.startswith("utf-16") and wide is None:
        raise _Refused("E_XML_ENCODING", f"the text is declared as {shown(declared or '')}, but it is not", 1)
    codec = marked or encoding
    try:
        return data.decode(codec).removeprefix("\ufeff")
    except UnicodeDecodeError as problem:
        line = _line_of(data[: problem.start].decode(codec, "replace"))
        what = (
            f"byte 0x{data[problem.start]:02x} is not {codec.upper()}; save the file as UTF-8 or declare its encoding"
        )
        raise _Refused("E_XML_ENCODING", what, line) from None


def _find_encoding(start: str) -> str | None:
    match = DECLARATION.match(start)
    return None if match is None else match[1]


def _with_declared_utf8(text: str) -> str:
    match = DECLARATION.match(text[:LONGEST_DECLARATION])
    return text if match is None else text[: match.start(1)] + "UTF-8" + text[match.end(1) :]


def _line_of(before: str) -> int:
    return 1 + before.replace("\r\n", "\n").replace("\r", "\n").count("\n")


class _Builder:
    root: Node

    def __init__(self, data: bytes, limits: Limits) -> None:
        self._limits = limits
        self._data = data
        self._depth = 0
        self._opaque_depth: int | None = None
        self._elements = 0
        self._open: list[Node] = []
        self._xacro: list[tuple[int, str]] = []
        self._declared: list[tuple[int, str]] = [(0, "xml"), (0, "xmlns")]
        self._wrong_name: tuple[int, str] | None = None
        parser = expat.ParserCreate(encoding="utf-8")
        self._parser = parser
        parser.XmlDeclHandler = self._declaration
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        try:
            parser.Parse(data, True)
        except expat.ExpatError as problem:
            text = f"{expat.ErrorString(problem.code)} (column {problem.offset + 1})"
            raise _Refused("E_XML_SYNTAX", f"not well-formed XML: {text}", problem.lineno) from None
        if self._xacro:
            line, what = self._xacro[0]
            more = f" (and {len(self._xacro) - 1} more)" if len(self._xacro) > 1 else ""
            message = f"unprocessed xacro: {what}{more}; precision-pin init FILE.xacro writes it as a URDF"
            raise _Refused("E_XACRO", message, line)
        if self._wrong_name is not None:
            line, message = self._wrong_name
            raise _Refused("E_XML_SYNTAX", f"not well-formed XML: {message}", line)

    def _declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        # a declaration found earlier has been changed to UTF-8
        if encoding is not None and encoding.lower() != "utf-8":
            raise _Refused("E_XML_ENCODING", f"the declared encoding {shown(encoding)} is not read; {READ}", 1)

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
        self._check_limits(tag, attributes, line)
        self._note_xacro(tag, attributes, line)
        self._check_prefixes(tag, attributes, line)
        if self._opaque_depth is not None:
            return
        node = Node(tag, attributes, line)
        if self._open:
            if tag == "origin" and self._open[-1].tag == "inertial":
                node.has_breaks = BREAK.match(self._data, self._parser.CurrentByteIndex) is not None
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
        while self._declared[-1][0] == self._depth:
            self._declared.pop()
        self._depth -= 1

    def _check_limits(self, tag: str, attributes: dict[str, str], line: int) -> None:
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

    def _check_prefixes(self, tag: str, attributes: dict[str, str], line: int) -> None:
        """Note the first name with a colon that XML with namespaces does not allow; expat reads without them."""
        self._declared += [(self._depth, name[6:]) for name in attributes if name.startswith("xmlns:")]
        for name in (tag, *attributes):
            if ":" not in name or self._wrong_name is not None:
                continue
            prefix, _, rest = name.partition(":")
            if not prefix or not rest or ":" in rest:
                self._wrong_name = line, f"{shown(name)} is no name; one colon may follow a prefix"
            elif all(prefix != known for _, known in self._declared):
                self._wrong_name = line, f"the prefix {shown(prefix)} of {shown(name)} is not declared"

    def _note_xacro(self, tag: str, attributes: dict[str, str], line: int) -> None:
        if tag.startswith("xacro:"):
            self._xacro.append((line, f"element <{tag[:40]}>"))
        for name, value in attributes.items():
            if "${" in value or "$(" in value:
                self._xacro.append((line, f"{name[:40]}={shown(value)}"))
