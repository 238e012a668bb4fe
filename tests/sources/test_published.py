"""Published gears and servos: what stands beside the figures where they are printed, what overrides them, wrong names."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.base.errors import SheetError
from precision_pin.sources import Servo, Transmission
from precision_pin.sources.published import published
from sources.test_gears import turned
from support.engines import written

# wind-up in 1e-4 rad at T1 and at T2, as the manual prints it beside K1 to K3
PRINTED = {
    "RSF-8B-30": (8.5, 19), "RSF-8B-50": (6.6, 13), "RSF-8B-100": (3.2, 8),
    "RSF-11B-30": (9.5, 19), "RSF-11B-50": (3.6, 8), "RSF-11B-100": (3.0, 6),
    "RSF-14B-30": (10.5, 31), "RSF-14B-50": (5.8, 16),
    "HFUC-32-100": (29 / 6.7, None),
}  # fmt: skip

# kt, R, P gain, error gain, supply: files of Rhoban/bam
BENCH = {
    "sts3215": (1.21164135295077, 2.6761663274455603, 32, 0.166, 7.4),
    "sts3215-12v": (1.443985897804671, 2.0295624974250366, 32, 0.166 * 0.9754522802666795, 12.0),
    "mx-64": (1.6224667906987444, 3.949433673232461, 32, 0.158, 15.0),
    "mx-106": (2.1913757006745245, 2.9649903987776804, 32, 0.158, 15.0),
    "xl-320": (0.9869471336819953, 35.609097347319235, 32, 0.05048199, 7.5),
}


def test_every_published_gear_and_servo_makes_a_source():
    for key, kind in (("gear", Transmission), ("servo", Servo)):
        for name, entry in published(key).items():
            source = kind(joint="hinge", **{key: name})
            assert all(getattr(source, setting) not in (None, ()) for setting in entry.settings)
            assert ("maker's figure" in entry.document) is (key == "gear")


@pytest.mark.parametrize("name", PRINTED)
def test_wind_up_at_the_limits_is_what_the_maker_prints(name):
    gear = Transmission(joint="hinge", gear=name)
    for torque, printed in zip(gear.limit_torques, PRINTED[name], strict=True):
        if printed is not None:
            # the manual rounds or cuts, to a tenth at T1 and to whole numbers at T2
            coarse = 0.1 if torque == gear.limit_torques[0] else 1.0
            assert abs(1e4 * turned(gear, torque).error_at_means[4] - printed) < coarse, name
    assert list(gear.stiffness) == sorted(gear.stiffness)


@pytest.mark.parametrize("name", BENCH)
def test_stiffness_of_a_servo_on_a_bench(name):
    kt, resistance, gain, error_gain, supply = BENCH[name]
    assert_allclose(Servo(joint="hinge", servo=name).stiffness, gain * error_gain * supply * kt / resistance, rtol=2e-3)


def test_what_stands_beside_a_name_overrides_it():
    named = Transmission(joint="hinge", gear="HFUC-32-100")
    assert (named.stiffness, named.limit_torques) == ((67e3, 110e3, 120e3), (29.0, 108.0))
    factor = Transmission(joint="hinge", gear="HFUC-32-100", stiffness_factor=pp.Uniform(0.2))
    assert factor.stiffness == named.stiffness
    # one number replaces the whole curve
    assert Transmission(joint="hinge", gear="HFUC-32-100", stiffness=5e4).limit_torques == ()
    weak = Servo(joint="hinge", servo="sts3215", stiffness=pp.Normal(1.0, mean=15.0))
    assert (weak.stiffness, weak.friction) == (pp.Normal(1.0, mean=15.0), 0.052)
    free = Servo(joint="hinge", servo="sts3215", friction=0.0)
    assert (free.stiffness, free.has_friction) == (17.8, False)


def test_a_sheet_names_them(tmp_path):
    sources = """
payload: {at: tool, mass: 1 kg}
transmission: {joint: joint2, gear: HFUC-32-100, stiffness_factor: {uniform: 10 %}}
servo: {joint: joint3, servo: so101-elbow_flex, load_friction: 5 %}
"""
    numbers = sources.replace("gear: HFUC-32-100", "stiffness: 67 110 120 kN*m/rad, limit_torques: 29 108 N*m")
    numbers = numbers.replace("servo: so101-elbow_flex", "stiffness: 18.57 N*m/rad, friction: 0.402 N*m")
    named, plain = (pp.ErrorModel.load(written(tmp_path, text)) for text in (sources, numbers))
    x = plain.space.sample(1, 0, 50)
    assert named.space.components == plain.space.components
    assert np.array_equal(named.at("here").exact(x), plain.at("here").exact(x))
    with pytest.raises(SheetError, match="no published gear named 'HFUC-32-10'; did you mean 'HFUC-32-100'") as told:
        pp.ErrorModel.load(written(tmp_path, sources.replace("32-100", "32-10")))
    assert len(told.value.findings) == 1
