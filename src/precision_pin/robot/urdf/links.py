"""Reader of ``<link>`` elements and their masses."""

from __future__ import annotations

import math

import numpy as np

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Inertial, Link
from precision_pin.robot.urdf.elements import check_attributes, check_children, read_name
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.numbers import read_numbers, read_vector
from precision_pin.robot.urdf.units import BEYOND_USE, LONGEST_REACH, check_angle, check_length
from precision_pin.robot.urdf.visuals import Colour, Looks
from precision_pin.robot.urdf.xmltree import Node

TINY_MASS = 1e-6
LARGE_MASS = 500.0
PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read_link(node: Node, findings: Findings, looks: Looks, colours: dict[str, Colour]) -> Link | None:
    """Return the link, None if it has no name.

    Errors go to ``findings``; a link returned with an error only serves to find further errors.
    """
    check_attributes(node, "link", findings)
    name = read_name(node, findings)
    owner = f"link {shown(name or '?')}"
    check_children(node, owner, findings)
    element = node.first("inertial")
    inertial = None if element is None else _inertial(element, owner, findings)
    visuals = looks.read(node, owner, colours)
    return None if name is None else Link(name, inertial, visuals, node.line)


def _inertial(node: Node, owner: str, findings: Findings) -> Inertial | None:
    check_children(node, owner, findings)
    before = findings.errors
    origin = node.first("origin")
    com = read_vector(origin, "xyz", owner, findings)
    rpy = read_vector(origin, "rpy", owner, findings)
    mass = _mass(node, owner, findings)
    inertia = _inertia(node, owner, findings)
    if origin is not None:
        check_length(com, f"{owner}: centre of mass", origin.line, findings)
        check_angle(rpy, f"{owner}: inertial rpy", origin.line, findings)
    if mass is None or inertia is None or findings.errors > before:
        return None
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    if mass > 0 and math.sqrt(max(ixx + iyy + izz, 0.0) / 2 / mass) > LONGEST_REACH:
        message = (
            f"{owner}: inertia up to {max(inertia):g} kg·m² at {mass:g} kg would reach over {LONGEST_REACH:g} m; "
            "are these kg·mm²?"
        )
        findings.warning("W_UNITS", message, node.line)
    return Inertial(mass, com, rpy, (ixx, ixy, ixz, iyy, iyz, izz))


def _mass(node: Node, owner: str, findings: Findings) -> float | None:
    element = node.first("mass")
    if element is None:
        findings.error("E_INERTIAL", f'{owner}: <inertial> has no <mass value="…"/>', node.line)
        return None
    numbers = read_numbers(element, "value", 1, owner, findings)
    if numbers is None:
        return None
    mass = numbers[0]
    if mass < 0:
        findings.error("E_MASS_NEG", f"{owner}: mass {mass:g} kg is negative; zero or more is needed", element.line)
    elif mass > BEYOND_USE:
        findings.error("E_UNITS", f"{owner}: mass {mass:g} kg is implausibly large; masses are in kg", element.line)
    elif mass > LARGE_MASS:
        message = f"{owner}: mass {mass:g} kg; are these grams? masses are in kg"
        findings.warning("W_MASS_LARGE", message, element.line)
    elif mass == 0:
        findings.grouped_warning("W_MASS_ZERO", "a mass of zero is given; it weighs nothing", owner, element.line)
    elif mass < TINY_MASS:
        message = f"{owner}: mass {mass:g} kg is under a milligram"
        findings.warning("W_MASS_TINY", message, element.line)
    return mass


def _inertia(node: Node, owner: str, findings: Findings) -> tuple[float, ...] | None:
    element = node.first("inertia")
    if element is None:
        message = f"{owner}: <inertial> has no <inertia>; {', '.join(PARTS)} are needed"
        findings.error("E_INERTIAL", message, node.line)
        return None
    missing = [part for part in PARTS if element.get(part) is None]
    if missing:
        message = f"{owner}: <inertia> has no {', '.join(missing)}; all of {', '.join(PARTS)} are needed"
        findings.error("E_INERTIAL", message, element.line)
        return None
    values = [read_numbers(element, part, 1, owner, findings) for part in PARTS]
    numbers = tuple(value[0] for value in values if value is not None)
    if len(numbers) < len(PARTS):
        return None
    if np.abs(numbers).max() > BEYOND_USE * LONGEST_REACH**2:
        message = f"{owner}: an inertia of {max(numbers, key=abs):g} kg·m² is implausibly large"
        findings.error("E_UNITS", message, element.line)
        return None
    return numbers
