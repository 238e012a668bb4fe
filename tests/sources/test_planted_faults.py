"""The checks of the sources notice a wrong sign and a wrong law planted in any of them."""

from __future__ import annotations

import pytest

from precision_pin.sources import catalogue
from support.checks import CHECKS
from support.mutants import Fault, original, planted

SIGNS = (
    Fault("axis_install", "both angles reversed", "slope = sign / self.span", "slope = -sign / self.span"),
    Fault("axis_install", "one angle reversed", "[0, share, 0, -slope, 0, 0]", "[0, share, 0, slope, 0, 0]"),
    Fault("axis_install", "start counted the other way", '("A", 1 + crossing', '("A", 1 - crossing'),
    Fault("axis_install", "B's share reversed", '("B", -crossing, 1.0)', '("B", crossing, 1.0)'),
    Fault("backlash", "ahead of the drive", "-direction / 2", "direction / 2"),
    Fault("backlash", "friction with the motion", "0.0) - direction * share", "0.0) + direction * share"),
    Fault("backlash", "against the load", "np.sign(torque) / 2", "-np.sign(torque) / 2"),
    Fault("beam", "θ_y of a force", "[0, 0, -(a**2) / 2, 0, a, 0]", "[0, 0, a**2 / 2, 0, a, 0]"),
    Fault("beam", "θ_z of a force", "[0, a**2 / 2, 0, 0, 0, a]", "[0, -(a**2) / 2, 0, 0, 0, a]"),
    Fault("beam", "w_z of a moment", "0, -a * (2 * l - a) / 2, 0]", "0, a * (2 * l - a) / 2, 0]"),
    Fault("beam", "θ_y of the weight", "result[4, 2] = -(l**2) / 6", "result[4, 2] = l**2 / 6"),
    Fault("beam", "θ_z of the weight", "result[5, 1] = l**2 / 6", "result[5, 1] = -(l**2) / 6"),
    Fault("beam", "roll", "@ rotation_about((1, 0, 0), roll)", "@ rotation_about((1, 0, 0), -roll)"),
    Fault("beam", "wrench turned the wrong way", "in_axes(base[:3, :3], axes", "in_axes(base[:3, :3].T, axes"),
    Fault("bearing_stiffness", "against the load", "Value = 1.0 / space", "Value = -1.0 / space"),
    Fault("clearance", "against each robot's load", "along_x / length, along_y", "-along_x / length, -along_y"),
    Fault("clearance", "against each robot's axial load", "(above + below) * 0.5", "(above + below) * -0.5"),
    Fault("clearance", "loose where it is pressed", "1.0 - held", "held"),
    Fault("clearance", "against the load", "force = shift.T @ load", "force = -shift.T @ load"),
    Fault("clearance", "against the axial load", "along * np.sign(load[2])", "along * -np.sign(load[2])"),
    Fault("places", "a minus is ignored", "-direction if sign < 0 else", "direction if sign < 0 else", "length"),
    Fault("places", "every error of a frame reversed", "np.eye(6)[row]", "-np.eye(6)[row]", "frame"),
    Fault("joint_compliance", "torque that holds the load", "(joint), torque,", "(joint), -torque,"),
    Fault("joint_offset", "offset reversed", "JointValue(joint), 1.0,", "JointValue(joint), -1.0,"),
    Fault("length", "direction turned the wrong way", "se3.turn(back, direction)", "se3.turn(back, -direction)"),
    Fault("length", "frames turned the wrong way", "[:3, :3].swapaxes(0, 1)", "[:3, :3]"),
    Fault("places", "every error of MCPC reversed", "np.eye(6)[row]", "-np.eye(6)[row]", "mcpc"),
    Fault("mcpc", "β turned the wrong way", "nominal.beta[link])", "-nominal.beta[link] - 0.1)"),
    Fault("mcpc", "γ turned the wrong way", "((0, 0, 1), turn)", "((0, 0, 1), -turn)"),
    Fault("payload", "weight pulls up", "moments[row] = np.prod", "moments[row] = -np.prod"),
    Fault("places", "tilt reversed", "[0, -slope], [slope, 0]", "[0, slope], [-slope, 0]", "clearance"),
    Fault("places", "a carriage travels back", "joint] else 1.0)", "joint] else -1.0)", "clearance"),
    Fault("places", "the other bearing's share", "other / (other - height)", "other / (height - other)", "clearance"),
    Fault("places", "moment arm reversed", "= height, -height", "= -height, height", "bearing_stiffness"),
    Fault("covariance", "every error reversed", "np.eye(6)[row]", "-np.eye(6)[row]"),
    Fault("encoder", "zero reversed", '1.0, space.value("offset"', '-1.0, space.value("offset"'),
    Fault("encoder", "scale reversed", 'value, space.value("scale"', '-value, space.value("scale"'),
    Fault("levelling", "gravity turned with the base", "= -np.cross(axis", "= np.cross(axis"),
    Fault("places", "every error of a mounting reversed", "np.eye(6)[row]", "-np.eye(6)[row]", "mounting"),
    Fault("periodic", "phase counted the other way", "np.cos(angle)", "-np.cos(angle)", "encoder"),
    Fault("table", "every error reversed", "np.eye(6)[row]", "-np.eye(6)[row]"),
    Fault("thermal", "links shrink", "turn @ way, np", "turn @ -way, np"),
    Fault("thermal", "bent to the warm side", "[-normal *", "[normal *"),
    Fault("thermal", "turned to the warm side", "-np.cross(way", "np.cross(way"),
    Fault("transmission", "torque that holds the load", "JointValue(joint), torque,", "JointValue(joint), -torque,"),
    Fault("transmission", "lead reversed", "Term.of(JointValue(joint), value", "Term.of(JointValue(joint), -value"),
)

LAWS = (
    Fault("axis_install", "circle for disc", "laws import Disc", "laws import Circle as Disc"),
    Fault("axis_install", "diameter for radius", "(self.diameter or 0.0) / 2", "(self.diameter or 0.0)"),
    Fault("places", "axis left as z", "block_diagonal(chain.axis_alignment(joint))", "np.eye(6)", "axis_install"),
    Fault("axis_install", "A counts for nothing at the seat", '("A", 1 + crossing', '("A", crossing'),
    Fault("backlash", "the whole gap", "np.sign(torque) / 2", "np.sign(torque)"),
    Fault("backlash", "the whole gap at random", "0.5, gap, space", "1.0, gap, space"),
    Fault("backlash", "triangular for uniform", "laws import Uniform", "laws import Triangular as Uniform"),
    Fault("backlash", "no band", "if abs(torque) >= self.band", "if abs(torque) >= 0.0"),
    Fault("backlash", "another joint", "_on(joint), space", "_on((joint - 1) % len(posture.q)), space"),
    Fault("beam", "stiffness for compliance", "flexibility = 1.0 / stiffness", "flexibility = 1.0 * stiffness"),
    Fault("beam", "weight as a tip load", "l**3 / 8", "l**3 / 3"),
    Fault("beam", "weight's turn", "result[5, 1] = l**2 / 6", "result[5, 1] = l**2 / 2"),
    Fault("beam", "axial weight", "result[0, 0] = l / 2", "result[0, 0] = l"),
    Fault("beam", "w_y of a force", "[0, a**2 * (3 * l - a) / 6, 0, 0", "[0, a**3 / 3, 0, 0"),
    Fault("beam", "w_z of a force", "[0, 0, a**2 * (3 * l - a) / 6, 0", "[0, 0, a**3 / 3, 0"),
    Fault("beam", "torsion over the whole length", "[0, 0, 0, a, 0, 0]", "[0, 0, 0, l, 0, 0]"),
    Fault("beam", "loads beyond counted twice", "if load.link > link]", "if load.link >= link]"),
    Fault("beam", "loads of the middle at the tip", "axes[:, 0] @ load.attachment", "length"),
    Fault("beam", "lever beyond the end lost", "_lever(self.stop - reach).T", "np.eye(6)"),
    Fault("beam", "end stiffness without length", "(1, 2, 4, 5), length)", "(1, 2, 4, 5), 1.0)"),
    Fault("beam", "torsional stiffness without length", "(3,), length)", "(3,), 1.0)"),
    Fault("beam", "EI_y and EI_z swapped", '("EI_z", (1, 5), 1.0)', '("EI_z", (2, 4), 1.0)'),
    Fault("beam", "EI bends one way only", '("EI", (1, 2, 4, 5), 1.0)', '("EI", (1, 5), 1.0)'),
    Fault("beam", "left-handed axes", "np.cross(z, x), z]", "np.cross(x, z), z]"),
    Fault("beam", "weight of a part as if of all", "(3 * l * second - third) / 6", "l**3 / 8"),
    Fault("beam", "turn of a part's weight", "result[5, 1] = second / 2", "result[5, 1] = l**2 / 6"),
    Fault("beam", "axial weight of a part", "result[0, 0] = first", "result[0, 0] = l / 2"),
    Fault("beam", "what is bolted on goes along", "not load.along:", "load.stretch is None:"),
    Fault("beam", "what is bolted on is a point", "= min(reach - start, stop - reach)", "= 0.0"),
    Fault("beam", "axis not made normal", "axis - x * (x @ axis)", "axis"),
    Fault("beam", "next joint's axis not turned", "far_end[:3, :3] @ chain.written", "chain.written"),
    Fault("bearing_stiffness", "stiffness for compliance", "Value = 1.0 / space", "Value = 1.0 * space"),
    Fault("bearing_stiffness", "carries the free axis", '"tilt": (3, 4)', '"tilt": (3, 4, 5)'),
    Fault("bearing_stiffness", "radial for axial", '"radial": (0, 1)', '"radial": (0, 1, 2)'),
    Fault("bearing_stiffness", "shift at the centre", "to_centre.T @ carried", "carried"),
    Fault("bearing_stiffness", "moment about the origin", "@ to_centre @ wrench", "@ wrench"),
    Fault("bearing_stiffness", "axis left as z", "to_place = seat_axes(chain, joint)", "to_place = np.eye(6)"),
    Fault("clearance", "the whole clearance", "return play, 0.5", "return play, 1.0"),
    Fault("clearance", "disc for circle", 'self.law == "circle"', 'self.law != "circle"'),
    Fault("clearance", "A's clearance for B", "others[0] if others else size_a", "size_a"),
    Fault("clearance", "no band", ">= self.band", ">= 0.0"),
    Fault("clearance", "axis left as z", "to_place = seat_axes(chain, joint)", "to_place = np.eye(6)"),
    Fault("clearance", "one direction for both", 'component(f"{name}.{axis}")', 'component(f"A.{axis}")'),
    Fault("places", "the first joint's axis", "else posture.joint_axes[joint]", "else posture.joint_axes[0]", "length"),
    Fault("places", "base axes for a joint's", "posture.joint_poses[joint]", "posture.joint_poses[0]", "length"),
    Fault("places", "shift and turn of a frame swapped", '"x", "y", "z", "rx"', '"rx", "y", "z", "x"', "frame"),
    Fault("joint_compliance", "compliance squared", "*factors, compliance", "*factors, compliance, compliance"),
    Fault("joint_compliance", "another joint's torque", "torque_on(joint)", "torque_on((joint - 1) % len(posture.q))"),
    Fault("joint_offset", "half of it", "JointValue(joint), 1.0,", "JointValue(joint), 0.5,"),
    Fault("length", "along the link's start", "place.frame[:3, 3]", "place.frame[:3, 0]"),
    Fault("length", "axes of the link before", "posture.link_poses[link][", "posture.link_poses[link - 1]["),
    Fault("mcpc", "α and β swapped", '"alpha", 3, start), ("beta", 4,', '"alpha", 4, start), ("beta", 3,'),
    Fault("mcpc", "shift in frame axes before they tilt", 'of link {link}", after_gamma)', 'of link {link}", start)'),
    Fault("mcpc", "shift before γ", 'of link {link}", after_gamma)', 'of link {link}", after_beta)'),
    Fault("payload", "first moment without mass", "_moment(k + 1, mass, value)", "_moment(k + 1, value)"),
    Fault("payload", "centre axes off by one", "_moment(k + 1, mass, value)", "_moment(3 - k, mass, value)"),
    Fault("places", "the link before counts", "load.link > joint", "load.link >= joint", "bearing_stiffness"),
    Fault("places", "the next link left out", "load.link > joint", "load.link > joint + 1", "clearance"),
    Fault("places", "loads not turned to the axis", "posture.chain.axis_alignment(joint)", "np.eye(3)", "clearance"),
    Fault("places", "loads turned the wrong way", "(rotation @ axes).T", "(rotation @ axes)", "bearing_stiffness"),
    Fault("places", "fixed guides travel", 'pads_on == "parent"', 'pads_on == "child"', "bearing_stiffness"),
    Fault("places", "another joint's seat", "index(self.joint))", "index(self.joint) + 1)", "frame"),
    Fault("places", "another link's end", "(self.link).link)", "(self.link).link - 1)", "covariance"),
    Fault("covariance", "variances of deviations squared", "(self.std, self.std)", "(self.std, self.std) ** 2"),
    Fault("covariance", "correlation ignored", "self.correlation is None else", "True else"),
    Fault("covariance", "mean ignored", "self.mean or ()", "()"),
    Fault("encoder", "a whole step either way", "Uniform(step / 2)", "Uniform(step)"),
    Fault("encoder", "step not geared down", "self.resolution / self.ratio", "self.resolution"),
    Fault("encoder", "error not geared down", "amplitude / self.ratio, space", "amplitude, space"),
    Fault("encoder", "shaft as slow as the joint", "self.ratio * value", "value"),
    Fault("encoder", "order left out", "self.order * turn", "turn"),
    Fault("encoder", "two heads cancel the even orders", "self.order % 2 == 0", "self.order % 2 == 1"),
    Fault("encoder", "diameter for radius", "/ self.radius", "/ (2 * self.radius)"),
    Fault("levelling", "tilts about other axes", 'zip(np.eye(3), ("rx"', 'zip(np.eye(3)[[1, 0, 2]], ("rx"'),
    Fault("places", "shift and turn of a mounting swapped", '"x", "y", "z", "rx"', '"rx", "y", "z", "x"', "mounting"),
    Fault("mounting", "the base's own end", "chain.frame_place(chain.base)", "chain.end(0)"),
    Fault("mounting", "flange ignored", "self.flange or chain.tip)", "chain.tip)"),
    Fault("periodic", "a disc of phases", "laws import Circle", "laws import Disc as Circle", "transmission"),
    Fault("table", "shift and turn swapped", "np.eye(6)[row]", "np.eye(6)[(row + 3) % 6]"),
    Fault("table", "columns in another order", "(zip(*columns, strict=True))", "(zip(*columns[::-1], strict=True))"),
    Fault("table", "columns torn apart", "*columns, strict", "columns[0], *(c[::-1] for c in columns[1:]), strict"),
    Fault("thermal", "shift of a moment at the end", "(way @ way) / 2", "(way @ way) / 3"),
    Fault("thermal", "gradient along the link bends", "warmer.T - way *", "warmer.T - 0 *"),
    Fault("thermal", "base axes for the link's", "[:3, :3].swapaxes(0, 1)", "[:3, :3]"),
    Fault("thermal", "turned twice", "place.frame[:3, :3].T\n", "place.frame[:3, :3]\n"),
    Fault("transmission", "stiffness for compliance", "flexibility = 1.0 / ", "flexibility = 1.0 * "),
    Fault("transmission", "orders left out", "self.order[k] * turn", "turn"),
    Fault("transmission", "one turn for a period", "2 * math.pi * value / self.period if", "value if"),
    Fault("transmission", "one phase for all", 'space, entry_name("phase", k))', 'space, "phase")'),
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
