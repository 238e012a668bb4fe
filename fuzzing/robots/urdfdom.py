"""What Pinocchio's own reader of URDF (urdfdom) makes of a text: the robot, or its refusal, and what it logs."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

__all__ = ["UrdfdomReading", "read_urdfdom"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UrdfdomReading:
    """The model (None where the text is refused) and the lines that went to the standard error stream."""

    model: Any
    log: str

    def poses(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Return every link's pose in the root, ``(4, 4)``."""
        model = self.model
        q = pinocchio.neutral(model)
        for number in range(1, model.njoints):
            joint, value = model.joints[number], values[model.names[number]]
            # a continuous joint is held as cosine and sine
            q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        data = model.createData()
        pinocchio.framesForwardKinematics(model, data, q)
        return {
            frame.name: np.array(data.oMf[number].homogeneous)
            for number, frame in enumerate(model.frames)
            if frame.type == pinocchio.FrameType.BODY
        }

    def moments(self, joint: str) -> Array:
        """Return mass and first moment ``(4,)`` of what a joint carries; of what stands still for ``universe``."""
        inertia = self.model.inertias[list(self.model.names).index(joint)]
        return np.array([inertia.mass, *(inertia.mass * inertia.lever)])


def read_urdfdom(text: str) -> UrdfdomReading:
    """Read a text; what the C++ code writes to the standard error stream is caught."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as stream:
        os.dup2(stream.fileno(), 2)
        try:
            model = pinocchio.buildModelFromXML(text)
        except ValueError:
            model = None
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        stream.seek(0)
        return UrdfdomReading(model, stream.read().decode("utf-8", "replace"))
