"""Changes of a robot's text: its elements, attributes, names, numbers, and last its bytes."""

from __future__ import annotations

import codecs
import copy
import random
from collections.abc import Callable
from xml.etree import ElementTree as Tree

from .bases import base_robots

__all__ = ["mutant"]

Element = Tree.Element

NUMBERS = (
    "0", "-0", "1", "-1", "1e-9", "1e-7", "9.9e-7", "1e-5", "1e-320", "1e308", "1e309", "-1e309", "1e6", "1.1e6", "25",
    "1000", "180", "nan", "NaN", "-nan", "inf", "-inf", "INF", "infinity", "nan(1)", "1.#QNAN", "", " ", "1,5", "1.5.2",
    "1e", "e5", "+1", "++1", "0x1F", "0b1", "1_000", "1d3", "١", "−1", "½", "1 2", "3.14159265358979323846264338327950288",
    ".5", "5.", ".", "-.5", "00012", "1m", "90deg", "${pi/2}", "%s", "%n%n", "true", "1.57", "3.1416", "-1.5708", "0.785",
)  # fmt: skip
VECTORS = (
    "0 0 0", "0 0 1", "1 0 0", "0 0 -1", "1 1 1", "0 0 1e-7", "0 0 1e-5", "1e200 1e200 0", "1e-200 0 0", "1e5 0 0", "1 0",
    "1 0 0 0", "1,0,0", "0;0;1", "[0 0 1]", "0 0 1.0000001", "0 0 1.00001", "nan 0 0", "0 inf 0", "1e-320 0 0", "",
    "0 0 0.9999995", "0.57735 0.57735 0.57735", "400 0 0", "1e7 0 0", "1.57 0 0", "0 3.1416 0", "0 0 90", "1e308 1e308 1e308",
    "7 0 0", "0 1.5707963267948966 0", "-0 -0 -0", "1 2 x", "x y z",
)  # fmt: skip
NAMES = (
    "universe", "root_joint", "world", "base", "tool", "joint1", "link1", "", " ", "a b", " base", "base ", "Base", "ＢＡＳＥ",
    "bаse", "base\u200b", "\u202egnp.exe", "=SUM(A1)", "<b>", "a&b", 'a"b', "a'b", "%s%n", "../x", "/", "a/b", "C:\\x",
    "\t", "a\nb", "a\rb", "x" * 300, "n" * 5000, "é", "e\u0301", "\ufeff", "0", "-", "--", "None", "nan", "joint1_reversed",
    "joint1_origin", "link0", "joint0", "l0", "j0",
)  # fmt: skip
SPACES = (" ", "  ", "\t", "\n", "\r\n", "\u00a0", "\u2003", "\v", "\x1f")
TYPES = (
    "revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical", "Revolute", "", " revolute", "revolute ",
    "unknown", "mimic",
)  # fmt: skip
TAGS = (
    "link", "joint", "origin", "axis", "limit", "parent", "child", "inertial", "mass", "inertia", "mimic", "visual", "robot",
    "collision", "geometry", "material", "color", "dynamics", "x", "gazebo", "transmission", "sensor", "Link", "ros:joint",
)  # fmt: skip
SNIPPETS = (
    "<axis/>", '<axis xyz="0 0 0"/>', '<axis xyz="0 2 0"/>', '<axis xyz="0 0 1 "/>', "<limit/>", '<limit effort="1"/>',
    '<limit lower="1" upper="-1" effort="1" velocity="1"/>', '<limit lower="1" upper="2" effort="1" velocity="1"/>',
    '<limit effort="5" velocity="2"/>', "<mimic/>", '<mimic joint="joint1"/>', '<mimic joint="flange"/>',
    '<mimic joint="nope"/>', '<mimic joint="finger" multiplier="2" offset="0.1"/>', '<mimic joint="a1" multiplier=" 2 "/>',
    "<dynamics/>", '<dynamics damping="-1"/>', '<dynamics damping="x"/>', '<dynamics friction="1 "/>', "<calibration/>",
    '<calibration rising="x"/>', '<calibration falling=" 1 "/>', "<safety_controller/>",
    '<safety_controller k_velocity="1"/>', '<safety_controller k_velocity="x" k_position="1"/>', "<inertial/>",
    '<inertial><mass value="1"/></inertial>', '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" '
    'iyz="0" izz="0"/></inertial>', '<inertial><mass value="1 "/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" '
    'izz="1"/></inertial>', "<visual/>", "<collision/>", "<visual><geometry/></visual>",
    '<visual><geometry><sphere radius="1"/></geometry><material/></visual>',
    '<visual><geometry><sphere radius="1"/></geometry><material name="none"/></visual>',
    '<visual><geometry><sphere radius="1"/></geometry><material name="none"><color rgba="1 0 0 2"/></material></visual>',
    '<visual><geometry><mesh filename="/dev/zero"/></geometry></visual>',
    '<visual><geometry><mesh filename="package://x/../../etc/passwd" scale="0 1 nan"/></geometry></visual>',
    '<visual><origin rpy="x"/><geometry><box size="1 1"/></geometry></visual>', '<material name="grey"/>', "<material/>",
    '<material name="grey"><color rgba="1 1 1 1"/></material>', '<material name="m"><color/></material>',
    '<link name="loose"/>', "<link/>", '<link name="base"/>', '<joint name="joint1" type="fixed"/>', "<joint/>",
    '<origin xyz="1 2 3"/>', '<origin rpy="0 0 0.1"/>', '<origin quat_xyzw="0 0 0 1"/>', "<parent/>", '<parent link="base"/>',
    '<child link="tool"/>', "<robot/>", "<!--x-->", "text", "<![CDATA[x]]>", "<?php x?>", "<x><y><z/></y></x>",
)  # fmt: skip
ENCODINGS = (
    "utf-8", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "iso-8859-1", "iso-8859-15", "windows-1252", "us-ascii", "utf-7",
    "shift_jis", "koi8-r", "cp037", "gb18030", "big5", "punycode", "idna", "rot13", "hex", "unicode_escape", "x-unknown",
)  # fmt: skip
PIECES = (
    b"\0", b"\xff", b"\x80", b"&", b"<", b">", b'"', b"'", b"&#0;", b"&#65;", b"&#x110000;", b"&lt;", b"&nope;", b"]]>",
    b"<!--", b"-->", b"<![CDATA[", b"<!DOCTYPE x>", b'<!DOCTYPE r [<!ENTITY a "b">]>', b"<?xml version='1.0'?>", b"<link/>",
    b"<joint/>", b"\xef\xbb\xbf", b"\xff\xfe", b"\xe2\x80\xae", b" ", b"\n", b"\r", b"0", b"9", b"-", b".", b"e", b"xmlns='u'",
    b"${x}", b"$(find x)", b"nan", b"%n",
)  # fmt: skip


def mutant(seed: int, number: int) -> bytes:
    """Return one changed robot: a file's bytes, the same for the same seed and number."""
    chance = random.Random(f"{seed}/{number}")
    bases = base_robots()
    text = bases[min(int(chance.expovariate(0.18)), len(bases) - 1)]
    data = text.encode()
    changes = chance.choice((0, 1, 1, 1, 1, 1, 1, 2, 2, 3, 5, 12))
    if changes:
        root = Tree.fromstring(data)
        for _ in range(changes):
            chance.choice(CHANGES)(root, chance)
        data = b'<?xml version="1.0" encoding="UTF-8"?>\n' + Tree.tostring(root)
    if changes == 0 or chance.random() < 0.1:
        for _ in range(chance.choice((1, 1, 1, 2, 4))):
            data = chance.choice(BYTE_CHANGES)(data, chance)
    return data


# --- of elements ---


def _any(root: Element, chance: random.Random, tag: str = "") -> Element:
    elements = [element for element in root.iter() if not tag or element.tag == tag]
    return chance.choice(elements) if elements else root


def _attribute(root: Element, chance: random.Random, tags: tuple[str, ...] = ()) -> tuple[Element, str] | None:
    slots = [(e, name) for e in root.iter() if not tags or e.tag in tags for name in e.attrib]
    return chance.choice(slots) if slots else None


def _parents(root: Element) -> dict[Element, Element]:
    return {child: element for element in root.iter() for child in element}


def _drop_attribute(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance)
    if slot:
        del slot[0].attrib[slot[1]]


def _rename_attribute(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance)
    if slot:
        element, name = slot
        element.set(
            chance.choice((name.upper(), name + "s", "x:" + name[1:] + "_", name[::-1], "value", "xyz", "name")),
            element.attrib.pop(name),
        )


def _set_value(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance)
    if slot:
        element, name = slot
        if name in ("xyz", "rpy", "size", "scale"):
            element.set(name, chance.choice(VECTORS))
        elif name in ("name", "link", "joint", "reference"):
            element.set(name, chance.choice(NAMES))
        elif name == "type":
            element.set(name, chance.choice(TYPES))
        else:
            element.set(name, chance.choice(NUMBERS))


def _set_number(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance, ("mass", "inertia", "limit", "mimic", "dynamics", "axis", "origin"))
    if slot:
        element, name = slot
        if name in ("xyz", "rpy"):
            words = element.attrib[name].split()
            if words:
                words[chance.randrange(len(words))] = chance.choice(NUMBERS)
            element.set(name, " ".join(words))
        elif name != "joint":
            element.set(name, chance.choice(NUMBERS))


def _set_vector(root: Element, chance: random.Random) -> None:
    element = _any(root, chance, chance.choice(("axis", "origin")))
    element.set(chance.choice(("xyz", "rpy")) if element.tag == "origin" else "xyz", chance.choice(VECTORS))


def _scale_number(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance, ("mass", "inertia", "limit", "axis", "origin", "box", "cylinder", "sphere"))
    if slot:
        element, name = slot
        factor = chance.choice((-1, 1e3, 1e-3, 57.29577951308232, 1e-7, 1e-9, 1e9, 2, 0.999999, 1.0000004))
        try:
            element.set(name, " ".join(repr(float(word) * factor) for word in element.attrib[name].split()))
        except ValueError:
            element.set(name, "0")


def _pad(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance)
    if slot:
        element, name = slot
        space, value = chance.choice(SPACES[:6] if chance.random() < 0.9 else SPACES[:7]), element.attrib[name]
        if chance.random() < 0.3:
            value = value.replace(" ", space)
        element.set(name, chance.choice((space + value, value + space, space + value + space)))


def _add_unit(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance, ("mass", "inertia", "limit", "axis", "origin"))
    if slot:
        element, name = slot
        value = element.attrib[name]
        element.set(
            name,
            chance.choice((value + "m", value + " deg", value.replace(".", ","), value + "f", value.replace(" ", ","))),
        )


def _swap_values(root: Element, chance: random.Random) -> None:
    slot = _attribute(root, chance)
    if slot:
        element, name = slot
        other = chance.choice([e for e in root.iter() if name in e.attrib])
        element.attrib[name], other.attrib[name] = other.attrib[name], element.attrib[name]


def _add_attribute(root: Element, chance: random.Random) -> None:
    name = chance.choice(
        ("xyz", "rpy", "name", "type", "value", "lower", "quat_xyzw", "xmlns", "x", "version", "link", "effort")
    )
    _any(root, chance).set(name, chance.choice((*NUMBERS, *VECTORS, "1.0", "1.2", "http://x")))


def _delete(root: Element, chance: random.Random) -> None:
    element = _any(root, chance)
    parent = _parents(root).get(element)
    if parent is not None:
        parent.remove(element)


def _duplicate(root: Element, chance: random.Random) -> None:
    element = _any(root, chance)
    parent = _parents(root).get(element)
    if parent is not None:
        parent.insert(chance.randrange(len(parent) + 1), copy.deepcopy(element))


def _move(root: Element, chance: random.Random) -> None:
    element, target = _any(root, chance), _any(root, chance)
    parent = _parents(root).get(element)
    if parent is not None and target not in set(element.iter()):
        parent.remove(element)
        target.insert(chance.randrange(len(target) + 1), element)


def _shuffle(root: Element, chance: random.Random) -> None:
    element = root if chance.random() < 0.5 else _any(root, chance)
    children = list(element)
    chance.shuffle(children)
    element[:] = children


def _nest(root: Element, chance: random.Random) -> None:
    element = _any(root, chance)
    parent = _parents(root).get(element)
    if parent is not None:
        place = list(parent).index(element)
        for _ in range(chance.choice((1, 1, 2, 70))):
            outer = Tree.Element(chance.choice(TAGS))
            outer.append(element)
            element = outer
        parent[place] = element


def _rename_element(root: Element, chance: random.Random) -> None:
    _any(root, chance).tag = chance.choice(TAGS)


def _insert(root: Element, chance: random.Random) -> None:
    target = _any(root, chance, chance.choice(("link", "joint", "link", "joint", "robot", "visual", "inertial", "")))
    try:
        holder = Tree.fromstring(f"<h>{chance.choice(SNIPPETS)}</h>")
    except Tree.ParseError:
        return
    for child in holder:
        target.insert(chance.randrange(len(target) + 1), child)


def _graft(root: Element, chance: random.Random) -> None:
    """Put an element of another robot in."""
    other = _any(Tree.fromstring(chance.choice(base_robots()).encode()), chance)
    _any(root, chance, other.tag).append(copy.deepcopy(other))


def _flood(root: Element, chance: random.Random) -> None:
    """Hang many links on one."""
    names = [link.get("name", "") for link in root.findall("link")] or ["base"]
    parent = chance.choice(names)
    kind = chance.choice(("fixed", "continuous"))
    for k in range(chance.choice((3, 30, 150, 300))):
        Tree.SubElement(root, "link", name=f"extra{k}")
        joint = Tree.SubElement(root, "joint", name=f"extra_joint{k}", type=kind)
        Tree.SubElement(joint, "parent", link=parent)
        Tree.SubElement(joint, "child", link=f"extra{k}")
        Tree.SubElement(joint, "axis", xyz="0 0 1")
        parent = f"extra{k}" if chance.random() < 0.9 else parent


# --- of names and the tree ---


def _rename_whole(root: Element, chance: random.Random) -> None:
    """Give a link or joint another name, and all that name it."""
    kind = chance.choice(("link", "joint"))
    names = [e.get("name", "") for e in root if e.tag in ("link", "joint")]
    element = _any(root, chance, kind)
    _exchange(root, kind, element.get("name", ""), chance.choice((*NAMES, *names, *names, *names)))


def _share_names(root: Element, chance: random.Random) -> None:
    """Give links the names of joints, several at once."""
    joints = [e.get("name", "") for e in root.findall("joint")]
    links = [e.get("name", "") for e in root.findall("link")]
    if joints and links:
        chance.shuffle(joints)
        for link, joint in list(zip(links, joints, strict=False))[: chance.choice((1, 1, 2, 50))]:
            _exchange(root, "link", link, joint)


def _exchange(root: Element, kind: str, old: str, new: str) -> None:
    for element in root.iter():
        if element.tag == kind and element.get("name") == old:
            element.set("name", new)
        for name in ("link",) if kind == "link" else ("joint",):
            if element.get(name) == old:
                element.set(name, new)


def _rewire(root: Element, chance: random.Random) -> None:
    names = [link.get("name", "") for link in root.findall("link")]
    _any(root, chance, chance.choice(("parent", "child"))).set("link", chance.choice((*names, "nope")))


def _change_type(root: Element, chance: random.Random) -> None:
    _any(root, chance, "joint").set("type", chance.choice(TYPES[:4] if chance.random() < 0.7 else TYPES))


def _reverse(root: Element, chance: random.Random) -> None:
    """Swap a joint's parent and child."""
    joint = _any(root, chance, "joint")
    ends = [end for end in joint if end.tag in ("parent", "child")]
    for end in ends:
        end.tag = "child" if end.tag == "parent" else "parent"


CHANGES: tuple[Callable[[Element, random.Random], None], ...] = (
    _drop_attribute, _rename_attribute, _set_value, _set_value, _set_number, _set_number, _set_vector, _set_vector,
    _scale_number, _scale_number, _pad, _pad, _add_unit, _swap_values, _swap_values, _add_attribute, _delete, _duplicate,
    _move, _shuffle, _nest, _rename_element, _insert, _insert, _graft, _flood, _rename_whole, _rename_whole, _share_names,
    _share_names, _rewire, _change_type, _change_type, _reverse,
)  # fmt: skip


# --- of bytes ---


def _flip(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(max(1, len(data)))
    return data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]


def _put_piece(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(PIECES) + data[at + chance.choice((0, 0, 1, 5)) :]


def _cut(data: bytes, chance: random.Random) -> bytes:
    start, stop = sorted(chance.randrange(len(data) + 1) for _ in range(2))
    return data[:start] if chance.random() < 0.5 else data[:start] + data[stop:]


def _repeat(data: bytes, chance: random.Random) -> bytes:
    start, stop = sorted(chance.randrange(len(data) + 1) for _ in range(2))
    return data[:stop] + data[start:stop] + data[stop:]


def _splice(data: bytes, chance: random.Random) -> bytes:
    other = chance.choice(base_robots()).encode()
    return data[: chance.randrange(len(data) + 1)] + other[chance.randrange(len(other)) :]


def _double_attribute(data: bytes, chance: random.Random) -> bytes:
    words = data.split(b" ")
    at = chance.randrange(len(words))
    return b" ".join([*words[:at], words[at], *words[at:]])


def _line_ends(data: bytes, chance: random.Random) -> bytes:
    return data.replace(b"\n", chance.choice((b"\r\n", b"\r", b"\n\n", b"\n\r")))


def _encode(data: bytes, chance: random.Random) -> bytes:
    """Write the text in one encoding, with a letter that is not ASCII, and declare the same or another one."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return data
    written, declared = chance.choice(ENCODINGS), chance.choice(ENCODINGS)
    if chance.random() < 0.7:
        declared = {"utf-16-le": "utf-16", "utf-16-be": "utf-16"}.get(written, written)
    if chance.random() < 0.7:
        text = text.replace("link1", "lïnk1").replace("hand", "hånd").replace("tool", "tööl€")
    text = text.replace('encoding="UTF-8"', f'encoding="{declared}"', 1 if chance.random() < 0.8 else 0)
    mark = {"utf-16-le": codecs.BOM_UTF16_LE, "utf-16-be": codecs.BOM_UTF16_BE, "utf-8": codecs.BOM_UTF8}.get(
        written, b""
    )
    try:
        encoded = text.encode(written, "replace")
    except (LookupError, UnicodeError, AttributeError):
        return data
    return (mark if chance.random() < 0.7 else b"") + encoded


BYTE_CHANGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _flip, _flip, _put_piece, _put_piece, _cut, _repeat, _splice, _double_attribute, _line_ends, _encode, _encode, _encode,
)  # fmt: skip
