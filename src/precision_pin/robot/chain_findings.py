"""Warnings about a chain: of its URDF, about its own links with a summary of the others, and of poses outside its limits."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.base.text_escape import shown
from precision_pin.robot.chain import Chain

_ABOUT_ONE: Final = re.compile(r"""(?:the )?(link|joint) (?:name )?('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""")
"""Begin of a warning about a link or joint, and of each entry of a warning that lists several."""
_OF_A_LOAD: Final = {"W_MASS_LARGE", "W_UNITS"}
"""Warnings about a mass or a length, which matter off the path too: the weight of any link loads the arm."""


def chain_findings(chain: Chain) -> tuple[Finding, ...]:
    """Return the warnings about a chain's URDF, with those about links and joints off the chain in one line.

    The warning about several leaves is left out, since the chain's tip is known.
    """
    findings = [finding for finding in chain.robot.findings if finding.code != "W_BRANCHED"]
    on_path, loads = _names_on_path(chain), _names_of_loads(chain)

    def concerns_chain(finding: Finding) -> bool:
        subjects = _subjects(finding)
        return not subjects or bool(subjects & (on_path | loads if finding.code in _OF_A_LOAD else on_path))

    off = [finding for finding in findings if not concerns_chain(finding)]
    if len(off) < 2:
        return tuple(findings)
    file = chain.robot.file
    counts = Counter(finding.code for finding in off)
    codes = ", ".join(code if count == 1 else f"{count} {code}" for code, count in sorted(counts.items()))
    message = (
        f"{len(off)} warnings about links and joints off the chain ({codes}); "
        f"precision-pin check {shlex.quote(file)} lists them"
    )
    kept = filter(concerns_chain, findings)
    return (*kept, Finding("warning", "W_OFF_CHAIN", message, file))


def _names_on_path(chain: Chain) -> set[str]:
    """Return the links and joints from base to tip, named as in findings."""
    way = chain.robot.path(chain.base, chain.tip)
    links = {chain.base, *(joint.child for joint in way)}
    return {_name_subject("link", name) for name in links} | {_name_subject("joint", joint.name) for joint in way}


def _names_of_loads(chain: Chain) -> set[str]:
    """Return the links that a joint of the chain moves, and the joints that lead to them, named as in findings."""
    moved = {name for name, frame in chain.link_frames.items() if frame.link > 0}
    joints = {joint.name for joint in chain.robot.joints if joint.child in moved}
    return {_name_subject("link", name) for name in moved} | {_name_subject("joint", name) for name in joints}


def _name_subject(what: str, name: str) -> str:
    return f"{what} {shown(name)}"


def _subjects(finding: Finding) -> set[str]:
    """Return the links and joints that a warning is about; none if it is about anything else too."""
    named = [_ABOUT_ONE.match(text) for text in finding.subjects or (finding.message,)]
    return {f"{one[1]} {one[2]}" for one in named if one is not None} if all(named) else set()


def limit_findings(chain: Chain, values: Array, names: Sequence[str] = ()) -> tuple[Finding, ...]:
    """Return a warning if poses ``(n, P)`` are outside the joints' limits: their number, and the name of the first of them."""
    outside = chain.configurations.outside(values)
    poses = np.flatnonzero(outside.any(axis=0))
    if not poses.size:
        return ()
    first = int(poses[0])
    name = (names[first] if names else "") or f"pose {first + 1}"
    joint = chain.joints[int(np.flatnonzero(outside[:, first])[0])]
    message = (
        f"{poses.size:,} of {values.shape[1]:,} poses are outside joint limits, the first of them {name}, with the joint "
        f"{joint.name} at {values[chain.joint_index(joint.name), first]:.6g} {'m' if joint.kind == 'prismatic' else 'rad'}"
    )
    return (Finding("warning", "W_JOINT_LIMIT", message, chain.robot.file, joint.line),)
