"""Error models with many sources, for the tests of the engines, and arms of sliding joints, whose error is known exactly."""

import numpy as np

from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Disc, JointNormal, Normal, Triangular, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.axis_install import AxisInstall
from precision_pin.sources.beam import Beam
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from precision_pin.sources.mcpc import Mcpc
from precision_pin.sources.payload import Payload
from precision_pin.terms.source import Source
from support.plain_robot import chain_of, joint, link, random_arm, robot

SEVEN_Q = (0.3, -0.7, 1.1, 0.2, -1.3, 0.8, 0.5)
PAPER_Q = tuple(np.radians([-90, 3, 88, -91]))


def seven_joint_arm(gravity=(0.0, 0.0, -9.81), prismatic=(4,), seed=51) -> Chain:
    return chain_of(random_arm(seed, prismatic=prismatic), tip="tool", gravity=gravity)


def loads(tip: str = "tool") -> tuple[Space, list[Source]]:
    """Payload, compliances and beams, all random: products of three factors, derived rigidities."""
    modulus, diameter = Component("modulus"), Component("diameter")
    space = Space(
        (
            Draw("modulus", Uniform(5e9, mean=7e10)),
            Draw("diameter", Normal(2e-4, mean=0.02)),
            Draw("softness", Triangular(2e-5, mean=1e-4)),
            Draw("centre", JointNormal(((1e-4, 3e-5), (3e-5, 2e-4)), (0.05, -0.02)), Scope.VISIT),
        )
    )
    rigidity = modulus * diameter**4 * (np.pi / 64)
    return space, [
        Payload(at=tip, mass=Uniform(0.3, mean=2.0), com=("centre.0", Uniform(0.03), "centre.1")),
        Payload(at=tip, mass=0.5, com=(0.0, 0.1, 0.0)),
        Beam(link="link2", EI=rigidity, GI=0.77 * rigidity, EA=1e6),
        Beam(link="link3", EI_y=Uniform(200.0, mean=900.0), EI_z=700.0, torsion_stiffness=Normal(10.0, mean=500.0)),
        JointCompliance(joint="joint1", compliance="softness"),
        JointCompliance(joint="joint2", compliance="softness"),
        JointCompliance(joint="joint4", compliance=Uniform(1e-6, mean=2e-5)),
    ]


def geometry(chain: Chain, tip: str = "tool", scale: float = 1.0) -> list[Source]:
    """Every other kind of source, zero means and no products."""
    last = f"link{len(chain.joints)}"
    return [
        Frame(link="base", x=Uniform(1e-3 * scale), ry=Normal(1e-3 * scale)),
        Length(joint="joint3", parameters=(Uniform(1e-3 * scale), Triangular(1e-3 * scale))),
        Length(frame=tip, along="-x of joint2", parameters=(Uniform(1e-3 * scale),)),
        *(AxisInstall(joint=name, radius=2e-4 * scale, span=0.1, start=0.02) for name in chain.joint_names),
        Frame(joint="joint4", z=Normal(5e-4 * scale), rx=Uniform(2e-3 * scale), rz=Uniform(2e-3 * scale)),
        Frame(frame=tip, y=Uniform(1e-3 * scale), rx=Normal(1e-3 * scale)),
        JointOffset(joint="joint2", offset=Uniform(2e-3 * scale)),
        JointOffset(joint="joint4", offset=Normal(1e-3 * scale)),
        Mcpc(link="link2", alpha=Uniform(1e-3 * scale), x=Normal(5e-4 * scale)),
        Mcpc(link=last, beta=Uniform(1e-3 * scale), gamma=Uniform(1e-3 * scale), z=Uniform(1e-3 * scale)),
    ]


def everything(chain: Chain, scale: float = 1.0) -> ErrorModel:
    space, laden = loads()
    draws = (*space.draws, Draw("spot", Disc(1e-3 * scale)))
    spot = Frame(joint="joint1", x="spot.x", y="spot.y")
    return ErrorModel(chain, Space(draws), [*laden, *geometry(chain, scale=scale), spot])


def spread_out(model: ErrorModel, seed: int = 5, deviations: float = 1.5) -> np.ndarray:
    """Return a displacement of every component by about its standard deviation, ``(d,)``."""
    generator = np.random.default_rng(seed)
    return generator.uniform(-deviations, deviations, model.space.size) * np.sqrt(np.diag(model.space.covariance))


def named(model: ErrorModel) -> Space:
    """Return the draws that have names of their own, which no source brings itself."""
    return Space(tuple(draw for draw in model.space.draws if "[" not in draw.name))


def slides(axes, offsets, space: Space | None = None) -> ErrorModel:
    """Return an arm of sliding joints: its error is the sum of its joints' errors along their axes, exactly."""
    names = ["base", *(f"link{k}" for k in range(1, len(axes))), "tool"]
    parts = [link(name) for name in names]
    for k, axis in enumerate(axes):
        parts.append(joint(f"joint{k + 1}", "prismatic", names[k], names[k + 1], axis=axis))
    chain = chain_of(robot(*parts), tip="tool")
    sources = [JointOffset(joint=f"joint{k + 1}", offset=offset) for k, offset in enumerate(offsets)]
    return ErrorModel(chain, space or Space(), sources, {"rest": np.zeros(len(axes))})
