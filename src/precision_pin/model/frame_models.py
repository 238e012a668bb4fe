"""Models whose frames are displaced: randomly at every frame, or by known amounts at joints and tip."""

from __future__ import annotations

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arguments import check_instance
from precision_pin.base.arrays import Array
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.frame import Frame
from precision_pin.terms.source import Source


def every_frame(chain: Chain) -> ErrorModel:
    """Return a model with all six displacements at every joint, at the base and at the tool.

    Each is normal with a standard deviation of 1 mm or 1 mrad. With :func:`precision_pin.identifiability` it shows
    which combinations of geometric errors measurements can tell apart.
    """
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    names = ("x", "y", "z", "rx", "ry", "rz")
    free = {name: Normal(1e-3) for name in names}
    sources: list[Source] = [Frame(frame=chain.base, **free)]  # type: ignore[arg-type]
    sources += [Frame(joint=name, **free) for name in chain.joint_names]  # type: ignore[arg-type]
    sources.append(Frame(frame=chain.tip, **free))  # type: ignore[arg-type]
    return ErrorModel(chain, Space(), sources)


_NAMES = ("x", "y", "z", "rx", "ry", "rz")


def displaced_arm(chain: Chain, placements: Array, model: ErrorModel | None = None) -> ErrorModel:
    """Return the model of an arm with other placements, each reached by fixed displacements.

    ``placements`` ``(n + 1, 4, 4)`` are those of the joints' seats, and last of the tip, each in the chain link before
    it. The sources of ``model`` are kept.
    """
    sources: list[Source] = [] if model is None else list(model.sources)
    for k, (old, new) in enumerate(zip(chain.placements, placements, strict=True)):
        moved = se3.inverse(old) @ new
        values = np.concatenate([moved[:3, 3], se3.log_rotation(moved[:3, :3])]).tolist()
        place = {"joint": chain.joint_names[k]} if k < len(chain.joints) else {"frame": chain.tip}
        sources.append(Frame(**place, **dict(zip(_NAMES, values, strict=True))))
    if model is None:
        return ErrorModel(chain, Space(), sources)
    return ErrorModel(chain, model.space, sources, model.poses, model.statics)
