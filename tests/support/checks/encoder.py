"""Encoders, by hand: GUM's resolution, Heidenhain's eccentricity, the mean of two heads."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.terms.term import JointValue
from support.checks.common import evaluated, one_link, same

ARCSEC = np.pi / 648000


def check_encoder(module: ModuleType) -> None:
    chain = one_link()

    def error(q: float, phase: float = 0.0, **settings) -> float:
        source = module.Encoder(joint="hinge", **settings)
        point = {"encoder[hinge].phase.x": np.cos(phase), "encoder[hinge].phase.y": np.sin(phase)}
        _, totals = evaluated(chain, [q], [source], point if source.draws("") else None)
        return float(totals[JointValue(0)][0]) if totals else 0.0

    # 412 e/D arcsec for 1 µm and 24.85 mm
    amplitude = 412.5 * 1 / 24.85 * ARCSEC
    same(error(0.0, np.pi / 2, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    same(error(np.pi / 2, 0.0, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    same(error(np.pi / 3, np.pi / 6, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    # on the motor's side: 50 times as fast, a 50th of it
    for q, phase in ((0.7, 1.1), (-2.3, 4.0)):
        same(error(q, phase, amplitude=2e-3, order=3, ratio=50), 2e-3 / 50 * np.sin(3 * 50 * q + phase), 1e-15)
        # the mean of what two heads read, each at its own angle
        for order in (1, 2, 3, 4):
            mean = np.mean([2e-3 * np.sin(order * (q + head) + phase) for head in (0.0, np.pi)])
            same(error(q, phase, amplitude=2e-3, order=order, heads=2), mean, 1e-15)
    # both numbers of the amplitude random
    source = module.Encoder(joint="hinge", eccentricity=Uniform(5e-6, mean=20e-6), radius=0.02)
    values = {"encoder[hinge].eccentricity": 18e-6, "encoder[hinge].phase.x": 0.6, "encoder[hinge].phase.y": 0.8}
    _, totals = evaluated(chain, [0.5], [source], values)
    same(totals[JointValue(0)], [9e-4 * np.sin(0.5 + np.arctan2(0.8, 0.6))], 1e-15)
    # JCGM 100, F.2.2.1: a step's standard uncertainty is 0.29 of it; here 17 bits, on the motor's side of 100:1
    step = 2 * np.pi / 2**17
    for ratio in (1.0, 100.0):
        source = module.Encoder(joint="hinge", resolution=step, ratio=ratio)
        at, totals = evaluated(chain, [0.5], [source], {"encoder[hinge].quantisation": 1e-5})
        same(totals[JointValue(0)], [1e-5], 1e-15)
        same(at.space.covariance, [[(step / ratio) ** 2 / 12]], 1e-15)
        (draw,) = at.space.draws
        same(draw.law.support([1.0]), step / 2 / ratio, 1e-15)
        assert draw.scope is Scope.POSE
    # a periodic error has its amplitude's variance, halved, at every pose
    for q in (0.0, 0.7):
        at, _ = evaluated(chain, [q], [module.Encoder(joint="hinge", amplitude=1e-3)])
        same(at.covariance[5, 5], 1e-6 / 2, 1e-18)
        assert all(draw.scope is Scope.UNIT for draw in at.space.draws)
    # zero
    source = module.Encoder(joint="hinge", offset=Normal(1e-3, mean=2e-3))
    _, totals = evaluated(chain, [0.5], [source], {"encoder[hinge].offset": 3e-3})
    same(totals[JointValue(0)], [3e-3], 1e-15)
    # a linear encoder at 0.3 m: 20 µm period, a scale 5 µm/m long
    slide = one_link("prismatic")
    for d in (0.3, 0.3 + 5e-6, -0.1 + 7e-6):
        source = module.Encoder(joint="hinge", amplitude=1e-7, period=20e-6, scale=Uniform(5e-6))
        values = {"encoder[hinge].scale": 5e-6, "encoder[hinge].phase.x": 0.6, "encoder[hinge].phase.y": -0.8}
        _, totals = evaluated(slide, [d], [source], values)
        expected = 5e-6 * d + 1e-7 * np.sin(2 * np.pi * d / 20e-6 - np.arctan2(0.8, 0.6))
        same(totals[JointValue(0)], [expected], 1e-15)
