"""A model in which every frame of a chain may be displaced."""

from __future__ import annotations

from precision_pin.base.arguments import check_instance
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.frame import Frame
from precision_pin.terms.source import Source


def every_frame(chain: Chain) -> ErrorModel:
    """Return a model with all six displacements at every joint, at the base and at the tool.

    Each is normal with a standard deviation of 1 mm or 1 mrad: it serves to see which combinations of geometric errors
    measurements can tell apart, with :func:`precision_pin.identifiability`.
    """
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    names = ("x", "y", "z", "rx", "ry", "rz")
    free = {name: Normal(1e-3) for name in names}
    sources: list[Source] = [Frame(frame=chain.base, **free)]  # type: ignore[arg-type]
    sources += [Frame(joint=name, **free) for name in chain.joint_names]  # type: ignore[arg-type]
    sources.append(Frame(frame=chain.tip, **free))  # type: ignore[arg-type]
    return ErrorModel(chain, Space(), sources)
