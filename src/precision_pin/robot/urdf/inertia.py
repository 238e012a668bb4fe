"""Check that the inertias of a robot are physically possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Inertial, Link
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.robot import Robot

Verdict = Literal["physical", "point", "negative", "triangle"]

# inertias are often written with three digits; those of a plate then violate ixx + iyy = izz by as much
ROUNDING = 1e-3
# radius of gyration of one micrometre: export programs write such inertias for zeros
POINT_RADIUS = 1e-6
WHAT = {
    "negative": ("E_INERTIA_PD", "one is negative; all must be zero or more"),
    "triangle": ("E_INERTIA_TRIANGLE", "no mass distribution has one larger than the sum of the others"),
}


def check_inertias(links: tuple[Link, ...], robot: Robot | None, findings: Findings) -> None:
    """Refuse unphysical inertias (``E_INERTIA_PD``, ``E_INERTIA_TRIANGLE``).

    A link that fixed joints make part of a larger rigid body only gets a warning (``W_INERTIA``) if the
    whole body is physical, because only the body's inertia has an effect. A link with mass and no inertia is a
    point mass (``W_INERTIA_ZERO``); one zero principal moment (a slender rod) is allowed without a warning.

    Parameters
    ----------
    links
        The links that could be read.
    robot
        The tree, None if other errors prevent one.
    """
    bodies = {} if robot is None else _bodies(robot)
    for link in links:
        inertial = link.inertial
        if inertial is None:
            continue
        moments = _moments(inertial.tensor)
        verdict = _verdict(moments, inertial.mass)
        owner = f"link {shown(link.name)}"
        if verdict == "point" and inertial.mass > 0:
            message = f"{owner}: the inertia is zero; its {inertial.mass:g} kg are treated as a point mass"
            findings.warning("W_INERTIA_ZERO", message, link.line)
        if verdict not in WHAT:
            continue
        code, why = WHAT[verdict]
        message = f"{owner}: principal moments of inertia {_format_moments(moments)} kg·m²: {why}"
        body = bodies.get(link.name)
        if body is None or body.links == 1 or not _is_physical(body):
            findings.error(code, message, link.line)
        else:
            message += f"; accepted, because the rigid body of {body.links} links that it belongs to is physical"
            findings.warning("W_INERTIA", message, link.line)


def _verdict(moments: Array, mass: float) -> Verdict:
    """Return the verdict on principal moments in rising order."""
    if np.abs(moments).max() <= abs(mass) * POINT_RADIUS**2:
        return "point"
    if moments[0] < -ROUNDING * moments[2]:
        return "negative"
    if moments[2] > (moments[0] + moments[1]) + ROUNDING * moments[2]:
        return "triangle"
    return "physical"


def _is_physical(body: _Body) -> bool:
    # sums of huge numbers may have overflowed
    return bool(np.isfinite(body.tensor).all()) and _verdict(_moments(body.tensor), body.mass) not in WHAT


def _moments(tensor: Array) -> Array:
    """Return the principal moments in rising order."""
    return np.asarray(np.linalg.eigvalsh(tensor), dtype=np.float64)


def _format_moments(moments: Array) -> str:
    return ", ".join(f"{moment:.4g}" for moment in moments)


@dataclass(frozen=True)
class _Body:
    """Links joined by fixed joints: mass, centre and inertia about it, in the axes of the topmost link."""

    links: int
    mass: float
    centre: Array
    tensor: Array


def _bodies(robot: Robot) -> dict[str, _Body]:
    """Return the rigid body of each link, by the link's name."""
    top: dict[str, str] = {robot.root: robot.root}
    poses: dict[str, Array] = {robot.root: np.eye(4)}
    for joint in robot.joints_from_root:
        if joint.moves:
            top[joint.child], poses[joint.child] = joint.child, np.eye(4)
        else:
            top[joint.child] = top[joint.parent]
            poses[joint.child] = poses[joint.parent] @ joint.origin
    bodies: dict[str, _Body] = {}
    with np.errstate(over="ignore", invalid="ignore"):
        for link in robot.links:
            body = bodies.get(top[link.name], _Body(0, 0.0, np.zeros(3), np.zeros((3, 3))))
            bodies[top[link.name]] = _add_link(body, link.inertial, poses[link.name])
    return {name: bodies[at] for name, at in top.items()}


def _add_link(body: _Body, inertial: Inertial | None, pose: Array) -> _Body:
    """Return the body with one more link (parallel-axis theorem)."""
    if inertial is None:
        return _Body(body.links + 1, body.mass, body.centre, body.tensor)
    turn = pose[:3, :3]
    centre = turn @ np.array(inertial.com) + pose[:3, 3]
    tensor = body.tensor + turn @ inertial.tensor @ turn.T
    mass = body.mass + inertial.mass
    if mass <= 0:
        return _Body(body.links + 1, mass, body.centre, tensor)
    apart = centre - body.centre
    reduced = body.mass * inertial.mass / mass
    tensor = tensor + reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return _Body(body.links + 1, mass, body.centre + inertial.mass / mass * apart, tensor)
