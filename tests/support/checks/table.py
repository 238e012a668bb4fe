"""Measured rows, by hand and against the displaced URDF."""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from support.checks.common import PLACES, SIX, evaluated, one_link, same, slanted_arm

PLANE = "y [mm], rz [mrad]\n1, 2\n-1, 0\n# a remark\n\n3, 1\n-3, -3\n"
ALL = "rz [deg],x [mm],ry [mrad],z [m],y [um],rx [rad]\n10,30,-400,0.02,-50000,0.3\n"


def check_table(module: ModuleType) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "plane.csv").write_text(PLANE, encoding="utf-8")
        (folder / "all.csv").write_text(ALL, encoding="utf-8")
        # at the hinge with the tip 1 m along x: y of the tip is y + 1 m · rz, row by row
        source = module.Table(joint="hinge", file=folder / "plane.csv")
        (draw,) = source.draws("table[hinge]")
        assert draw.components == ("table[hinge].row.y", "table[hinge].row.rz")
        assert draw.scope is Scope.UNIT
        same(draw.law.mean_vector, [0, 0], 1e-18)
        same(draw.law.covariance, [[5e-6, 3.5e-6], [3.5e-6, 3.5e-6]], 1e-17)
        model = ErrorModel(one_link(), Space(), [source])
        tips = model.at([0.0]).linear(model.space.sample(1, 0, 200))
        rows = np.unique(np.round(tips[[1, 5]] * 1e3, 9), axis=1)
        same(rows, [[-6, -1, 3, 4], [-3, 0, 2, 1]], 1e-9)
        same(tips[[0, 2, 3, 4]], 0.0, 1e-18)
        # every column, every place, any size
        arm = slanted_arm(12, prismatic=(4,))
        six = np.array([*SIX[:5], np.radians(10)])
        for where, kind, place in PLACES:
            at, _ = evaluated(arm.chain, arm.q, [module.Table(**where, file=folder / "all.csv")])
            same(at.space.mean, six[[5, 0, 4, 2, 1, 3]], 1e-15)
            same(at.exact(at.space.sample(3, 0, 1))[:, 0], arm.moved(kind, place, six), 1e-13)
