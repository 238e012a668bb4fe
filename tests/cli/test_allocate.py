"""``precision-pin allocate``: table, the new sheet, exit codes, wrong input."""

from __future__ import annotations

import json

import pytest

from precision_pin import ErrorModel

PATHS = [f"axis_install[joint{k}].radius" for k in range(1, 5)]


def _sheet(folder, limit, more=""):
    entries = "\n".join(f"    - {{path: '{path}', cost: {{reciprocal: 1 mm}}{more}}}" for path in PATHS)
    text = (folder / "4dof.errors.yaml").read_text()
    (folder / "wanted.yaml").write_text(f"{text}\nallocate:\n  specs: ['{limit}']\n  tolerances:\n{entries}\n")
    return "wanted.yaml"


@pytest.mark.slow
def test_tolerances_are_chosen_verified_and_written_as_a_sheet(run, folder, new_files):
    done = run("allocate", _sheet(folder, "37.5 mm @ 95 %"), "--out", "made")
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].startswith("cost ")
    assert max(map(len, lines)) <= 100
    result = json.loads((folder / "made/allocation.json").read_text())
    assert result["schema"] == "precision-pin/allocation/1"
    spec = result["specs"][0]
    assert spec["met"]
    assert spec["interval"][0] >= 0.95
    new = ErrorModel.load(folder / "made/allocated.errors.yaml")
    assert [one["path"] for one in result["tolerances"]] == PATHS
    assert len(new.poses) == len(result["poses"])


@pytest.mark.slow
def test_what_no_tolerance_can_meet_exits_with_1_and_writes_no_sheet(run, folder):
    done = run("allocate", _sheet(folder, "1 mm"), "--out", "made")
    assert done.code == 1
    said = " ".join(done.out.split())
    assert said.startswith(
        "no allocation was found that meets position.norm 1 mm @ 95 %: with every tolerance at its least 0.00 %"
    )
    assert "in the way: constant part 36.8 mm (no tolerance; compensate or calibrate removes it), " in said
    assert max(map(len, done.out.splitlines())) <= 100
    assert not (folder / "made/allocated.errors.yaml").exists()
    assert "no sheet is written" in done.err
    quiet = run("allocate", "wanted.yaml", "--quiet", "--out", "quiet")
    assert quiet.code == 1
    assert quiet.out == done.out
    assert "wrote" not in quiet.err


@pytest.mark.slow
def test_bounds_stand_beside_the_specs_and_a_law_may_be_named_as_a_whole(run, folder):
    text = (folder / "4dof.errors.yaml").read_text()
    sources = "  - length: {frame: tool, along: -z of joint4, parameters: [wide, shifted]}\n"
    parameters = "parameters:\n  wide: {uniform: 0.1 mm}\n  shifted: {uniform: 0.1 mm, mean: 1 mm}\n"
    text = text.replace("\nparameters:\n", f"\n{parameters}").replace("\nsources:\n", f"\nsources:\n{sources}")

    def allocated(paths, limits):
        entries = "".join(f"    - {{path: '{path}', cost: {{reciprocal: 1 mm}}}}\n" for path in paths)
        (folder / "wanted.yaml").write_text(f"{text}\nallocate:\n{limits}  tolerances:\n{entries}")
        return run("allocate", "wanted.yaml", "--json", "-")

    done = allocated(["parameters.wide", "parameters.shifted"], "  rms: 45 mm\n  worst_case: 60 mm\n")
    assert done.code == 0
    assert [one["path"] for one in done.json["tolerances"]] == ["parameters.wide.uniform", "parameters.shifted.uniform"]
    assert [(one["kind"], one["limit"]) for one in done.json["specs"]] == [("rms", 0.045), ("worst_case", 0.06)]
    assert done.json["lower_bound_basis"] == "proof"
    refused = allocated(["parameters.shifted.mean"], "  rms: 45 mm\n")
    assert refused.code == 2
    assert (
        "parameters.shifted.mean changes the mean of the error and cannot be chosen; parameters.shifted.uniform can"
        in refused.err
    )


@pytest.mark.slow
def test_wrong_input_is_one_line(run, folder):
    done = run("allocate", "4dof.errors.yaml")
    assert done.code == 2
    assert "allocate:" in done.err
    done = run("allocate", _sheet(folder, "1 mm", ", maxi: 1 mm"))
    assert done.code == 2
    assert "maxi" in done.err
    assert "Traceback" not in done.err
    line = (folder / "wanted.yaml").read_text().splitlines().index("  tolerances:") + 2
    assert done.err.startswith(f"wanted.yaml:{line}: error E_NAME: no key of tolerances[0] named 'maxi'")
    checked = run("check", "wanted.yaml")
    assert checked.code == 2
    assert checked.out == done.err


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("reciprocal: 1 mm", "reciprocal: 1 mrad", "unit such as mm"),
        ("reciprocal: 1 mm", "reciprocal: 1e308 mm", "up to 1e+50 in SI"),
        ("37.5 mm @ 95 %", "37.5 kg", "kg"),
        ("joint4].radius", "joint3].radius", "listed twice"),
        ("joint4].radius", "joint5].radius", "joint5"),
        ("  specs:", "  poses: [nowhere]\n  specs:", "nowhere"),
        ("  specs:", "  poses: nowhere\n  specs:", "list of names"),
        ("  specs:", "  specifications:", "specifications"),
    ],
)
def test_check_reads_what_is_to_be_allocated(run, folder, old, new, words):
    name = _sheet(folder, "37.5 mm @ 95 %")
    assert run("check", name).code == 0
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    done = run("check", name)
    assert done.code == 2
    assert words in done.out
    assert done.out.startswith("wanted.yaml:")


@pytest.mark.slow
def test_the_folder_has_the_front(run, folder, new_files):
    done = run("allocate", _sheet(folder, "37.5 mm @ 95 %"), "--out", "made", "--pareto", "5")
    assert done.code == 0
    assert "cost against accuracy" in done.out
    files = {"allocation.json", "allocation.png", "allocation.svg", "allocated.errors.yaml"}
    assert new_files() == {"wanted.yaml", "made"} | {f"made/{name}" for name in files}
    points = json.loads((folder / "made/allocation.json").read_text())["pareto"]
    assert len(points) == 5
    costs = [point["cost"] for point in points]
    assert costs == sorted(costs, reverse=True)
    assert run("allocate", "wanted.yaml", "--pareto", "1").code == 2
    assert run("allocate", "wanted.yaml", "--seconds", "0").code == 2
