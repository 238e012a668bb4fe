"""Errors and derivatives at many poses: at once, beside one pose after another: ``python -m benchmarks.calibration``.

A fit needs them at every pose it reads, in each of its steps. Three shipped sheets; processor time of one thread, per pose.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.tables import Table, figure, times
from benchmarks.timing import Work, best_times
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel, Tables, of_one_layout
from precision_pin.robot.examples import shipped_sheets

__all__ = ["measure"]

ARMS = ("4dof", "ur10e", "ur3e")
POSES = 256
TURNS = 3


def one_by_one(models: list[PoseModel], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors ``(6, P)`` and derivatives ``(6, d, P)`` from one pose after another."""
    errors = [at.exact(x[:, None])[:, 0] for at in models]
    slopes = [at.jacobian_at(x, error) for at, error in zip(models, errors, strict=True)]
    return np.stack(errors, axis=-1), np.stack(slopes, axis=-1)


def at_once(models: list[PoseModel], x: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the same, of many poses at once."""
    parts = [Tables.of(chunk).tangent(x) for chunk in of_one_layout(models)]
    return tuple(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in ("error", "jacobian"))


def measure(poses: int = POSES, turns: int = TURNS) -> Table:
    """Return microseconds a pose and ratios."""
    rows = []
    for name in ARMS:
        model = ErrorModel.load(shipped_sheets()[name]).bare
        q = np.random.default_rng(0).uniform(-1.5, 1.5, (len(model.chain.joints), poses))
        models, x = list(model.at_columns(q)), model.space.sample(0, 0, 1)[:, 0]
        gap = max(float(np.abs(a - b).max()) for a, b in zip(one_by_one(models, x), at_once(models, x), strict=True))
        works = {
            "alone": Work(lambda models=models, x=x: one_by_one(models, x), poses),
            "together": Work(lambda models=models, x=x: at_once(models, x), poses),
        }
        seconds = best_times(works, turns)
        cells = (figure(1e6 * seconds[key] / poses) for key in ("alone", "together"))
        ratio = times(seconds["alone"] / seconds["together"])
        rows.append((name, str(model.space.size), *cells, ratio, f"{gap:.0e}"))
    columns = ("arm", "numbers", "one by one [µs]", "at once [µs]", "ratio", "difference")
    return Table(f"Errors and derivatives at {poses} poses, time a pose", columns, rows)


if __name__ == "__main__":
    print(measure().as_text())
