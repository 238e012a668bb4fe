"""A robot as its URDF defines it: a tree of links and joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, InternalError, UnknownNameError
from precision_pin.robot.urdf.data import Joint, Link


@dataclass(frozen=True)
class Robot:
    """A tree of links and joints, in the order of the file.

    Attributes
    ----------
    name
        The robot's name.
    file
        The file it was read from.
    links, joints
        All of them; exactly one link, the root, is no joint's child.
    findings
        The warnings of reading.
    """

    name: str
    file: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    findings: tuple[Finding, ...] = ()

    @cached_property
    def root(self) -> str:
        """Name of the link that is no joint's child."""
        roots = [link.name for link in self.links if link.name not in self._parents]
        if len(roots) != 1:
            raise InternalError(f"robot {self.name!r} has {len(roots)} root links; it was not read by `read`")
        return roots[0]

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """Names of the links that are no joint's parent, in file order."""
        return tuple(link.name for link in self.links if link.name not in self._children)

    @cached_property
    def joints_from_root(self) -> tuple[Joint, ...]:
        """All joints, each after those above it."""
        ordered: list[Joint] = []
        level = [self.root]
        while level:
            below = [joint for name in level for joint in self.child_joints(name)]
            ordered += below
            level = [joint.child for joint in below]
        return tuple(ordered)

    def link(self, name: str) -> Link:
        """Return a link by name.

        Raises
        ------
        UnknownNameError
            There is none; the message gives the nearest names.
        """
        try:
            return self._links[name]
        except KeyError:
            raise UnknownNameError("link", name, self._links) from None

    def joint(self, name: str) -> Joint:
        """Return a joint by name.

        Raises
        ------
        UnknownNameError
            There is none; the message gives the nearest names.
        """
        try:
            return self._joints[name]
        except KeyError:
            raise UnknownNameError("joint", name, self._joints) from None

    def child_joints(self, link: str) -> tuple[Joint, ...]:
        """Return the joints whose parent is this link, in file order."""
        self.link(link)
        return self._children.get(link, ())

    def parent_joint(self, link: str) -> Joint | None:
        """Return the joint whose child is this link, None for the root."""
        self.link(link)
        return self._parents.get(link)

    def path(self, base: str, tip: str) -> tuple[Joint, ...]:
        """Return the joints from ``base`` down to ``tip``, fixed ones included.

        Raises
        ------
        UnknownNameError
            One of the links does not exist.
        InputError
            ``base`` is not between the root and ``tip``; `rerooted` returns a robot in which it is.
        """
        self.link(base)
        joints: list[Joint] = []
        at = tip
        while at != base:
            joint = self.parent_joint(at)
            if joint is None:
                above = ", ".join([self.root, *(joint.child for joint in reversed(joints))])
                raise InputError(f"link {base!r} is not above {tip!r}; those from the root down are: {above}")
            joints.append(joint)
            at = joint.parent
        return tuple(reversed(joints))

    def link_poses(self, values: Mapping[str, float] | None = None) -> dict[str, Array]:
        """Return every link's pose ``(4, 4)`` in the root link's frame (forward kinematics).

        Parameters
        ----------
        values
            Joint values by name, rad or m; joints not named are at zero. Mimic joints are joints like
            any other here: their coupling is not applied.

        Raises
        ------
        UnknownNameError
            A value is given for a joint that does not exist.
        """
        given = {} if values is None else values
        for name in given:
            self.joint(name)
        poses: dict[str, Array] = {self.root: np.eye(4)}
        for joint in self.joints_from_root:
            poses[joint.child] = poses[joint.parent] @ joint.origin @ joint.motion(given.get(joint.name, 0.0))
        return poses

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """The joints that are not fixed, in file order."""
        return tuple(joint for joint in self.joints if joint.moves)

    @cached_property
    def _links(self) -> dict[str, Link]:
        return {link.name: link for link in self.links}

    @cached_property
    def _joints(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def _parents(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _children(self) -> dict[str, tuple[Joint, ...]]:
        children: dict[str, list[Joint]] = {}
        for joint in self.joints:
            children.setdefault(joint.parent, []).append(joint)
        return {name: tuple(joints) for name, joints in children.items()}
