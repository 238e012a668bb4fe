"""Servos: SO-101 by an independent code, a stop simulated with two masses, and laws of an unknown direction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.model.compliance import compliances_of
from precision_pin.sources import Payload, Servo, Transmission
from support.checks.common import one_link

# identified stiffness and dry friction of the five joints, from base to wrist (a field report on SO-101)
STIFFNESS, FRICTION = (48.94, 51.34, 18.57, 43.03, 47.14), (0.215, 0.318, 0.402, 0.296, 0.283)

# (degrees, payload, μ, γ, known weights, statics, direction of all joints, error [d; δ])
CASES = [
    ((0, 0, 0, 0, 0), 0.0, 0, 0, 'all', 'nominal', 1,
     [0.000489750377381, 0.0015982756124, -0.0015243736483, 0.00599627042893, 0.00287958962102, 0.00438452504546]),
    ((0, 0, 0, 0, 0), 0.0, 0, 0, 'all', 'nominal', -1,
     [0.000944380424424, -0.00160025042899, -0.020430475384, -0.00584319247428, 0.0723206483079, -0.004174016158]),
    ((0, 0, 0, 0, 0), 0.3, 0, 0, 'all', 'equilibrium', 1,
     [0.00148771745905, 0.00160259998427, -0.0229316659311, 0.00581281399854, 0.0788495363622, 0.00415490014454]),
    ((0, 0, 0, 0, 0), 0.3, 0, 0, 'all', 'equilibrium', -1,
     [0.000636492182748, -0.00159892414935, -0.0415933796495, -0.00567740643425, 0.14770501257, -0.00394092207005]),
    ((0, 0, 0, 0, 0), 0.3, 0, 1.0, 'links', 'nominal', 1,
     [0.00101457258956, 0.00160052951492, -0.0119360452918, 0.00590127055402, 0.0412617599049, 0.00426898887737]),
    ((0, 0, 0, 0, 0), 0.3, 0, 1.0, 'links', 'equilibrium', -1,
     [0.000849678357823, -0.00159986903516, -0.0307566318388, -0.00576307755882, 0.110448552342, -0.00405653864789]),
    ((0, 90, -90, 0, 0), 0.3, 0.1, 0, 'all', 'nominal', 1,
     [-0.00195056266843, 0.00195902596029, -0.025344107783, 0.00581984657118, 0.0774004601518, 0.00415915714473]),
    ((0, 90, -90, 0, 0), 0.3, 0.1, 0, 'all', 'equilibrium', -1,
     [-0.00587605842087, -0.00194188942294, -0.052371126698, -0.00562590604958, 0.169966964363, -0.00387132578864]),
    ((0, 90, -90, 0, 0), 0.3, 0, 1.0, 'all', 'nominal', 1,
     [0.000148082140146, 0.0019682933266, 0.00998444575928, 0.00607926667687, -0.0347073486347, 0.00449684801517]),
    ((0, 90, -90, 0, 0), 0.3, 0, 1.0, 'all', 'equilibrium', -1,
     [-0.000455810850762, -0.00196562738929, -0.00995144391842, -0.00592426960169, 0.0346454721542, -0.00428871900249]),
    ((0.0, 76.0, -73.8, -5.0, 0.0), 0.3, 0.1, 0.8, 'links', 'nominal', 1,
     [-0.000273568777142, 0.001982765858, -0.0140532301176, 0.00589817949527, 0.0426655483161, 0.00455762187919]),
    ((0.0, 76.0, -73.8, -5.0, 0.0), 0.3, 0.1, 0.8, 'links', 'equilibrium', -1,
     [-0.00248882517628, -0.0019731241718, -0.0416439950449, -0.00571726578862, 0.136237587614, -0.0042703208928]),
]  # fmt: skip


def arm(payload=0.0, mu=0.0, share=0.0, known="all", statics="nominal"):
    chain = pp.Chain.from_urdf("example:so101", tip="gripper_frame_link", gravity=(0.0, 0.0, -9.81))
    servos = [
        Servo(joint=name, stiffness=k, friction=f, load_friction=mu, gravity_compensation=share, compensates=known)
        for name, k, f in zip(chain.joint_names, STIFFNESS, FRICTION, strict=True)
    ]
    load = [Payload(at="gripper_frame_link", mass=payload)] if payload else []
    return pp.ErrorModel(chain, pp.Space(), [*servos, *load], statics=statics)


@pytest.mark.parametrize(("q", "payload", "mu", "share", "known", "statics", "side", "error"), CASES)
def test_a_desktop_arm_by_an_independent_code(q, payload, mu, share, known, statics, side, error):
    model = arm(payload, mu, share, known, statics)
    at = model.at(np.radians(q), approach=dict.fromkeys(model.chain.joint_names, side))
    assert_allclose(at.error_at_means, error, rtol=0, atol=1e-9)


# |d| in mm where the directions are unknown: mean and standard deviation of 100,000 robots, each at its rest
def test_where_directions_are_unknown():
    q, mean, std = (0, 0, 0, 0, 0), 32.30539777389318, 3.833894224047146
    count, model = 100_000, arm(0.3, statics="equilibrium")
    errors = model.at(np.radians(q)).exact(model.space.sample(11, 0, count))
    sizes, standard_error = 1e3 * np.linalg.norm(errors[:3], axis=0), std * np.sqrt(2 / count)
    assert abs(sizes.mean() - mean) < 3 * standard_error
    assert abs(sizes.std() - std) < 3 * standard_error  # flatter than a normal law, whose error is std / sqrt(2 n)


def stop(stiffness, friction, load, speed, gear=400.0, motor=0.05, link=0.02, step=5e-5):
    """Return the angle of the link behind its command after a ramp, of two masses with dry friction at the motor.

    A proportional servo that damps the motor's speed, an elastic gear with damping, Karnopp's zone of rest.
    """
    damping = 2 * np.sqrt(stiffness * (motor + link))
    gear_damping = 2 * np.sqrt(gear * link)
    angle = velocity = link_angle = link_velocity = 0.0
    # the load is there while the arm is still at rest: begin where static equilibrium is
    angle, link_angle = load / stiffness, load / stiffness + load / gear
    end = 0.3 / abs(speed)
    for k in range(int((end + 1.5) / step)):
        time = k * step
        wanted = speed * min(time, end)
        twist = gear * (link_angle - angle) + gear_damping * (link_velocity - velocity)
        drive = stiffness * (wanted - angle) - damping * velocity + twist
        if abs(velocity) < 1e-4 and abs(drive) <= friction:
            velocity = 0.0
        else:
            velocity += step * (drive - friction * np.sign(velocity or drive)) / motor
        link_velocity += step * (load - twist) / link
        angle += step * velocity
        link_angle += step * link_velocity
    return link_angle - speed * end


@pytest.mark.parametrize(
    ("stiffness", "friction", "load", "speed"), [(50.0, 0.4, 0.0, 0.2), (50.0, 0.4, 1.5, 0.2), (50.0, 0.4, 1.5, -0.2)]
)
def test_a_stop_simulated_with_two_masses(stiffness, friction, load, speed):
    chain = one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0))
    sources = [
        Servo(joint="hinge", stiffness=stiffness, friction=friction),
        Transmission(joint="hinge", stiffness=400.0),
        pp.sources.Force(at="tool", moment=(0.0, load, 0.0)),
    ]
    at = pp.ErrorModel(chain, pp.Space(), sources).at([0.0], approach={"hinge": int(np.sign(speed))})
    # the zone of rest and the step of the simulation
    assert_allclose(at.error_at_means[4], stop(stiffness, friction, load, speed), rtol=0, atol=2e-4)


def test_a_law_of_one_joint_is_uniform_between_both_directions():
    chain = one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0))
    load = pp.sources.Force(at="tool", moment=(0.0, 1.5, 0.0))
    model = pp.ErrorModel(chain, pp.Space(), [Servo(joint="hinge", stiffness=50.0, friction=0.4), load])
    turned = model.at([0.0]).linear(model.space.sample(3, 0, 20000))[4]
    assert turned.min() >= 0.022
    assert turned.max() <= 0.038
    assert_allclose(turned.mean(), 0.030, atol=1e-4)
    assert_allclose(turned.std(), 0.004618802153517006, rtol=0.02)


def test_joints_and_visits_have_directions_of_their_own():
    model = arm()
    names = [draw.name for draw in model.space.draws]
    assert names == [f"approach[{name}]" for name in model.chain.joint_names]
    assert {draw.scope.value for draw in model.space.draws} == {"visit"}


def test_what_cannot_stand_beside_a_servo():
    chain = one_link(axis=(0, 1, 0))
    first, second = Servo(joint="hinge", stiffness=50.0), Servo(joint="hinge", stiffness=60.0)
    with pytest.raises(pp.InputError, match=r"servo\[hinge\]: two servos on the joint 'hinge'"):
        pp.ErrorModel(chain, pp.Space(), [first, second])
    gear, seen = Transmission(joint="hinge", stiffness=1e4), Servo(joint="hinge", stiffness=50.0, encoder="joint")
    pp.ErrorModel(chain, pp.Space(), [first, gear])
    with pytest.raises(pp.InputError, match=r"an encoder at the joint sees the errors of transmission\[hinge\]"):
        pp.ErrorModel(chain, pp.Space(), [seen, gear])


def test_friction_is_no_compliance():
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    model = pp.ErrorModel(chain, pp.Space(), [Servo(joint="hinge", stiffness=50.0, friction=0.4, load_friction=0.1)])
    for pose in ([0.0], pp.ApproachedPose([0.0], {"hinge": 1})):
        # 1 m from the hinge, across it
        assert_allclose(compliances_of(model, pose)["servo[hinge]"][2, 2], 1 / 50.0, rtol=1e-12)
