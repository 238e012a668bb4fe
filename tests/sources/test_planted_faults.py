"""The checks of the sources notice a wrong sign and a wrong law planted in any of them."""

import pytest

from precision_pin.sources import catalogue
from support.checks import CHECKS
from support.mutants import Fault, original, planted

SIGNS = (
    Fault("axis_install", "both angles reversed", "slope = sign / self.span", "slope = -sign / self.span"),
    Fault("axis_install", "start counted the other way", '("A", 1 + crossing', '("A", 1 - crossing'),
    Fault("backlash", "against the load", "np.sign(torque) / 2", "-np.sign(torque) / 2"),
    Fault("beam", "θ_y of a force", "[0, 0, -(a**2) / 2, 0, a, 0]", "[0, 0, a**2 / 2, 0, a, 0]"),
    Fault("beam", "θ_y of the weight", "result[4, 2] = -(l**2) / 6", "result[4, 2] = l**2 / 6"),
    Fault("beam", "wrench turned the wrong way", "in_axes(base[:3, :3], axes", "in_axes(base[:3, :3].T, axes"),
    Fault("bearing_stiffness", "against the load", "Value = 1.0 / space", "Value = -1.0 / space"),
    Fault("clearance", "against each robot's load", "along_x / length, along_y", "-along_x / length, -along_y"),
    Fault("clearance", "loose where it is pressed", "1.0 - contact", "contact"),
    Fault("clearance", "against the load", "force = shift.T @ load", "force = -shift.T @ load"),
    Fault("places", "a minus is ignored", "-direction if sign < 0 else", "direction if sign < 0 else", "length"),
    Fault("places", "every error of a frame reversed", "np.eye(6)[row]", "-np.eye(6)[row]", "frame"),
    Fault("joint_compliance", "torque that holds the load", "(joint), torque,", "(joint), -torque,"),
    Fault("joint_offset", "offset reversed", "JointValue(joint), 1.0,", "JointValue(joint), -1.0,"),
    Fault("length", "direction turned the wrong way", "se3.turn(to_place, self", "-se3.turn(to_place, self"),
    Fault("mcpc", "γ turned the wrong way", "((0, 0, 1), gamma)", "((0, 0, 1), -gamma)"),
    Fault(
        "guide",
        "the slope turns the other way",
        "{1: np.eye(6)[5], 2: -np.eye(6)[4]}",
        "{1: -np.eye(6)[5], 2: np.eye(6)[4]}",
    ),
    Fault("guide", "phase counted the other way", "(cosine, -sine)", "(-cosine, sine)"),
    Fault("run_out", "turns the other way", "(cosine, -sine) if", "(cosine, sine) if"),
    Fault("servo", "friction helps", "Term.of(target, -direction", "Term.of(target, direction"),
    Fault("servo", "friction by load helps", "twist = -torque", "twist = torque"),
    Fault("force", "pulls back", "unit * value, ()", "-unit * value, ()"),
    Fault("strut", "a push pulls", '(-1.0, 0.0, space.positive("push"', '(1.0, 0.0, space.positive("push"'),
    Fault("payload", "weight pulls up", "moments[row] = np.prod", "moments[row] = -np.prod"),
    Fault("places", "tilt reversed", "[0, -slope], [slope, 0]", "[0, slope], [-slope, 0]", "clearance"),
    Fault("places", "a carriage travels back", "return height + (float(", "return height - (float(", "clearance"),
    Fault("covariance", "every error reversed", "np.eye(6)[row]", "-np.eye(6)[row]"),
    Fault("encoder", "zero reversed", '1.0, space.value("offset"', '-1.0, space.value("offset"'),
    Fault("levelling", "gravity turned with the base", "= -np.cross(axis", "= np.cross(axis"),
    Fault("places", "every error of a mounting reversed", "np.eye(6)[row]", "-np.eye(6)[row]", "mounting"),
    Fault("periodic", "phase counted the other way", "np.cos(angle)", "-np.cos(angle)", "encoder"),
    Fault("table", "every error reversed", "np.eye(6)[row]", "-np.eye(6)[row]"),
    Fault("thermal", "links shrink", "axes @ vector, np", "axes @ -vector, np"),
    Fault("thermal", "turned to the warm side", "-np.cross(vector", "np.cross(vector"),
    Fault(
        "transmission",
        "torque that holds the load",
        "torque, *factors, flexibilities",
        "-torque, *factors, flexibilities",
    ),
)

LAWS = (
    Fault("axis_install", "circle for disc", "laws import Disc", "laws import Circle as Disc"),
    Fault("places", "axis left as z", "block_diagonal(chain.axis_alignment(joint))", "np.eye(6)", "axis_install"),
    Fault("backlash", "the whole gap", "np.sign(torque) / 2", "np.sign(torque)"),
    Fault("backlash", "no band", "(np.abs(torque) >= self.band)", "(np.abs(torque) >= 0.0)"),
    Fault("beam", "stiffness for compliance", "flexibility = 1.0 / stiffness", "flexibility = 1.0 * stiffness"),
    Fault("beam", "weight as a tip load", "l**3 / 8", "l**3 / 3"),
    Fault("beam", "loads beyond counted twice", "if load.link > link]", "if load.link >= link]"),
    Fault("beam", "EI_y and EI_z swapped", '("EI_z", (1, 5), 1.0)', '("EI_z", (2, 4), 1.0)'),
    Fault("beam", "weight of a part as if of all", "(3 * l * second - third) / 6", "l**3 / 8"),
    Fault("beam", "what is bolted on goes along", "not load.along:", "load.stretch is None:"),
    Fault("beam", "axis not made normal", "axis - x * (x @ axis)", "axis"),
    Fault("bearing_stiffness", "stiffness for compliance", "Value = 1.0 / space", "Value = 1.0 * space"),
    Fault("bearing_stiffness", "axis left as z", "= seat_of(chain, joint)", "= chain.seat(joint), np.eye(6)"),
    Fault("clearance", "the whole clearance", "return play, 0.5", "return play, 1.0"),
    Fault("clearance", "A's clearance for B", "others[0] if others else size_a", "size_a"),
    Fault("clearance", "axis left as z", "= seat_of(chain, joint)", "= chain.seat(joint), np.eye(6)"),
    Fault("places", "base axes for a joint's", "posture.joint_poses[joint]", "posture.joint_poses[0]", "length"),
    Fault("places", "shift and turn of a frame swapped", '"x", "y", "z", "rx"', '"rx", "y", "z", "x"', "frame"),
    Fault("joint_compliance", "another joint's torque", "torque_on(joint)", "torque_on((joint - 1) % len(posture.q))"),
    Fault("force", "dead where it follows", 'self.axes != "base"', "False"),
    Fault("force", "point forgotten", "carrier.frame_at(self.point)", "carrier.frame_at((0.0, 0.0, 0.0))"),
    Fault("force", "direction in other axes", 'for axis in "xyz"', 'for axis in "zxy"'),
    Fault(
        "strut",
        "one end left out",
        "self._pull(posture.chain, space).loads",
        "self._pull(posture.chain, space).loads[1:]",
    ),
    Fault("strut", "the rate of the whole length", "_part(-1.0, 0.0, rate, length)", "_part(0.0, 0.0, rate, length)"),
    Fault("guide", "peak to valley as amplitude", "to_place[:, row] / 2", "to_place[:, row]"),
    Fault(
        "guide",
        "at the seat, before the slide",
        "return Place.start(joint + 1, ",
        "return chain.seat(joint), axes\n    return Place.start(joint + 1, ",
    ),
    Fault("guide", "Y and Z swapped", "np.array([x, y, z]).T", "np.array([x, z, y]).T"),
    Fault("guide", "axes of the seat", "following = np.roll(np.eye(3), -first - 1, axis=1)", "following = np.eye(3)"),
    Fault("guide", "one order for all", "self.order[k] / self", "self.order[0] / self"),
    Fault("run_out", "one order too many", "np.sin(self.order * posture", "np.sin((self.order + 1) * posture"),
    Fault("run_out", "height the other way", "wrench_at(self.at_height)", "wrench_at(-self.at_height)"),
    Fault("servo", "friction of the compensated torque", "coefficient != 0.0:", "False:"),
    Fault("servo", "random payload compensated", "at_means(commanded.torque_on(joint), space.space)", "0.0"),
    Fault(
        "servo",
        "compensation of forces",
        "replace(load, wrenches=()) for load in loads if load.moments",
        "load for load in loads",
    ),
    Fault("servo", "side of the load forgotten", "*approach, side, coefficient", "*approach, coefficient"),
    Fault("joint_offset", "half of it", "JointValue(joint), 1.0,", "JointValue(joint), 0.5,"),
    Fault(
        "length",
        "axes of the link before",
        "se3.turn(posture.link_poses[link][",
        "se3.turn(posture.link_poses[link - 1][",
    ),
    Fault("mcpc", "α and β swapped", '"alpha", 3, start), ("beta", 4,', '"alpha", 4, start), ("beta", 3,'),
    Fault("mcpc", "shift in frame axes before they tilt", 'of link {link}", after_gamma)', 'of link {link}", start)'),
    Fault("payload", "centre axes off by one", "_moment(k + 1, mass, value)", "_moment(3 - k, mass, value)"),
    Fault("places", "the link before counts", "load.link > joint", "load.link >= joint", "bearing_stiffness"),
    Fault("places", "loads not turned to the axis", "posture.chain.axis_alignment(joint)", "np.eye(3)", "clearance"),
    Fault("places", "another joint's seat", "index(self.joint))", "index(self.joint) + 1)", "frame"),
    Fault("covariance", "variances of deviations squared", "(self.std, self.std)", "(self.std, self.std) ** 2"),
    Fault("covariance", "correlation ignored", "self.correlation is None else", "True else"),
    Fault("encoder", "a whole step either way", "Uniform(step / 2)", "Uniform(step)"),
    Fault("encoder", "error not geared down", "amplitude / self.ratio, space", "amplitude, space"),
    Fault("encoder", "diameter for radius", "/ self.radius", "/ (2 * self.radius)"),
    Fault("levelling", "tilts about other axes", 'zip(np.eye(3), ("rx"', 'zip(np.eye(3)[[1, 0, 2]], ("rx"'),
    Fault("mounting", "the base's own end", "chain.frame_place(chain.base)", "chain.end(0)"),
    Fault("periodic", "a disc of phases", "laws import Circle", "laws import Disc as Circle", "transmission"),
    Fault("table", "shift and turn swapped", "np.eye(6)[row]", "np.eye(6)[(row + 3) % 6]"),
    Fault("table", "columns torn apart", "*columns, strict", "columns[0], *(c[::-1] for c in columns[1:]), strict"),
    Fault("thermal", "shift of a moment at the end", "(vector @ vector) / 2", "(vector @ vector) / 3"),
    Fault("thermal", "turned twice", "place.frame[:3, :3].T\n", "place.frame[:3, :3]\n"),
    Fault("transmission", "twice the compliance", "1.0 / space.positive(", "2.0 / space.positive("),
    Fault("transmission", "full width as half", "-0.5 * direction", "-1.0 * direction"),
    Fault("transmission", "limit of the signed torque", "-limit, side, beyond", "-limit, beyond"),
    Fault("transmission", "secant for pieces", "change = after - before", "change = 0.0 * after"),
    Fault("transmission", "one turn for a period", "2 * math.pi * value / self.period if", "value if"),
)


def test_every_kind_has_a_check_and_a_fault_of_either_sort():
    assert set(CHECKS) == set(catalogue())
    for faults in (SIGNS, LAWS):
        assert {fault.user or fault.module for fault in faults} == set(catalogue())


DEAR = ("beam", "clearance", "length", "payload", "thermal")


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind in DEAR)) for kind in CHECKS])
def test_the_checks_pass_on_copies_without_a_fault(kind):
    CHECKS[kind](original(kind))


@pytest.mark.slow
@pytest.mark.parametrize("fault", [*SIGNS, *LAWS], ids=lambda fault: f"{fault.module}: {fault.what}")
def test_a_planted_fault_is_noticed(fault):
    module = planted(fault)
    with pytest.raises(AssertionError):
        CHECKS[fault.user or fault.module](module)
