"""Requests beyond the memory of any machine are refused in a line, at once; a long run tells how far it is at once."""

import fnmatch
import itertools
import time

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base import arguments
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.ur_kinematics import read_ur_calibration
from precision_pin.sheet.changes import matches

MODEL = pp.ErrorModel.load(PAPER_SHEET)
AT = MODEL.at()
CHAIN = MODEL.chain
JOINTS, NUMBERS = len(CHAIN.joint_names), MODEL.space.size


def zeros(*shape):
    """Return an array that takes no memory itself, however large."""
    return np.broadcast_to(np.zeros((1,) * len(shape)), shape)


REQUESTS = {
    "poses in an array": lambda n: pp.sample_poses(MODEL, zeros(JOINTS, n)),
    "poses by joint": lambda n: pp.sample_poses(MODEL, {name: zeros(n) for name in CHAIN.joint_names}),
    "postures": lambda n: CHAIN.at_many(zeros(JOINTS, n)),
    "pose models": lambda n: MODEL.at_many(zeros(JOINTS, n)),
    "one pose of many numbers": lambda n: CHAIN.at(zeros(n)),
    "kept samples": lambda n: pp.monte_carlo(MODEL, samples=min(n, 10**12), keep_samples=True),
    "numbers": lambda n: MODEL.space.sample(0, 0, n),
    "uniform numbers": lambda n: MODEL.space.inverse(zeros(NUMBERS, n)),
    "superposed robots": lambda n: AT.linear(zeros(NUMBERS, n)),
    "exact robots": lambda n: AT.exact(zeros(NUMBERS, n)),
    "samples of a law": lambda n: pp.Empirical.from_samples(zeros(n)),
    "quantiles of a law": lambda n: pp.Empirical(zeros(n, 2)),
    "rows of a law": lambda n: pp.Rows(zeros(n, 2)),
    "covariance of a law": lambda n: pp.JointNormal(zeros(1000, n)),
    "parameter errors": lambda n: pp.mcpc.from_chain(CHAIN).perturbed(zeros(n)),
}


@pytest.mark.parametrize("what", REQUESTS)
def test_what_no_machine_can_hold_is_refused_at_once(what, monkeypatch):
    monkeypatch.setattr(arguments, "available_memory", lambda: 64 * 10**9)
    for count in (10**10, 10**15):
        begun = time.perf_counter()
        with pytest.raises(pp.InputError) as refused:
            REQUESTS[what](count)
        assert time.perf_counter() - begun < 1
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < 250


def test_a_refusal_says_how_much_it_takes_and_how_much_there_is(monkeypatch):
    monkeypatch.setattr(arguments, "available_memory", lambda: 64 * 10**9)
    with pytest.raises(
        pp.InputError, match=r"sampling 100,000,000 poses takes 1\d\d\.\d GB, 64\.0 GB of memory are free"
    ):
        pp.sample_poses(MODEL, zeros(JOINTS, 10**8))


def test_the_estimate_for_many_poses_is_what_the_result_holds():
    # arrays of the result, twice as long as they are joined, and the joint values
    found = pp.sample_poses(MODEL, zeros(JOINTS, 3), samples=100, specifications="1 mm @ 90 %")
    held = sum(value.nbytes for value in vars(found).values() if isinstance(value, np.ndarray) and value is not found.q)
    said = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("precision_pin.sampling.many_poses.check_memory", lambda needed, *_: said.append(needed))
        pp.sample_poses(MODEL, zeros(JOINTS, 3), samples=100, specifications="1 mm @ 90 %")
    assert said == [2 * held + 3 * found.q.nbytes + 2 * 3 * 8]


def test_postures_are_refused_when_their_arrays_are_asked_for(monkeypatch):
    postures = CHAIN.at_many(zeros(JOINTS, 1_000_000))
    monkeypatch.setattr(arguments, "available_memory", lambda: 10**8)
    for name in ("pose", "joint_jacobian"):
        with pytest.raises(pp.InputError, match="1,000,000 configurations takes"):
            getattr(postures, name)


@pytest.mark.slow
@pytest.mark.parametrize("listed", [False, True])
def test_many_poses_tell_how_far_they_are_within_a_second(listed):
    pp.sample_poses(MODEL, zeros(JOINTS, 2), samples=10)  # loads what is compiled
    poses = [[0.1] * JOINTS] * 100_000 if listed else zeros(JOINTS, 100_000)

    def first_step(count):
        raise KeyboardInterrupt

    begun = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        pp.sample_poses(MODEL, poses, samples=1000, progress=first_step)
    assert time.perf_counter() - begun < 3  # it takes a third of a second on a quiet machine


LONG = 100_000
"""Characters of a text that is made to take long."""
FILES = {
    "the heading of a column": (f"joint1{' ' * LONG}[deg\n0\n", lambda file: pp.read_trajectory(file, CHAIN)),
    "brackets in a heading": ("[" * LONG + "\n0\n", lambda file: pp.read_trajectory(file, CHAIN)),
    "blank lines": ("\n" * LONG, lambda file: read_ur_calibration(file, "ur3e")),
    "a line of blanks": (" " * LONG, lambda file: read_ur_calibration(file, "ur3e")),
    "lists without an end": ("delta_theta = [\n" * (LONG // 15), lambda file: read_ur_calibration(file, "ur3e")),
}
TEXTS = {
    "a specification": lambda: pp.specification("x" + " " * LONG + "@"),
    "a target": lambda: pp.monte_carlo(MODEL, samples=1, until="1" + " " * LONG + "to"),
    "a unit": lambda: MODEL.with_({"payload.mass": "1" + " 1" * LONG + " x"}),
    "stars in a path": lambda: MODEL.with_({"parameters." + "*a" * (LONG // 2): "1 mm"}),
    "brackets in a path": lambda: MODEL.with_({"a[" + "]#1" * (LONG // 3) + "!": "1 mm"}),
}


@pytest.mark.fast(4)
@pytest.mark.parametrize("what", [*FILES, *TEXTS])
def test_a_text_made_to_take_long_is_refused_at_once(what, tmp_path):
    file = tmp_path / "file"
    file.write_text(FILES[what][0] if what in FILES else "")
    begun = time.process_time()
    with pytest.raises(pp.InputError) as refused:
        FILES[what][1](file) if what in FILES else TEXTS[what]()
    assert time.process_time() - begun < 0.5
    assert len(str(refused.value)) < 2500


def test_patterns_match_as_those_of_a_shell_do():
    begun = time.process_time()
    assert not matches("*a" * 30 + "*b", "a" * LONG)
    assert time.process_time() - begun < 0.1
    names = ["".join(one) for length in range(5) for one in itertools.product("ab", repeat=length)]
    patterns = ["".join(one) for length in range(5) for one in itertools.product("ab*", repeat=length)]
    assert [(p, n) for p in patterns for n in names if matches(p, n) != fnmatch.fnmatchcase(n, p)] == []


GIB = 2**30


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Return a function that writes the files of the kernel: text by path."""

    def write(**files):
        for path, text in {"meminfo": f"MemAvailable: {8 * GIB // 1024} kB", **files}.items():
            place = tmp_path.joinpath(*path.split("__"))
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
        return arguments.available_memory()

    monkeypatch.setattr(arguments, "_MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(arguments, "_GROUPS", tmp_path / "groups")
    monkeypatch.setattr(arguments, "_OWN_GROUPS", tmp_path / "own")
    return write


def test_free_memory_is_that_of_the_tightest_group_or_the_machine(machine):
    assert machine() == 8 * GIB
    assert machine(own="0::/\n", **{"groups__memory.max": "max", "groups__memory.current": "1"}) == 8 * GIB
    nested = {"groups__a__memory.max": str(4 * GIB), "groups__a__memory.current": str(GIB)}
    nested |= {"groups__a__b:c__memory.max": "max", "groups__a__b:c__memory.current": "0"}
    assert machine(own="0::/a/b:c\n", **nested) == 3 * GIB
    first = {"groups__memory__x__memory.limit_in_bytes": str(GIB), "groups__memory__x__memory.usage_in_bytes": str(GIB)}
    assert machine(own="5:cpu:/\n4:memory:/x\n0::/\n", **first) == 0
