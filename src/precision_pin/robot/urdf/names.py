"""Check for names that a person, a sheet, a browser or a spreadsheet would misread."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Joint, Link
from precision_pin.robot.urdf.findings import Findings

RESERVED = "universe"
PLAIN_MARKS = frozenset("_-.:")
# letters of other scripts that look like Latin ones, after case folding
LOOK_ALIKE = str.maketrans(
    "авекмнорстухіјѕԁԛԝһӏαβεικνορτυχγ",
    "abekmhopctyxijsdqwhlabeikvoptuxy",
)


def check_names(links: Sequence[Link], joints: Sequence[Joint], findings: Findings) -> None:
    """Check the names of links and joints, each list without duplicates.

    Adds ``E_RESERVED_NAME``, ``W_NAME_CHARS``, ``W_NAME_CONFUSABLE``, ``W_NAME_SHARED``.
    """
    for kind, things in (("link", links), ("joint", joints)):
        looks: dict[str, str] = {}
        for thing in things:
            name = thing.name
            if name == RESERVED:
                message = f"the {kind} name {name!r} is reserved for the world; choose another name"
                findings.error("E_RESERVED_NAME", message, thing.line)
            odd = _find_odd_character(name)
            if odd is not None:
                message = f"the {kind} name {shown(name)} holds {odd}; letters, digits and _ - . : are safe everywhere"
                findings.warning("W_NAME_CHARS", message, thing.line)
            twin = looks.setdefault(_skeleton(name), name)
            if twin != name:
                message = f"the {kind} names {shown(twin)} and {shown(name)} are easily confused"
                findings.warning("W_NAME_CONFUSABLE", message, thing.line)
    joint_names = {joint.name for joint in joints}
    for link in links:
        if link.name in joint_names:
            message = f"a link and a joint share the name {shown(link.name)}"
            findings.warning("W_NAME_SHARED", message, link.line)


def _find_odd_character(name: str) -> str | None:
    """Return a phrase for the unusual character of a name, None if there is none."""
    if name[0] in "-.:":
        return f"a leading {name[0]!r}"
    for character in name:
        if unicodedata.category(character)[0] not in "LMN" and character not in PLAIN_MARKS:
            return "a blank" if character == " " else f"the character {character!r}"
    return None


def _skeleton(name: str) -> str:
    """Return a name as a quick reader sees it: without case, width, script and invisible characters."""
    folded = unicodedata.normalize("NFKC", name).casefold().translate(LOOK_ALIKE)
    return "".join(character for character in folded if unicodedata.category(character)[0] not in "CZ")
