"""The same with other libraries, each where it is installed; none of them is needed.

    pip install roboticstoolbox-python openturns jax

As in `benchmarks.loops`, each gives a function from the UR5's parameters ``(36, N)`` to the errors ``(6, N)``. OpenTURNS
and JAX also draw the parameters themselves, as their users do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from benchmarks.cases import HALF_WIDTH, IS_UNIFORM, POSE, STD, UR5
from benchmarks.loops import Errors, numpy_by_hand, rotation_vectors, virtual_joint_values
from precision_pin.base.arrays import Array

__all__ = ["Other", "jax_compiled", "openturns_function", "robotics_toolbox"]


@final
@dataclass(frozen=True)
class Other:
    """An alternative that another library makes.

    Attributes:
        errors: From parameters ``(36, N)`` to errors ``(6, N)``.
        sampled: Draws N samples and returns their errors; None: numpy draws for it.
    """

    errors: Errors
    sampled: Callable[[int], Array] | None = None


def robotics_toolbox() -> Other:
    """Return Peter Corke's toolbox with a virtual joint for each parameter, evaluated in C sample by sample."""
    from roboticstoolbox import ET

    chain: Any = None
    for a, d, alpha in UR5:
        joints = [ET.Rz(), ET.tx(), ET.ty(), ET.tz(), ET.Rx(), ET.Ry(), ET.Rz(), ET.tx(a), ET.tz(d), ET.Rx(alpha)]
        for joint in joints:
            chain = joint if chain is None else chain * joint
    pose = np.array(chain.eval(virtual_joint_values(np.zeros((36, 1)))[0]))

    def errors(x: Array) -> Array:
        poses = np.empty((x.shape[1], 4, 4))
        for sample, values in enumerate(virtual_joint_values(x)):
            poses[sample] = chain.eval(values)
        return np.concatenate([(poses[:, :3, 3] - pose[:3, 3]).T, rotation_vectors(poses[:, :3, :3], pose[:3, :3])])

    return Other(errors)


def openturns_function() -> Other:
    """Return OpenTURNS: its random numbers and its Python function, which is given all samples at once."""
    import openturns

    by_hand = numpy_by_hand()
    function = openturns.PythonFunction(
        36, 6, func_sample=lambda sample: np.ascontiguousarray(by_hand(np.ascontiguousarray(np.asarray(sample).T)).T)
    )
    uniform, normal = openturns.Uniform(-HALF_WIDTH, HALF_WIDTH), openturns.Normal(0.0, STD)
    joint = openturns.JointDistribution([uniform if flat else normal for flat in IS_UNIFORM])

    def errors(x: Array) -> Array:
        return np.asarray(function(openturns.Sample(np.ascontiguousarray(x.T)))).T

    return Other(errors, lambda count: np.asarray(function(joint.getSample(count))).T)


def jax_compiled() -> Other:
    """Return JAX: the error of one sample, mapped over the samples and compiled, in double precision on the CPU."""
    import jax
    from jax import numpy as jnp

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)

    def about(axis: str, angle: float) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        if axis == "z":
            return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])

    def rotation(v: Any) -> Any:
        square = v @ v
        angle = jnp.sqrt(square)
        cross = jnp.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        return jnp.eye(3) + jnp.sin(angle) / angle * cross + 2 * (jnp.sin(angle / 2) / angle) ** 2 * (cross @ cross)

    turned, position = np.eye(3), np.zeros(3)
    for (a, d, alpha), angle in zip(UR5, POSE, strict=True):
        turned = turned @ about("z", angle)
        position = position + turned @ np.array([a, 0, d])
        turned = turned @ about("x", alpha)

    def error(x: Any) -> Any:
        orientation, moved = jnp.eye(3), jnp.zeros(3)
        for k, ((a, d, alpha), angle) in enumerate(zip(UR5, POSE, strict=True)):
            orientation = orientation @ about("z", angle)
            moved = moved + orientation @ x[6 * k : 6 * k + 3]
            orientation = orientation @ rotation(x[6 * k + 3 : 6 * k + 6])
            moved = moved + orientation @ np.array([a, 0, d])
            orientation = orientation @ about("x", alpha)
        turn = orientation @ turned.T
        vector = jnp.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        sine = jnp.sqrt(vector @ vector)
        return jnp.concatenate([moved - position, vector * jnp.arctan2(sine, (jnp.trace(turn) - 1) / 2) / sine])

    mapped = jax.vmap(error, in_axes=1, out_axes=1)
    compiled = jax.jit(mapped)

    def sampled(key: Any, count: int) -> Any:
        one, other = jax.random.split(key)
        x = jnp.empty((36, count))
        x = x.at[np.flatnonzero(IS_UNIFORM)].set(
            jax.random.uniform(one, (15, count), minval=-HALF_WIDTH, maxval=HALF_WIDTH, dtype=jnp.float64)
        )
        x = x.at[np.flatnonzero(~IS_UNIFORM)].set(STD * jax.random.normal(other, (21, count), dtype=jnp.float64))
        return mapped(x)

    drawn = jax.jit(sampled, static_argnums=1)
    key = jax.random.key(0)
    return Other(lambda x: np.asarray(compiled(x)), lambda count: np.asarray(drawn(key, count)))
