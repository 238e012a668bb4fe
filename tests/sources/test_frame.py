from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Normal
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import frame
from precision_pin.sources.frame import Frame
from support.checks.common import Q7, one_link
from support.checks.places import check_frame
from support.plain_robot import chain_of, inserted, pose_error, random_arm


def test_six_large_errors_at_every_kind_of_place():
    check_frame(frame)


def test_at_the_tool_by_hand():
    # hinge at 90°: tool x is base y, tool y is base -x
    source = Frame(frame="tool", x=1e-3, y=2e-3, rz=5e-3)
    at = ErrorModel(one_link(), Space(), [source]).at([np.pi / 2])
    np.testing.assert_allclose(at.linear(np.zeros((0, 1)))[:, 0], [-2e-3, 1e-3, 0, 0, 0, 5e-3], atol=1e-18)


def test_at_the_base_it_is_the_mounting():
    chain = chain_of(random_arm(12), tip="tool")
    at = ErrorModel(chain, Space(), [Frame(frame="base", x=0.1, rx=0.2, rz=0.5)]).at(Q7)
    moved = inserted([0.1, 0, 0, 0.2, 0, 0.5]) @ at.posture.pose
    np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], pose_error(moved, at.posture.pose), atol=1e-14)


def test_every_law_becomes_a_draw_named_after_its_field():
    laws = {field: Normal(1e-3) for field in ("x", "y", "z", "rx", "ry", "rz")}
    model = ErrorModel(one_link(), Space(), [Frame(joint="hinge", **laws)])
    assert model.space.components == tuple(f"frame[hinge].{field}" for field in laws)
    assert len(ErrorModel(one_link(), Space(), [Frame(joint="hinge", y=Normal(1e-3))]).at([0.0]).terms) == 1


@pytest.mark.parametrize("where", [{}, {"joint": "hinge", "frame": "tool"}, {"joint": "hinge", "link": "arm"}])
def test_exactly_one_place_is_needed(where):
    with pytest.raises(InputError, match="one of joint:, link: and frame:"):
        Frame(**where, x=1e-3)


def test_a_frame_on_a_branch_moves_nothing_and_is_refused():
    chain = chain_of(random_arm(12), tip="tool")
    with pytest.raises(InputError, match="'bracket' is not on the path from 'base' to 'tool'"):
        ErrorModel(chain, Space(), [Frame(frame="bracket", x=1e-3)]).at(Q7)
