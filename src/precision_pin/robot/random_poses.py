"""Random design: poses drawn evenly over the joint ranges, or over the places that the arm reaches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_instance, check_quantities, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import steps_to
from precision_pin.base.units import LENGTH
from precision_pin.draws.philox import Units, stream_of
from precision_pin.draws.space import check_seed
from precision_pin.robot.chain import Chain
from precision_pin.robot.inverse_kinematics import inverse_kinematics
from precision_pin.robot.pose_grids import MOST_POSES, Orientation, check_orientations
from precision_pin.robot.pose_set import OBSTRUCTED, PoseSet, chain_length

_FEWEST: Final = 32
_MOST: Final = 256
"""Draws tried together; their number does not change the poses."""
_TRIES: Final = 100
_LEAST_TRIES: Final = 10_000
"""Draws for each wanted pose, and in all at least, after which too few are within reach and box."""
_PLACE_STREAMS: Final = tuple(f"place {axis}" for axis in "xyz")
_CHOICE: Final = "orientation"
_BRANCH: Final = "branch"


def random_poses(
    chain: Chain,
    count: int,
    *,
    seed: int = 0,
    box: ArrayLike | None = None,
    orientations: Orientation | Sequence[Orientation] | None = None,
    progress: Callable[[int], None] | bool | None = None,
) -> PoseSet:
    """Return poses drawn at random, reproducible for a seed; a smaller number is the start of a larger one.

    Without ``orientations`` joint values are drawn evenly between their limits, over a whole turn for a joint without
    limits; with a box those with the tip in it are kept. With ``orientations`` places are drawn evenly over the box,
    each with one of the orientations and of its angles about the tool axis, and with one of the branches that lead
    there. Unreachable places are drawn again, so that the rest lie evenly over what the arm reaches. So are poses at
    which the arm of a sheet hits itself or what it is kept out of; :attr:`PoseSet.left_out` counts them.

    Args:
        chain: The arm.
        count: Number of poses.
        seed: 64-bit seed.
        box: Lowest and highest x, y and z of the tip in the base, m, ``(3, 2)``; with orientations, by default the cube
            about the first joint that holds every place within reach.
        orientations: Orientations of the tool, one or several.
        progress: Function called with the number of poses found since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong number or box, a sliding joint without limits, or too few poses within the box or reach.
    """
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    check_whole("the number of poses", count, 1, MOST_POSES)
    check_seed(seed)
    limits = None if box is None else _check_box(box)
    if orientations is None:
        source: _JointDraws | _PlaceDraws = _JointDraws.of(chain, limits)
    else:
        kinds = check_orientations(orientations)
        source = _PlaceDraws(chain, _reach(chain) if limits is None else limits, kinds)
    found: list[PoseSet] = []
    left_out: Counter[str] = Counter()
    missing, tried = count, 0
    with steps_to(progress, count, "poses") as step:
        while missing > 0:
            raise_if_interrupted()
            if tried >= max(_TRIES * count, _LEAST_TRIES):
                hit = ", ".join(f"{number:,} {what}" for what, number in left_out.items())
                raise InputError(
                    f"only {count - missing:,} of {tried:,} random poses are within reach and in the box"
                    f"{f' and hit nothing ({hit})' if hit else ''}; make it larger, or ask for fewer than {count:,}"
                )
            together = min(max(2 * missing, _FEWEST), _MOST)
            drawn = source.draw(Units(seed, tried, together))
            if drawn is not None:
                left_out.update(one for one in drawn.status if one in OBSTRUCTED)
            if drawn is not None and drawn.known.any():
                kept = drawn.of(drawn.known)
                found.append(kept.take(np.arange(min(len(kept), missing))))
                missing -= len(found[-1])
                step(len(found[-1]))
            tried += together
    poses = PoseSet.joined(found)
    return replace(poses, names=tuple(f"random {number}" for number in range(1, count + 1)), left_out=dict(left_out))


@dataclass(frozen=True, eq=False)
class _JointDraws:
    """Draws of joint values between ``low`` and ``high``, kept if the tip is in the box."""

    chain: Chain
    low: Array
    high: Array
    box: Array | None

    @classmethod
    def of(cls, chain: Chain, box: Array | None) -> _JointDraws:
        low, high = (limit.copy() for limit in chain.configurations.limits)
        endless = ~np.isfinite(low) | ~np.isfinite(high)
        for joint in np.flatnonzero(endless & chain.prismatic):
            message = f"the joint {chain.joint_names[joint]!r} slides without limits; values of it cannot be drawn"
            raise InputError(message)
        low[endless], high[endless] = -np.pi, np.pi
        return cls(chain, low, high, box)

    def draw(self, units: Units) -> PoseSet | None:
        uniforms = units.uniforms([stream_of(name) for name in self.chain.joint_names], 0)
        q = self.low[:, None] + (self.high - self.low)[:, None] * uniforms
        poses = PoseSet.at(self.chain, q)
        if self.box is not None:
            inside = np.asarray(((poses.position >= self.box[:, :1]) & (poses.position <= self.box[:, 1:])).all(axis=0))
            if not inside.any():
                return None
            poses = poses.of(inside)
        return poses.unobstructed(self.chain)


@dataclass(frozen=True, eq=False)
class _PlaceDraws:
    """Draws of places in a box with one of some orientations; unreachable ones have no joint values."""

    chain: Chain
    box: Array
    kinds: tuple[Orientation, ...]

    def draw(self, units: Units) -> PoseSet:
        place = units.uniforms([stream_of(name) for name in _PLACE_STREAMS], 0)
        points = self.box[:, :1] + (self.box[:, 1:] - self.box[:, :1]) * place
        variants = [(rank, angle) for rank, kind in enumerate(self.kinds) for angle in range(len(kind.rotations))]
        chosen = (units.uniforms([stream_of(_CHOICE)], 0)[0] * len(variants)).astype(np.intp)
        branch = units.uniforms([stream_of(_BRANCH)], 0)[0]
        sets, ranks = [], []
        for rank, kind in enumerate(self.kinds):
            own = np.flatnonzero([variants[variant][0] == rank for variant in chosen])
            if not len(own):
                continue
            rotations = np.moveaxis(kind.rotations[[variants[chosen[k]][1] for k in own]], 0, -1)
            sets.append(self._reached(kind, points[:, own], rotations, branch[own]))
            ranks.append(own)
        joined, order = PoseSet.joined(sets), np.argsort(np.concatenate(ranks))
        return joined.take(order)

    def _reached(self, kind: Orientation, points: Array, rotations: Array, branch: Array) -> PoseSet:
        """Return a pose for each place, by one of the branches."""
        wanted = np.zeros((4, 4, points.shape[1]))
        wanted[:3, :3], wanted[:3, 3], wanted[3, 3] = rotations, points, 1.0
        found = inverse_kinematics(self.chain, wanted, task=kind.task, tool_axis=kind.tool_axis)
        every = found.poses(branches="all")
        assert every.node is not None
        counts = np.bincount(every.node, minlength=points.shape[1])
        first: NDArray[np.intp] = np.cumsum(counts) - counts
        return every.take(first + (branch * counts).astype(np.intp))


def _check_box(box: ArrayLike) -> Array:
    needs = "lowest and highest x, y and z, in m or with a unit, (3, 2)"
    limits = check_quantities("the box", box, LENGTH, (3, 2), needs)
    if (limits[:, 0] > limits[:, 1]).any():
        axis = "xyz"[int(np.argmax(limits[:, 0] > limits[:, 1]))]
        raise InputError(f"the box: its lowest {axis} is above its highest")
    return limits


def _reach(chain: Chain) -> Array:
    """Return a cube about the first joint that holds every place within reach, ``(3, 2)``."""
    low, high = chain.configurations.limits
    travel = np.maximum(np.abs(low), np.abs(high))[chain.prismatic].sum()
    if not np.isfinite(travel):
        raise InputError("a joint slides without limits, so that the reach has none; give a box")
    radius = chain_length(chain) + travel + float(np.linalg.norm(chain.target))
    centre = chain.placements[0][:3, 3]
    return np.array([centre - radius, centre + radius]).T
