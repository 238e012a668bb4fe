"""Every kind of source says truly what of a posture its terms depend on."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from precision_pin import Chain, ErrorModel, InputError, Posture, Source, Space, Term, Uniform, sources
from precision_pin.draws.expressions import Component
from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.places import Load
from precision_pin.sources.strut import StrutEnd
from precision_pin.terms.source import Dependence
from precision_pin.terms.term import JointValue
from support.dependence import hidden_dependence
from support.plain_robot import chain_of, random_arm

TEXT = random_arm(51, prismatic=(4,))
ARMS = {"base to tool": chain_of(TEXT, tip="tool"), "tool to base": chain_of(TEXT, base="tool", tip="base")}
TOLERANCE = Uniform(1e-3)
DIAMETER = Uniform(1e-4, mean=0.02)
LOAD = Uniform(9.0, mean=300.0)
PLAY = {"joint": "joint2", "diametral": (2e-5,), "span": 0.08}


def measured(folder) -> sources.Table:
    (folder / "rows.csv").write_text("x [mm], rz [mrad]\n1, 2\n-1, 0\n", encoding="utf-8")
    return sources.Table(joint="joint3", file=folder / "rows.csv")


SOURCES: list[tuple[Source, Dependence, bool]] = [
    (sources.AxisInstall(joint="joint2", radius=1e-4, span=0.1), "chain", True),
    (sources.Backlash(joint="joint2", backlash=1e-3, band=0.1), "loads", False),
    (sources.Beam(link="link3", EI=Uniform(1e3, mean=1e4)), "loads", False),
    (sources.Beam(link="link3", section="rod", material="steel", diameter=DIAMETER, self_weight="section"), "loads", False),
    (sources.BearingStiffness(joint="joint2", radial=1e7, tilt=1e4), "loads", False),
    (sources.Clearance(**PLAY, band=1.0), "loads", False),
    (sources.Clearance(**PLAY, direction="random"), "configuration", True),
    (sources.Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on="child"), "configuration", False),
    (sources.Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on="parent"), "configuration", False),
    (sources.Covariance(joint="joint2", std=(1e-4,) * 6), "chain", True),
    (sources.Encoder(joint="joint2", resolution=1e-4, offset=TOLERANCE), "chain", True),
    (sources.Encoder(joint="joint2", amplitude=1e-4, order=2), "configuration", False),
    (sources.Encoder(joint="joint2", eccentricity=1e-5, radius=0.05), "configuration", False),
    (sources.Encoder(joint="joint2", offset=TOLERANCE, amplitude=1e-4, heads=2), "chain", True),
    (sources.Encoder(joint="joint4", scale=1e-4), "configuration", False),
    (sources.Force(at="half2", force=(5.0, TOLERANCE, 0.0), axes="link"), "chain", True),
    (sources.Frame(link="link3", x=TOLERANCE, ry=1e-3), "chain", True),
    (sources.Guide(joint="joint4", EYX=(1e-5, 1e-6), EAX=(1e-4, 1e-5), order=(1.0, 2.0), length=0.7), "configuration", False),
    (sources.JointCompliance(joint="joint2", compliance=1e-5), "loads", False),
    (sources.JointOffset(joint="joint2", offset=TOLERANCE), "chain", True),
    (sources.Length(joint="joint3", parameters=(TOLERANCE,)), "configuration", True),
    (sources.Length(frame="half2", parameters=(TOLERANCE,)), "configuration", True),
    (sources.Length(joint="joint3", along="x of joint2", parameters=(TOLERANCE,)), "configuration", True),
    (sources.Length(joint="joint3", along="-axis of joint3", parameters=(TOLERANCE,)), "configuration", True),
    (sources.Length(joint="joint3", along="x of joint6", parameters=(TOLERANCE,)), "configuration", False),
    (sources.Levelling(rx=TOLERANCE), "chain", True),
    (sources.Mcpc(link="link2", alpha=TOLERANCE, x=TOLERANCE), "chain", True),
    (sources.Mounting(at="base", z=TOLERANCE), "chain", True),
    (sources.Payload(at="half2", mass=Uniform(0.1, mean=2.0), com=(0.1, TOLERANCE, 0.0)), "chain", True),
    (sources.RunOut(joint="joint2", radial=1e-5, tilt=1e-5, order=2), "configuration", False),
    (sources.Servo(joint="joint2", stiffness=1e5, friction=2.0), "loads", False),
    (sources.Strut(from_=StrutEnd(link="base"), to=StrutEnd(link="half2"), push=LOAD), "configuration", True),
    (sources.Thermal(expansion=1.2e-5, temperature_change=Uniform(3.0)), "chain", True),
    (sources.Thermal(link="link3", expansion=1.2e-5, gradient=5.0, across="z of joint3"), "configuration", True),
    (sources.Thermal(link="link5", expansion=1.2e-5, gradient=5.0, across="z of joint2"), "configuration", False),
    (sources.Transmission(joint="joint2", amplitude=(1e-4,), order=(2.0,)), "configuration", False),
    (sources.Transmission(joint="joint4", lead_error=1e-4), "configuration", False),
    (sources.Transmission(joint="joint2", stiffness=1e5), "loads", False),
]  # fmt: skip
CASES = [(source.kind(), source, *says) for source, *says in SOURCES]


def test_every_kind_is_here():
    assert {*(kind for kind, *_ in CASES), "table"} == set(sources.catalogue())


@pytest.mark.fast(9)
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(("kind", "source", "depends_on", "alike"), CASES)
def test_what_a_source_says_is_true(kind, source, depends_on, alike, arm):
    assert source.depends_on == depends_on
    assert hidden_dependence(source, ARMS[arm]) is None
    if arm == "base to tool" and not (kind == "clearance" and source.pads_on == "parent"):
        assert source.is_alike_everywhere(ARMS[arm]) is alike


def test_every_number_a_source_uses_has_a_quantity():
    for _, source, *_ in CASES:
        numbers = source.numbers(source.label())
        assert all(quantity is not None for quantity in numbers.values()), numbers
        assert {name for draw in source.draws(source.label()) for name in draw.components} == set(numbers)


@pytest.mark.slow
def test_a_direction_of_the_base_link():
    for arm, joint in (("base to tool", "joint5"), ("tool to base", "joint5"), ("base to tool", "joint1")):
        source = sources.Length(joint=joint, along=f"y of {ARMS[arm].base}", parameters=(TOLERANCE,))
        assert hidden_dependence(source, ARMS[arm]) is None
        assert source.is_alike_everywhere(ARMS[arm]) is (joint == "joint1")


def test_what_measured_rows_say_is_true(tmp_path):
    source = measured(tmp_path)
    assert source.depends_on == "chain"
    assert all(hidden_dependence(source, chain) is None for chain in ARMS.values())


@pytest.mark.parametrize(
    ("pads_on", "base", "alike"),
    [("child", "base", False), ("parent", "base", True), ("child", "tool", False), ("parent", "tool", True)],
)
def test_pads_on_the_child_link_travel_along_the_seat_which_is_on_the_parent_link(pads_on, base, alike):
    source = sources.Clearance(**PLAY | {"joint": "joint4"}, direction="random", pads_on=pads_on)
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
    ("reads", "says", "alike", "found"),
    [
        ("chain", "chain", False, None),
        ("q", "chain", False, "its terms depend on the configuration"),
        ("q", "configuration", False, None),
        ("q", "configuration", True, "its terms are not alike everywhere"),
        ("torque", "chain", False, "its terms depend on the loads"),
        ("torque", "configuration", False, "its terms depend on the loads"),
        ("torque", "loads", False, None),
        ("links", "configuration", False, "its terms depend on the loads"),
        ("loads", "chain", False, "what it hangs on the chain depends on the configuration"),
    ],
)
def test_a_source_that_claims_too_little_is_caught(reads, says, alike, found):
    assert hidden_dependence(Liar(reads=reads, says=says, alike=alike), ARMS["base to tool"]) == found


def test_anything_else_is_refused():
    with pytest.raises(InputError, match=r"depends_on of liar\[arm\] must be chain or configuration or loads"):
        ErrorModel(ARMS["base to tool"], Space(), [Liar(reads="q", says="weather")])


def test_what_does_not_depend_on_the_posture_is_asked_for_once(monkeypatch):
    asked = []
    told = Liar.terms
    monkeypatch.setattr(Liar, "terms", lambda self, *view: asked.append(self) or told(self, *view))
    for says, times in (("chain", 1), ("configuration", 5), ("loads", 5)):
        asked.clear()
        model = ErrorModel(ARMS["base to tool"], Space(), [Liar(reads="loads", says=says)])
        for k in range(5):
            model.at(np.full(7, 0.1 * k))
        assert len(asked) == times


def test_formulas_with_shared_parts_are_compared_part_by_part():
    """Written out, they would have 2^200 leaves."""

    def doubled(leaf: str, depth: int) -> Component:
        return functools.reduce(lambda formula, _: formula + formula, range(depth), Component(leaf))

    assert doubled("a", 200) == doubled("a", 200)
    assert doubled("a", 200) != doubled("b", 200)
    assert doubled("a", 3) != doubled("a", 4)
    assert doubled("a", 3) != Component("a")
