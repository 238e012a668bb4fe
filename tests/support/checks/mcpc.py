"""MCPC parameters, eqs 1 and 2, against the perturbed parameters' kinematics."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.robot import mcpc as parameters_of
from support.checks.common import Q7, evaluated, same
from support.plain_robot import chain_of, pose_error, random_arm


def check_mcpc(module: ModuleType) -> None:
    generator = np.random.default_rng(16)
    for seed, sliding in ((16, ()), (17, (2, 5))):
        chain = chain_of(random_arm(seed, prismatic=sliding), tip="tool")
        nominal = parameters_of.from_chain(chain)
        n = len(chain.joints)
        errors = np.concatenate(
            [np.zeros(n), generator.uniform(-0.8, 0.8, 2 * n + 3), generator.uniform(-0.3, 0.3, 2 * n + 3)]
        )
        alpha, beta, gamma, x, y, z = np.split(errors[n:], [n + 1, 2 * n + 2, 2 * n + 3, 3 * n + 4, 4 * n + 5])
        sources = []
        for i, name in enumerate(["base", *(f"link{k}" for k in range(1, n + 1))]):
            last = {"gamma": float(gamma[0]), "z": float(z[0])} if i == n else {}
            sources.append(module.Mcpc(link=name, alpha=alpha[i], beta=beta[i], x=x[i], y=y[i], **last))
        at, _ = evaluated(chain, Q7, sources)
        moved = nominal.perturbed(errors).forward_kinematics(Q7)
        expected = pose_error(moved, nominal.forward_kinematics(Q7))
        same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-12)
