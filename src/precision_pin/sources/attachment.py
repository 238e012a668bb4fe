"""The place given by the ``joint``, ``link`` or ``frame`` of a source."""

from __future__ import annotations

from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.robot.places import Place


def check_choice(kind: str, joint: str | None, link: str | None, frame: str | None) -> None:
    """Check that exactly one of the three is given.

    Raises
    ------
    InputError
        None or several are given.
    """
    if sum(name is not None for name in (joint, link, frame)) != 1:
        raise InputError(f"{kind} needs one of joint:, link: and frame:")


def chosen_place(chain: Chain, joint: str | None, link: str | None, frame: str | None) -> Place:
    """Return the seat of a joint, the end of the chain link that a URDF link belongs to, or a URDF link's own frame.

    Raises
    ------
    UnknownNameError
        No such joint or link.
    InputError
        The frame is not on the path to the tip.
    """
    if joint is not None:
        return chain.seat(chain.joint_index(joint))
    if link is not None:
        return chain.end(chain.link_frame(link).link)
    return chain.frame_place(frame or "")
