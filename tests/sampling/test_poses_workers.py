"""Many poses on processes, executors and with a journal: the same bits as on threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import many_poses

pytestmark = pytest.mark.slow

MODEL = pp.ErrorModel.load(PAPER_SHEET)
POSES = MODEL.poses["paper"][:, None] + np.random.default_rng(3).uniform(-0.3, 0.3, (4, 70))
RUN = {"samples": 400, "seed": 4, "specifications": ["40 mm"]}


@pytest.fixture(scope="module")
def plain() -> str:
    return pp.sample_poses(MODEL, POSES, **RUN, threads=1).to_json()


def test_an_executor_gives_the_same_bits(plain):
    with ThreadPoolExecutor(3) as pool:
        assert pp.sample_poses(MODEL, POSES, **RUN, executor=pool).to_json() == plain


def test_a_sampled_map_on_an_executor_has_the_same_bits():
    sampled = {"samples": 400, "seed": 4}
    with ThreadPoolExecutor(3) as pool:
        found = pp.map_poses(MODEL, POSES[:, :5], **sampled, executor=pool)
    assert found.to_json() == pp.map_poses(MODEL, POSES[:, :5], **sampled, threads=1).to_json()


def test_processes_give_the_same_bits(plain):
    assert pp.sample_poses(MODEL, POSES, **RUN, processes=2).to_json() == plain


def test_a_run_that_was_stopped_goes_on_with_the_same_bits(plain, tmp_path, monkeypatch):
    file, told = tmp_path / "run.journal", []

    done = many_poses.PosesDone.with_part

    def stop_after_one(state, part):
        if state.count:
            raise KeyboardInterrupt
        return done(state, part)

    monkeypatch.setattr(many_poses.PosesDone, "with_part", stop_after_one)
    with pytest.raises(KeyboardInterrupt) as stopped:
        pp.sample_poses(MODEL, POSES, **RUN, journal=file)
    assert stopped.value.__notes__ == [f"the journal {file} holds the first 64 of 70 poses"]
    monkeypatch.undo()
    resumed = pp.sample_poses(MODEL, POSES, **RUN, journal=file, resume=True, tell=told.append)
    assert resumed.to_json() == plain
    assert told == [f"the journal {file} holds the first 64 poses"]


def test_a_journal_of_another_run_is_refused(tmp_path):
    file = tmp_path / "run.journal"
    pp.sample_poses(MODEL, POSES[:, :2], **RUN, journal=file)
    with pytest.raises(InputError, match=r"belongs to another run: .*the list of poses has changed"):
        pp.sample_poses(MODEL, POSES[:, [1, 0]], **RUN, journal=file, resume=True)
    with pytest.raises(InputError, match="already exists"):
        pp.sample_poses(MODEL, POSES[:, :2], **RUN, journal=file)
    with pytest.raises(InputError, match="resume needs a journal"):
        pp.sample_poses(MODEL, POSES[:, :2], **RUN, resume=True)
