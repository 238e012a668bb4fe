"""Sheets made at random from every kind of source, law, correlation and table; as data, all scalars text."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["FILES", "ROBOTS", "random_sheet", "write_files"]

Data = dict[str, Any]

SHIPPED = Path(__file__).parents[2] / "src" / "precision_pin" / "robots"
ROBOTS = {
    "4dof.urdf": ("joint1", "joint2", "joint3", "joint4"),
    "slides.urdf": ("lift", "swing", "reach"),
}
LINKS = {"4dof.urdf": ("link1", "link2", "link3"), "slides.urdf": ("post", "beam", "arm")}
SLIDING = {"lift", "reach"}
TIPS = {"4dof.urdf": "tool", "slides.urdf": "hand"}

_SLIDES = """<robot name="slides">
  <link name="floor"/>
  <link name="post"><inertial><origin xyz="0 0 0.2"/><mass value="3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="beam"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hand"/>
  <joint name="lift" type="prismatic"><parent link="floor"/><child link="post"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="swing" type="revolute"><parent link="post"/><child link="beam"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="reach" type="prismatic"><parent link="beam"/><child link="arm"/><origin xyz="0.5 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="grip" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="0.1 0 0.02"/></joint>
</robot>
"""
FILES = {
    "six.csv": "x [mm], y [mm], rz [mrad]\n0.01, 0.02, 0.1\n-0.02, 0.01, -0.2\n0.03, -0.04, 0.05\n",
    "gauge.csv": "# measured\ngap [mm]\n0.1\n0.12\n0.09\n0.15\n",
    "shares.csv": "p, gap [mm]\n0, -0.1\n0.5, 0\n1, 0.2\n",
    "slides.urdf": _SLIDES,
}


def write_files(folder: Path) -> None:
    """Put the robots and tables that the sheets name into a folder."""
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "4dof.urdf").write_bytes((SHIPPED / "4dof.urdf").read_bytes())


def random_sheet(generator: random.Random) -> Data:
    """Return a sheet that should be without error."""
    return _Maker(generator).sheet()


class _Maker:
    def __init__(self, generator: random.Random) -> None:
        self.random = generator
        self.robot = generator.choice(list(ROBOTS))
        self.joints, self.links = ROBOTS[self.robot], LINKS[self.robot]
        self.lengths: list[str] = []
        self.angles: list[str] = []

    def sheet(self) -> Data:
        chance = self.random.random
        data: Data = {"precision-pin": "1", "robot": self.robot}
        if chance() < 0.5:
            data["tip"] = TIPS[self.robot]
        if chance() < 0.3:
            data["gravity"] = self.random.choice(["earth", "moon", "none", "0 0 -9.81 m/s^2", "1 2 -9 m/s^2"])
        if chance() < 0.3:
            data["statics"] = self.random.choice(["nominal", "equilibrium"])
        data["poses"] = {
            f"pose{k}": self._approached(self._pose(), first=k == 0) for k in range(self.random.randint(1, 3))
        }
        data["parameters"] = self._parameters()
        single = [
            name for name, law in data["parameters"].items() if not {"fixed", "scope"} & set(law) and name[0] in "al"
        ]
        if len(single) > 2 and chance() < 0.6:
            data["correlations"] = [self._correlation(single)]
        makers: list[Callable[[], Data]] = [
            self._offset, self._length, self._axis, self._beam, self._compliance, self._backlash, self._bearing,
            self._clearance, self._covariance, self._encoder, self._frame, self._levelling, self._mcpc, self._mounting,
            self._payload, self._table, self._thermal, self._transmission,
        ]  # fmt: skip
        data["sources"] = [make() for make in self.random.choices(makers, k=self.random.randint(1, 5))]
        return data

    def _number(self, most: float = 1.0) -> str:
        return f"{self.random.uniform(0.01, most):.{self.random.randint(1, 4)}g}"

    def _length_text(self) -> str:
        return f"{self._number()} {self.random.choice(['mm', 'um', 'mm', 'in'])}"

    def _angle_text(self) -> str:
        return f"{self._number()} {self.random.choice(['mrad', 'deg', 'arcmin', 'arcsec', 'mrad'])}"

    def _pose(self) -> Any:
        values = [
            f"{self.random.uniform(0.1, 0.8):.3f} m" if joint in SLIDING else f"{self.random.uniform(-80, 80):.2f} deg"
            for joint in self.joints
        ]
        if not SLIDING & set(self.joints) and self.random.random() < 0.4:
            return " ".join(value.split()[0] for value in values) + " deg"
        return values if self.random.random() < 0.5 else dict(zip(self.joints, values, strict=True))

    def _approached(self, pose: Any, *, first: bool) -> Any:
        if self.random.random() < 0.7:
            return pose
        signs = {joint: self.random.choice(["+", "-", "0"]) for joint in self.joints if self.random.random() < 0.8}
        text = ", ".join(f"{joint} {sign}" for joint, sign in signs.items())
        ways: list[Any] = [signs, *([text] if text else []), *([] if first else ["previous"])]
        return {"q": pose, "approach": self.random.choice(ways)}

    def _parameters(self) -> Data:
        found: Data = {}
        for k in range(self.random.randint(0, 5)):
            if self.random.random() < 0.5:
                self.lengths.append(f"l{k}")
                found[f"l{k}"] = self._law(self._length_text)
            else:
                self.angles.append(f"a{k}")
                found[f"a{k}"] = self._law(self._angle_text)
        if self.random.random() < 0.3:
            self.lengths += ["d0.x", "d0.y"]
            found["d0"] = {self.random.choice(["disc", "circle", "sphere"]): self._length_text()}
        if self.random.random() < 0.3:
            self.lengths += ["j0.0", "j0.1"]
            found["j0"] = {"joint_normal": {"std": [self._length_text(), self._length_text()]}}
            if self.random.random() < 0.5:
                found["j0"]["correlation"] = [["1", "0.3"], ["0.3", "1"]]
        if self.random.random() < 0.2:
            self.lengths += ["r0.0"]
            found["r0"] = {"rows": {"file": "gauge.csv", "columns": ["gap"]}}
        return found

    def _law(self, text: Callable[[], str], *, mean: str | None = None) -> Data:
        """Return a law of one number."""
        kind = self.random.choice(
            [
                "uniform",
                "normal",
                "std",
                "truncated",
                "triangular",
                "arcsine",
                "two_point",
                "samples",
                "quantiles",
                "fixed",
            ]
            + (["lognormal"] * (mean is not None))
        )
        wide = text()
        unit = wide.split()[1]
        law: Data
        match kind:
            case "std":
                law = {"normal": {"std": wide}}
            case "truncated":
                law = {"normal": wide, "truncated": "true", "k": self.random.choice(["2", "3", "2.5"])}
            case "two_point":
                law = {"two_point": wide, "probability": self.random.choice(["0.5", "30 %", "0.7"])}
            case "samples":
                law = {"empirical": {"samples": f"{self._number()} {self._number()} {self._number()} {unit}"}}
            case "quantiles":
                law = {"empirical": {"quantiles": [["0", f"-{wide}"], ["0.5", f"0 {unit}"], ["1", wide]]}}
            case "lognormal":
                law = {"lognormal": {"std": wide}}
            case _:
                law = {kind: wide}
        if mean is not None and kind not in ("two_point", "samples", "quantiles", "fixed"):
            law["mean"] = mean
        if self.random.random() < 0.15:
            law["scope"] = self.random.choice(["unit", "pose", "visit"])
        return law

    def _setting(self, text: Callable[[], str], names: list[str]) -> Any:
        chance = self.random.random()
        if chance < 0.3 and names:
            return self.random.choice(names)
        return text() if chance < 0.5 else self._law(text)

    def _about(self, joint: str) -> Any:
        return (
            self._setting(self._length_text, self.lengths)
            if joint in SLIDING
            else self._setting(self._angle_text, self.angles)
        )

    def _far(self, mean: float, unit: str) -> Any:
        """Return a setting that stays positive."""
        if self.random.random() < 0.4:
            return f"{mean:g} {unit}"
        return {self.random.choice(["uniform", "triangular"]): f"{0.1 * mean:g} {unit}", "mean": f"{mean:g} {unit}"}

    def _joint(self) -> str:
        return self.random.choice(self.joints)

    def _correlation(self, names: list[str]) -> Data:
        chosen = self.random.sample(names, self.random.randint(2, min(3, len(names))))
        if len(chosen) == 2:
            return {"parameters": chosen, "correlation": f"{self.random.uniform(-0.9, 0.9):.3f}"}
        value = f"{self.random.uniform(-0.4, 0.9):.2f}"
        return {"parameters": chosen, "matrix": [["1" if i == k else value for k in range(3)] for i in range(3)]}

    # sources

    def _offset(self) -> Data:
        joint = self._joint()
        return {"joint_offset": {"joint": joint, "offset": self._about(joint)}}

    def _length(self) -> Data:
        entries = [self._setting(self._length_text, self.lengths) for _ in range(self.random.randint(1, 3))]
        along = self.random.choice(["x", "-z", "y", "axis"]) + f" of {self._joint()}"
        return {"length": {"joint": self._joint(), "along": along, "parameters": entries}}

    def _axis(self) -> Data:
        size = {self.random.choice(["radius", "diameter"]): self._length_text()}
        return {"axis_install": {"joint": self._joint(), **size, "span": f"{self._number(200)} mm"}}

    def _beam(self) -> Data:
        rigid = self.random.choice(
            [
                {"EI": self._far(8000, "N*m^2"), "GI": self._far(4000, "N*m^2")},
                {"section": "tube", "material": "steel", "outer_diameter": "80 mm", "wall": self._far(5, "mm")},
                {"bending_stiffness": self._far(1e6, "N*m/rad"), "torsion_stiffness": "1e6 N*m/rad"},
            ]
        )
        # where a carriage travels on the link, its stiffnesses would change with its length
        is_rail = "bending_stiffness" in rigid and self.links[1] == "beam"
        return {"beam": {"link": self.links[0 if is_rail else 1], **rigid}}

    def _compliance(self) -> Data:
        joint = self._joint()
        unit = "m/N" if joint in SLIDING else "rad/(N*m)"
        return {"joint_compliance": {"joint": joint, "compliance": self._far(1e-6, unit)}}

    def _backlash(self) -> Data:
        joint = self._joint()
        sizes, band = ("0.1 mm", "1 N") if joint in SLIDING else ("0.3 mrad", "0.5 N*m")
        return {"backlash": {"joint": joint, "backlash": sizes, "band": band, "scope": "pose"}}

    def _bearing(self) -> Data:
        joint = self._joint()
        return {
            "bearing_stiffness": {"joint": joint, "radial": self._far(1e8, "N/m"), "tilt": self._far(1e5, "N*m/rad")}
        }

    def _clearance(self) -> Data:
        direction = self.random.choice(["load", "random"])
        return {
            "clearance": {
                "joint": self._joint(), "diametral": [self._far(0.02, "mm")], "span": "80 mm", "direction": direction,
                **({"band": "1 N"} if direction == "load" else {}),
            }
        }  # fmt: skip

    def _covariance(self) -> Data:
        entries = ["0.1 mm", "0.2 mm", "0.1 mm", "1 mrad", "2 mrad", "1 mrad"]
        return {"covariance": {"joint": self._joint(), "std": entries}}

    def _encoder(self) -> Data:
        joint = self._joint()
        step = "10 um" if joint in SLIDING else "20 arcsec"
        return {"encoder": {"joint": joint, "resolution": step, "scope": self.random.choice(["pose", "visit"])}}

    def _six(self) -> Data:
        found: Data = {}
        for name in self.random.sample(["x", "y", "z", "rx", "ry", "rz"], self.random.randint(1, 4)):
            angle = name.startswith("r")
            found[name] = self._setting(
                self._angle_text if angle else self._length_text, self.angles if angle else self.lengths
            )
        return found

    def _frame(self) -> Data:
        return {"frame": {"joint": self._joint(), **self._six()}}

    def _levelling(self) -> Data:
        return {"levelling": {"rx": self._setting(self._angle_text, self.angles), "ry": self._angle_text()}}

    def _mcpc(self) -> Data:
        entries = {"alpha": self._angle_text(), "x": self._setting(self._length_text, self.lengths)}
        return {"mcpc": {"link": self.links[1], **entries}}

    def _mounting(self) -> Data:
        return {"mounting": {"at": self.random.choice(["base", "tool"]), **self._six()}}

    def _payload(self) -> Data:
        com = [self._length_text() for _ in range(3)]
        return {"payload": {"at": TIPS[self.robot], "mass": self._far(2, "kg"), "com": com}}

    def _table(self) -> Data:
        return {"table": {"joint": self._joint(), "file": "six.csv"}}

    def _thermal(self) -> Data:
        change = self._setting(lambda: f"{self._number(10)} K", [])
        return {"thermal": {"link": self.links[1], "expansion": "12e-6 1/K", "temperature_change": change}}

    def _transmission(self) -> Data:
        joint = self._joint()
        if joint in SLIDING:
            return {"transmission": {"joint": joint, "amplitude": ["5 um"], "order": ["1"], "period": "10 mm"}}
        return {"transmission": {"joint": joint, "amplitude": ["10 arcsec"], "order": ["2"]}}
