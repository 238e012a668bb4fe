"""Time per pose of Jacobian, load torques and link wrenches, beside a loop over Pinocchio, in one run on one core.

    python benchmarks/postures.py [--poses P] [--tables T]

Three arms: the paper's, a UR5 and a Panda, with their shipped sheets (the last two need the extra ``examples``). The
loop is what one would write with Pinocchio: joint Jacobians, the tip's, inverse dynamics at rest, and the forces on the
joints out of ``data.f``, into arrays made beforehand. Ours gets its memory anew each time, and also turns the wrenches
into the axes of the links' ends. Then whole term tables, one pose at a time and many. Times are CPU time of the one
thread, the best of several turns.
"""

from __future__ import annotations

import argparse
import math
import os
import time
import warnings
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio

from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import shipped_sheets

ARMS = {"4dof": "the paper's arm", "ur5": "UR5", "panda": "Panda"}
TURNS = 7
LOOPED = 1000
"""Poses that Pinocchio's loop is timed over; its time per pose does not depend on their number."""


def seconds(work: Callable[[], object]) -> float:
    """Return the CPU time, the best of several turns after one to warm up."""
    work()
    best = math.inf
    for _ in range(TURNS):
        began = time.thread_time()
        work()
        best = min(best, time.thread_time() - began)
    return best


def pinocchio_loop(chain: Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Jacobians ``(P, 6, n)``, load torques ``(P, n)`` and forces on the joints ``(P, n, 6)``."""
    model, joints = chain.pinocchio.model.copy(), chain.pinocchio.joints
    placement, kind = pinocchio.SE3(np.array(chain.target_placement)), pinocchio.FrameType.OP_FRAME
    tip = model.addFrame(pinocchio.Frame("looped tip", joints[-1], placement, kind))
    data, still, axes = model.createData(), np.zeros(model.nv), pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    count, n = len(q), len(joints)
    jacobians, torques, wrenches = np.empty((count, 6, n)), np.empty((count, n)), np.empty((count, n, 6))
    for k in range(count):
        pinocchio.computeJointJacobians(model, data, q[k])
        jacobians[k] = pinocchio.getFrameJacobian(model, data, tip, axes)
        torques[k] = -pinocchio.rnea(model, data, q[k], still, still)
        for i, joint in enumerate(joints):
            wrenches[k, i] = -data.f[joint].vector
    return jacobians, torques, wrenches


def compare(name: str, poses: int, tables: int) -> None:
    """Print one arm."""
    model = ErrorModel.load(shipped_sheets()[name])
    chain = model.chain
    # two whole turns: the size of the angles does not matter
    q = np.random.default_rng(0).uniform(-2 * math.pi, 2 * math.pi, (len(chain.joints), poses))
    rows = np.ascontiguousarray(q.T[:LOOPED])
    looped = seconds(lambda: pinocchio_loop(chain, rows)) / len(rows)
    batched = seconds(lambda: chain.at_many(q).joint_jacobian) / poses
    placed = seconds(lambda: chain.at_many(q).joint_poses) / poses
    jacobians, torques, _ = pinocchio_loop(chain, rows)
    many = chain.at_many(q[:, :LOOPED])
    gaps = np.abs(many.joint_jacobian - np.moveaxis(jacobians, 0, -1)), np.abs(many.load_torque - torques.T)
    print(f"\n{ARMS[name]}: {len(chain.joints)} joints, {poses:,} poses")
    print(
        f"  Jacobian, torques, wrenches: Pinocchio loop {1e6 * looped:.2f} µs a pose, batched {1e6 * batched:.3f}",
        end="",
    )
    print(f", {looped / batched:.0f} times; largest difference {max(gap.max() for gap in gaps):.0e}")
    print(f"  poses of joints and tip: batched {1e6 * placed:.3f} µs a pose")
    some = q[:, :tables]
    alone = seconds(lambda: [None for column in some.T if model.at(column)]) / tables
    together = seconds(lambda: [None for at in model.at_many(some) if at]) / tables
    print(
        f"  term tables: at {1e3 * alone:.2f} ms a pose, at_many {1e3 * together:.2f} ({len(model.at().terms)} terms)"
    )


def main() -> None:
    """Print the start-up time and the three arms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=4096, help="poses computed at once")
    parser.add_argument("--tables", type=int, default=100, help="poses that term tables are made at")
    options = parser.parse_args()
    began = time.perf_counter()
    chain = ErrorModel.load(shipped_sheets()["4dof"]).chain
    _ = chain.at_many(np.zeros((len(chain.joints), 1))).load_torque
    print(f"first call, compiling included where nothing is cached: {time.perf_counter() - began:.2f} s")
    warnings.simplefilter("ignore", PrecisionPinWarning)  # the poses are beyond limits
    for name in ARMS:
        compare(name, options.poses, options.tables)


if __name__ == "__main__":
    main()
