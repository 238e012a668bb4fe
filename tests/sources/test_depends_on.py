"""Every kind of source says truly what of a posture its terms depend on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.loads import Load
from precision_pin.sources import (
    AxisInstall,
    Backlash,
    Beam,
    BearingStiffness,
    Clearance,
    Covariance,
    Encoder,
    Frame,
    JointCompliance,
    JointOffset,
    Length,
    Levelling,
    Mcpc,
    Mounting,
    Payload,
    Table,
    Thermal,
    Transmission,
    catalogue,
)
from precision_pin.terms.source import Dependence, Source
from precision_pin.terms.term import JointValue, Term
from support.checks.common import one_link
from support.dependence import hidden_dependence
from support.plain_robot import chain_of, random_arm

TEXT = random_arm(51, prismatic=(4,))
ARMS = {"base to tool": chain_of(TEXT, tip="tool"), "tool to base": chain_of(TEXT, base="tool", tip="base")}
TOLERANCE = Uniform(1e-3)
PLAY = {"joint": "joint2", "diametral": (2e-5,), "span": 0.08}


def measured(folder) -> Table:
    (folder / "rows.csv").write_text("x [mm], rz [mrad]\n1, 2\n-1, 0\n", encoding="utf-8")
    return Table(joint="joint3", file=folder / "rows.csv")


SAYS: dict[str, list[tuple[Source, Dependence, bool]]] = {
    "axis_install": [(AxisInstall(joint="joint2", radius=1e-4, span=0.1), "chain", True)],
    "backlash": [(Backlash(joint="joint2", backlash=1e-3, band=0.1), "loads", False)],
    "beam": [
        (Beam(link="link3", EI=Uniform(1e3, mean=1e4)), "loads", False),
        (
            Beam(link="link3", section="rod", material="steel", diameter=Uniform(1e-4, mean=0.02),
                 self_weight="section"), "loads", False,
        ),
    ],
    "bearing_stiffness": [(BearingStiffness(joint="joint2", radial=1e7, tilt=1e4), "loads", False)],
    "clearance": [
        (Clearance(**PLAY, band=1.0), "loads", False),
        (Clearance(**PLAY, direction="random"), "configuration", True),
        (Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on="child"), "configuration", False),
        (Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on="parent"), "configuration", False),
    ],
    "covariance": [(Covariance(joint="joint2", std=(1e-4,) * 6), "chain", True)],
    "encoder": [
        (Encoder(joint="joint2", resolution=1e-4, offset=TOLERANCE), "chain", True),
        (Encoder(joint="joint2", amplitude=1e-4, order=2), "configuration", False),
        (Encoder(joint="joint2", eccentricity=1e-5, radius=0.05), "configuration", False),
        (Encoder(joint="joint2", offset=TOLERANCE, amplitude=1e-4, heads=2), "chain", True),
        (Encoder(joint="joint4", scale=1e-4), "configuration", False),
    ],
    "frame": [(Frame(link="link3", x=TOLERANCE, ry=1e-3), "chain", True)],
    "joint_compliance": [(JointCompliance(joint="joint2", compliance=1e-5), "loads", False)],
    "joint_offset": [(JointOffset(joint="joint2", offset=TOLERANCE), "chain", True)],
    "length": [
        (Length(joint="joint3", parameters=(TOLERANCE,)), "configuration", True),
        (Length(frame="half2", parameters=(TOLERANCE,)), "configuration", True),
        (Length(joint="joint3", along="x of joint2", parameters=(TOLERANCE,)), "configuration", True),
        (Length(joint="joint3", along="-axis of joint3", parameters=(TOLERANCE,)), "configuration", True),
        (Length(joint="joint3", along="x of joint6", parameters=(TOLERANCE,)), "configuration", False),
    ],
    "levelling": [(Levelling(rx=TOLERANCE), "chain", True)],
    "mcpc": [(Mcpc(link="link2", alpha=TOLERANCE, x=TOLERANCE), "chain", True)],
    "mounting": [(Mounting(at="base", z=TOLERANCE), "chain", True)],
    "payload": [(Payload(at="half2", mass=Uniform(0.1, mean=2.0), com=(0.1, TOLERANCE, 0.0)), "chain", True)],
    "thermal": [
        (Thermal(expansion=1.2e-5, temperature_change=Uniform(3.0)), "chain", True),
        (Thermal(link="link3", expansion=1.2e-5, gradient=5.0, across="z of joint3"), "configuration", True),
        (Thermal(link="link5", expansion=1.2e-5, gradient=5.0, across="z of joint2"), "configuration", False),
    ],
    "transmission": [
        (Transmission(joint="joint2", amplitude=(1e-4,), order=(2.0,)), "configuration", False),
        (Transmission(joint="joint4", lead_error=1e-4), "configuration", False),
        (Transmission(joint="joint2", stiffness=1e5), "loads", False),
    ],
}  # fmt: skip
CASES = [(kind, *case) for kind, cases in SAYS.items() for case in cases]


def test_every_kind_is_here():
    assert {*SAYS, "table"} == set(catalogue())


@pytest.mark.fast(9)
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(("kind", "source", "depends_on", "alike"), CASES)
def test_what_a_source_says_is_true(kind, source, depends_on, alike, arm):
    assert source.kind() == kind
    assert source.depends_on == depends_on
    assert hidden_dependence(source, ARMS[arm]) is None
    if arm == "base to tool" and not (kind == "clearance" and source.pads_on == "parent"):
        assert source.is_alike_everywhere(ARMS[arm]) is alike


@pytest.mark.parametrize(("kind", "source", "depends_on", "alike"), CASES)
def test_every_number_a_source_uses_has_a_quantity(kind, source, depends_on, alike):
    label = source.label()
    numbers = source.numbers(label)
    assert all(quantity is not None for quantity in numbers.values()), numbers
    assert {name for draw in source.draws(label) for name in draw.components} == set(numbers)


@pytest.mark.slow
def test_a_direction_of_the_base_link():
    for chain in ARMS.values():
        source = Length(joint="joint5", along=f"y of {chain.base}", parameters=(TOLERANCE,))
        assert hidden_dependence(source, chain) is None
        assert not source.is_alike_everywhere(chain)
    first = Length(joint="joint1", along="y of base", parameters=(TOLERANCE,))
    assert hidden_dependence(first, ARMS["base to tool"]) is None
    assert first.is_alike_everywhere(ARMS["base to tool"])


def test_what_measured_rows_say_is_true(tmp_path):
    source = measured(tmp_path)
    assert source.depends_on == "chain"
    assert all(hidden_dependence(source, chain) is None for chain in ARMS.values())


@pytest.mark.parametrize(
    ("pads_on", "base", "alike"),
    [("child", "base", False), ("parent", "base", True), ("child", "tool", True), ("parent", "tool", False)],
)
def test_pads_travel_with_the_link_that_does_not_carry_the_seat(pads_on, base, alike):
    source = Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on=pads_on)
    chain = next(chain for chain in ARMS.values() if chain.base == base)
    spread = {tuple(term.twist.tolist()) for slide in (-0.2, 0.3) for term in terms_at(source, chain, slide)}
    assert (len(spread) == len(terms_at(source, chain, 0.1))) is alike
    assert source.is_alike_everywhere(chain) is alike


def terms_at(source: Source, chain: Chain, slide: float) -> tuple[Term, ...]:
    q = np.where(chain.prismatic, slide, 0.0)
    return ErrorModel(chain, Space(), [source]).at(q).terms


@dataclass(frozen=True, kw_only=True)
class Liar(Source):
    """A source that says what it is told to say, and reads what it is told to read."""

    reads: str
    says: Dependence
    alike: bool = False

    @property
    def subject(self) -> str:
        return "arm"

    @property
    def depends_on(self) -> Dependence:
        return self.says

    def is_alike_everywhere(self, chain: Chain) -> bool:
        return self.alike

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        size = {
            "chain": float(posture.chain.axes[0, 0]),
            "q": float(posture.q[1]),
            "torque": sum(posture.torque_on(0).values()),
            "links": float(posture.loaded_link_poses[-1][0, 3]),
            "loads": 0.0,
        }[self.reads]
        yield Term.of(JointValue(0), size)

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        if self.reads == "loads":
            mass = 1.0 + float(posture.q[0])
            yield Load(1, np.eye(4), np.zeros(3), False, ((np.array([mass, 0, 0, 0]), ()),))


@pytest.mark.parametrize(
    ("reads", "says", "found"),
    [
        ("chain", "chain", None),
        ("q", "chain", "its terms depend on the configuration"),
        ("q", "configuration", None),
        ("torque", "chain", "its terms depend on the loads"),
        ("torque", "configuration", "its terms depend on the loads"),
        ("torque", "loads", None),
        ("links", "configuration", "its terms depend on the loads"),
        ("loads", "chain", "what it hangs on the chain depends on the configuration"),
    ],
)
def test_a_source_that_claims_too_little_is_caught(reads, says, found):
    assert hidden_dependence(Liar(reads=reads, says=says), ARMS["base to tool"]) == found


def test_a_source_that_claims_to_be_alike_everywhere_is_caught():
    liar = Liar(reads="q", says="configuration", alike=True)
    assert hidden_dependence(liar, ARMS["base to tool"]) == "its terms are not alike everywhere"


def test_anything_else_is_refused():
    with pytest.raises(InputError, match=r"depends_on of liar\[arm\] must be chain or configuration or loads"):
        ErrorModel(ARMS["base to tool"], Space(), [Liar(reads="q", says="weather")])


@final
@dataclass(frozen=True)
class Counted(Source):
    """A source that counts how often it is asked."""

    says: Dependence

    @property
    def subject(self) -> str:
        return "arm"

    @property
    def depends_on(self) -> Dependence:
        return self.says

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        _ASKED.append(self.says)
        yield Term.of(JointValue(0), 1e-3)


_ASKED: list[str] = []


def test_what_does_not_depend_on_the_posture_is_asked_for_once():
    for says, times in (("chain", 1), ("configuration", 5), ("loads", 5)):
        _ASKED.clear()
        model = ErrorModel(ARMS["base to tool"], Space(), [Counted(says)])
        for k in range(5):
            model.at(np.full(7, 0.1 * k))
        assert len(_ASKED) == times


@pytest.mark.parametrize("depth", [1, 14, 30])
def test_deep_formulas_come_to_rest_as_shallow_ones_do(depth):
    """The same stiffness, written with more and more operations, leaves the arm at the same place."""
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    space = Space((Draw("c", Uniform(1e-5, mean=1e-3)),))
    formula = Component("c") * 2.0**-depth
    for _ in range(depth):
        formula = formula + formula  # shared: 2^depth ways down
    models = [
        ErrorModel(chain, space, [JointCompliance(joint="hinge", compliance=c)], statics="equilibrium")
        for c in (Component("c"), formula)
    ]
    plain, deep = (model.at([0.2]).error_at_means for model in models)
    np.testing.assert_allclose(deep, plain, rtol=1e-12, atol=1e-15)


def test_formulas_with_shared_parts_are_compared_part_by_part():
    def doubled(leaf: str, depth: int) -> Component:
        formula = Component(leaf)
        for _ in range(depth):
            formula = formula + formula
        return formula

    assert doubled("a", 200) == doubled("a", 200)  # 2^200 ways down
    assert doubled("a", 200) != doubled("b", 200)
    assert doubled("a", 3) != doubled("a", 4)
    assert doubled("a", 3) != Component("a")
