"""XML text as a tree with line numbers (no DTD, no entities, all sizes limited), the findings, and the grammar of URDF.

The grammar is a table of elements and attributes, with the reader of numbers and names that follows it.
"""

from __future__ import annotations

import codecs
import math
import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal
from xml.parsers import expat

from precision_pin.base import files
from precision_pin.base.errors import Finding, nearest, one_line, shown, visible
from precision_pin.base.files import UnreadableFileError
from precision_pin.robot.urdf.robot import PARTS, Limits, Vector

MOST_FINDINGS = 1000
MOST_NAMES = 6


def hint(name: str, valid: Collection[str]) -> str:
    """Return ``"; did you mean …?"``, or empty if the search would be slow or pointless."""
    if not valid or len(valid) > 500 or len(name) > 100 or any(len(candidate) > 100 for candidate in valid):
        return ""
    return "; " + nearest(name, valid)


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
            if (left_out := self._count[severity] - MOST_FINDINGS) > 0:
                ordered.append(Finding(severity, code, f"{left_out} more {severity}s are not listed", self._file))
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
        note = " (~ is not expanded here: write the whole path)" if name.startswith("~") else ""
        known = {
            "missing": ("E_FILE_MISSING", f"there is no file {shown(name)}{note}"),
            "kind": ("E_FILE_KIND", f"this is {error.found}; a regular file is needed"),
            "permission": ("E_FILE_PERM", "no permission to read this file"),
            "size": ("E_TOO_BIG", f"the file is over {most_bytes} bytes; the limits can be raised"),
        }
        other = "E_FILE_PERM" if error.kind not in known and os.path.isfile(path) else "E_FILE_MISSING"
        findings.add(*known.get(error.kind, (other, error.reason)))
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
        raise _Refused("E_TOO_BIG", f"the file is over {limits.file_bytes} bytes; the limits can be raised", None)
    packed = next((name for start, name in PACKED.items() if data.startswith(start)), None)
    if packed is not None:
        raise _Refused("E_XML_SYNTAX", f"this is {packed}, not a URDF; unpack it first", 1)
    text = _decode(data)
    if not text.strip():
        raise _Refused("E_XML_EMPTY", "the file is empty; a <robot> element is needed", 1)
    if text.startswith("\ufeff"):
        raise _Refused("E_XML_SYNTAX", "two byte-order marks at the beginning; one is allowed", 1)
    if (nul := text.find("\0")) >= 0:
        raise _Refused("E_XML_SYNTAX", "a NUL byte in the text; this is not XML", _line_of(text[:nul]))
    return _with_declared_utf8(text).encode()


def _decode(data: bytes) -> str:
    """Return the text without its byte-order mark, which must agree with the declared encoding."""
    if data.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE, b"<\0\0\0", b"\0\0\0<")):
        raise _Refused("E_XML_ENCODING", f"the text is UTF-32; {READ}", 1)
    wide = next((name for name, starts in WIDE.items() if data.startswith(starts)), None)
    marked = wide or ("utf-8" if data.startswith(UTF8_MARK) else None)
    start = data[:LONGEST_DECLARATION].decode(wide or "latin-1", "ignore")
    match = DECLARATION.match(start.removeprefix("\ufeff").removeprefix(UTF8_MARK.decode("latin-1")))
    declared = None if match is None else match[1]
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
        what = f"byte 0x{data[problem.start]:02x} is not {codec.upper()}"
        raise _Refused("E_XML_ENCODING", f"{what}; save the file as UTF-8 or declare its encoding", line) from None


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
        self._parser = parser = expat.ParserCreate(encoding="utf-8")
        parser.XmlDeclHandler, parser.StartDoctypeDeclHandler = self._declaration, self._doctype
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        try:
            parser.Parse(data, True)
        except expat.ExpatError as problem:
            text = f"{expat.ErrorString(problem.code)} (column {problem.offset + 1})"
            raise _Refused("E_XML_SYNTAX", f"not well-formed XML: {text}", problem.lineno) from None
        if self._xacro:
            line, what = self._xacro[0]
            more = f" (and {len(self._xacro) - 1} more)" if len(self._xacro) > 1 else ""
            message = (
                f"unprocessed xacro: {what}{more}; precision-pin init FILE.xacro, with this suffix, writes it as a URDF"
            )
            raise _Refused("E_XACRO", message, line)
        if self._wrong_name is not None:
            line, message = self._wrong_name
            raise _Refused("E_XML_SYNTAX", f"not well-formed XML: {message}", line)

    def _declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        # a declaration found earlier has been changed to UTF-8
        if encoding is not None and encoding.lower() != "utf-8":
            raise _Refused("E_XML_ENCODING", f"the declared encoding {shown(encoding)} is not read; {READ}", 1)

    def _doctype(self, name: str, system: str | None, public: str | None, internal: int) -> None:
        is_page = name.lower() == "html"
        message = "a DOCTYPE is not allowed in a URDF; delete it (entities are never expanded)"
        message = "this is an HTML page (a failed download?), not a URDF" if is_page else message
        raise _Refused("E_XML_SYNTAX" if is_page else "E_XML_DTD", message, self._parser.CurrentLineNumber)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._parser.CurrentLineNumber
        self._depth += 1
        self._elements += 1 + len(attributes)
        self._check_limits(tag, attributes, line)
        # a property that nothing refers to is left out like any unknown element
        if tag.startswith("xacro:") and tag != "xacro:property":
            self._xacro.append((line, f"element <{tag[:40]}>"))
        values = [(name, value) for name, value in attributes.items() if "${" in value or "$(" in value]
        self._xacro += [(line, f"{name[:40]}={shown(value)}") for name, value in values]
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
            raise _Refused("E_XML_DEPTH", f"elements are nested more than {limits.xml_depth} deep", line)
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


ZERO3: Final = (0.0, 0.0, 0.0)
LONGEST_REACH: Final = 20.0
BEYOND_USE: Final = 1e6
# a full turn written with four digits is still a full turn
WIDEST_ANGLE: Final = 2 * math.pi * (1 + 1e-4)
PLAIN: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
NOT_FINITE: Final = re.compile(r"[+-]?(?:nan(?:\([0-9a-z_]*\))?|inf(?:inity)?|1\.#(?:inf|ind|qnan).*)", re.IGNORECASE)
BLANKS: Final = re.compile(r"[ \t\r\n]+")


@dataclass(frozen=True)
class Form:
    """Form of an attribute: how many numbers, 0 for text; whether it is required, and may be infinite."""

    count: int = 1
    required: bool = False
    infinite: bool = False


@dataclass(frozen=True)
class Element:
    """Possible contents of an element.

    ``is_closed`` elements are those whose numbers or names are used; unknown attributes of others change nothing.
    ``missing`` is the finding for a missing required element, after its owner's name.
    """

    attributes: Mapping[str, Form]
    once: frozenset[str] = frozenset()
    often: frozenset[str] = frozenset()
    is_closed: bool = True
    missing: tuple[str, str] = ("", "")


TEXT: Final = Form(0)
ONE: Final = Form(1)
VECTOR: Final = Form(3)
BOUNDS: Final = ("lower", "upper", "effort", "velocity")
ONCE_IN_JOINT: Final = (
    "origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "calibration", "safety_controller",
)  # fmt: skip
OFTEN_IN_ROBOT: Final = ("link", "joint", "material", *OPAQUE)
GRAMMAR: Final[Mapping[str, Element]] = {
    "robot": Element({"name": TEXT, "version": TEXT}, often=frozenset(OFTEN_IN_ROBOT)),
    "link": Element({"name": TEXT, "type": TEXT}, frozenset({"inertial"}), frozenset({"visual", "collision"})),
    "joint": Element({"name": TEXT, "type": TEXT}, frozenset(ONCE_IN_JOINT)),
    "inertial": Element({}, frozenset({"origin", "mass", "inertia"}), is_closed=False),
    "origin": Element({"xyz": VECTOR, "rpy": VECTOR, "quat_xyzw": TEXT}),
    "mass": Element({"value": Form(required=True)}, missing=("E_INERTIAL", ': <inertial> has no <mass value="…"/>')),
    "inertia": Element(
        dict.fromkeys(PARTS, Form(required=True)),
        missing=("E_INERTIAL", f": <inertial> has no <inertia>; {', '.join(PARTS)} are needed"),
    ),
    "parent": Element({"link": TEXT}, missing=("E_NO_PARENT", ' has no parent link; <parent link="…"/> is needed')),
    "child": Element({"link": TEXT}, missing=("E_NO_CHILD", ' has no child link; <child link="…"/> is needed')),
    "axis": Element({"xyz": VECTOR}, missing=("W_AXIS_DEFAULT", " has no axis; the default 1 0 0 is used")),
    "limit": Element(
        dict.fromkeys(BOUNDS, Form(infinite=True)),
        missing=("E_LIMITS", " and has no limit; lower, upper, effort and velocity are needed"),
    ),
    "mimic": Element({"joint": TEXT, "multiplier": ONE, "offset": ONE}),
    "dynamics": Element({"damping": ONE, "friction": ONE}, is_closed=False),
    "box": Element({"size": VECTOR}, is_closed=False),
    "cylinder": Element({"radius": ONE, "length": ONE}, is_closed=False),
    "sphere": Element({"radius": ONE}, is_closed=False),
}


@dataclass(frozen=True)
class Owner:
    """The robot, link or joint whose elements are read; its name starts each finding."""

    name: str
    findings: Findings

    def say(self, code: str, text: str, line: int) -> None:
        """Add a finding; the text continues the name."""
        self.findings.add(code, self.name + text, line)

    def child(self, node: Node, tag: str) -> Node | None:
        """Return the first child with a tag, or add the table's finding."""
        element = node.first(tag)
        if element is None:
            self.say(*GRAMMAR[tag].missing, node.line)
        return element

    def numbers(self, element: Node) -> dict[str, tuple[float, ...] | None]:
        """Return the numbers of an element by attribute, as `read` does."""
        return {name: self.read(element, name) for name, form in GRAMMAR[element.tag].attributes.items() if form.count}

    def read(self, node: Node, attribute: str) -> tuple[float, ...] | None:
        """Return the numbers of one attribute; None if wrong, or absent and not required."""
        form, text = GRAMMAR[node.tag].attributes[attribute], node.get(attribute)
        if text is None:
            if form.required:
                self.say("E_NUMBER", f": <{node.tag}> has no {attribute}; {_describe_count(form.count)}", node.line)
            return None
        result = parse_numbers(text, form.count, infinite=form.infinite)
        if isinstance(result, BadNumbers):
            self.say(result.code, f": <{node.tag}> {attribute}={shown(text)} {result.reason}", node.line)
            return None
        if node.has_breaks or is_misread(text, form.count):
            message = (
                "white space after a number, or other than blanks between numbers, is accepted here, but urdfdom "
                "(ROS, Gazebo, Pinocchio) drops the inertial or refuses the file; delete it"
            )
            self.findings.group("W_NUMBER_BLANKS", message, f"{self.name}: <{node.tag}> {attribute}", node.line)
        return result

    def placement(self, node: Node) -> tuple[Vector, Vector]:
        """Return position and angles of an element's origin, zeros if missing or wrong."""
        origin = node.first("origin")
        xyz, rpy = (None, None) if origin is None else map(as_vector, self.numbers(origin).values())
        return xyz or ZERO3, rpy or ZERO3

    def check_children(self, node: Node) -> None:
        """Refuse duplicates of single elements (``E_DUP_ELEMENT``); warn of unknown ones."""
        once, often = GRAMMAR[node.tag].once, GRAMMAR[node.tag].often
        seen: set[str] = set()
        for child in node.children:
            if child.tag in once:
                if child.tag in seen:
                    self.say(
                        "E_DUP_ELEMENT", f": <{child.tag}> occurs more than once in <{node.tag}>; keep one", child.line
                    )
                seen.add(child.tag)
                self.check_attributes(child)
            elif child.tag not in often:
                valid = ", ".join(sorted(once | often))
                message = f"unknown element <{child.tag[:40]}> in <{node.tag}> is ignored; valid: {valid}"
                self.findings.group("W_UNKNOWN_ELEMENT", message, self.name, child.line)

    def check_attributes(self, node: Node) -> None:
        """Warn of unknown attributes; refuse quaternions, which would otherwise be lost."""
        element = GRAMMAR.get(node.tag)
        if element is None or not element.is_closed:
            return
        for name in node.attributes:
            if name == "quat_xyzw":
                self.say("E_VERSION", ": quat_xyzw (URDF 1.1) is not read; write the rotation as rpy", node.line)
            elif name not in element.attributes and ":" not in name:
                valid = ", ".join(sorted(element.attributes))
                message = f"unknown attribute {shown(name)} of <{node.tag}> is ignored; valid: {valid}"
                self.findings.group("W_UNKNOWN_ATTRIBUTE", message, self.name, node.line)

    def check_placement(self, node: Node, xyz: Vector, rpy: Vector, position: str, angles: str) -> None:
        """Check position and angles of an element's origin, with their names for messages."""
        origin = node.first("origin")
        if origin is not None:
            self._check_units(xyz, position, origin.line, angles=False)
            self._check_units(rpy, angles, origin.line, angles=True)

    def _check_units(self, vector: Vector, what: str, line: int, *, angles: bool) -> None:
        """Refuse numbers beyond 1e6 (``E_UNITS``), warn of lengths over 20 m and angles over a turn (``W_UNITS``)."""
        largest = max(vector, key=abs)
        if angles:
            is_wide, unit, doubt = abs(largest) > WIDEST_ANGLE, "rad", ", over a full turn; are these degrees?"
        else:
            is_wide, unit, doubt = math.hypot(*vector) > LONGEST_REACH, "m", "; are these millimetres?"
        expected = "angles are in radians" if angles else "lengths are in metres"
        if abs(largest) > BEYOND_USE:
            self.say("E_UNITS", f"{what} contains {largest:g} {unit}, which is implausibly large; {expected}", line)
        elif is_wide:
            self.say("W_UNITS", f"{what} holds {largest:g} {unit}{doubt} {expected}", line)


def read_name(node: Node, findings: Findings) -> str | None:
    """Return the name of a robot, link or joint, or add an error and return None."""
    name = node.get("name")
    if name is not None and name.strip():
        return name
    none, empty = f"this <{node.tag}> has no name", f"the name of this <{node.tag}> is empty"
    findings.add(*(("E_NO_NAME", none) if name is None else ("E_EMPTY_NAME", empty)), node.line)
    return None


@dataclass(frozen=True)
class BadNumbers:
    """Reason why a text is not numbers, with its code (``E_NUMBER`` or ``E_NOT_FINITE``)."""

    code: str
    reason: str


def parse_numbers(text: str, count: int, *, infinite: bool = False) -> tuple[float, ...] | BadNumbers:
    """Return ``count`` plain ASCII decimals, blanks between and around, or why the text is something else.

    ``infinite`` accepts ``inf`` and ``-inf``; an overflow such as ``1e400`` is never accepted.
    """
    words = BLANKS.split(text.strip(" \t\r\n"))
    needed = _describe_count(count)
    if words == [""]:
        return BadNumbers("E_NUMBER", f"is empty; {needed}")
    values = []
    for word in words:
        if PLAIN.fullmatch(word):
            value = float(word)
            if math.isinf(value):
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which overflows; {needed}")
        elif NOT_FINITE.fullmatch(word):
            if not infinite or "inf" not in word.lower() or "#" in word:
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which is not finite; {needed}")
            value = float(word)
        else:
            comma = " with a decimal point, and blanks (no commas) between them" if "," in word else ""
            return BadNumbers("E_NUMBER", f"holds {shown(word)}, not a plain number; {needed}{comma}")
        values.append(value)
    if len(values) != count:
        return BadNumbers("E_NUMBER", f"holds {len(values)} numbers; {needed}")
    return tuple(values)


def _describe_count(count: int) -> str:
    return "one finite decimal number is needed" if count == 1 else f"{count} finite decimal numbers are needed"


def is_misread(text: str, count: int) -> bool:
    """Return whether urdfdom, which splits only at blanks, fails on valid numbers."""
    pieces = [text] if count == 1 else text.split(" ")
    return any(piece[-1].isspace() or len(piece.split()) > 1 for piece in pieces if piece)


def as_vector(numbers: tuple[float, ...] | None) -> Vector | None:
    """Return three numbers as a vector."""
    return None if numbers is None else (numbers[0], numbers[1], numbers[2])
