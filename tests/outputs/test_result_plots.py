"""``plot`` of every result: on its own, on given axes, in a notebook; every figure says of what it is."""

from __future__ import annotations

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from precision_pin.analyses.budget.budget import budget
from precision_pin.analyses.exact_law.exact_law import exact_law
from precision_pin.analyses.moments.moments import moments
from precision_pin.analyses.registry import declarations
from precision_pin.analyses.reliability.reliability import reliability
from precision_pin.analyses.worst_case.worst_case import worst_case
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import monte_carlo

N = 1024


@pytest.fixture(scope="module")
def results():
    model = ErrorModel.load(PAPER_SHEET)
    return {
        "budget": budget(model, samples=N, seed=7),
        "worst-case": worst_case(model, samples=N, seed=7),
        "exact-law": exact_law(model, samples=N, seed=7),
        "reliability": reliability(model, ["38 mm @ 95 %"], samples=N, seed=7),
        "moments": moments(model, samples=N, seed=7),
    }


def texts(figure: Figure) -> str:
    return " ".join(text.get_text() for text in figure.findobj(Text)).replace("\n", " ")


@pytest.mark.slow
def test_every_analysis_is_tried(results):
    assert set(results) == {name for name, one in declarations().items() if one.heading}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["budget", "worst-case", "exact-law", "reliability", "moments"])
def test_a_result_draws_itself_and_names_robot_pose_n_and_seed(results, name):
    figure = results[name].plot()
    words = texts(figure)
    for part in ("4dof.urdf", "at pose paper", f"N = {N:,}", "seed 7"):
        assert part in words
    for inside in ("SI", "spherical triangles"):
        assert inside not in words.split()
    assert figure._repr_png_()[:4] == b"\x89PNG"


@pytest.mark.parametrize("name", ["budget", "worst-case", "exact-law", "moments"])
def test_a_result_draws_on_given_axes(results, name):
    for quantity in ("position", "attitude"):
        axes = Figure().subplots()
        assert results[name].plot(quantity=quantity, axes=axes) is axes
        assert axes.has_data()


def test_reliability_draws_what_has_a_limit(results):
    axes = Figure().subplots()
    assert results["reliability"].plot(axes=axes).has_data()
    with pytest.raises(InputError, match="no specification limits the attitude"):
        results["reliability"].plot(quantity="attitude", axes=Figure().subplots())


def test_wrong_arguments_get_one_line(results):
    with pytest.raises(UnknownNameError, match="position"):
        results["budget"].plot(quantity="speed")
    with pytest.raises(InputError, match="pose must be a whole number from 0 to 0"):
        results["budget"].plot(pose=1)


@pytest.mark.slow
def test_sampled_results_draw_themselves():
    result = monte_carlo(ErrorModel.load(PAPER_SHEET), samples=500, seed=7)
    for quantity in ("position", "attitude", "components", "position.x"):
        figure = result.plot(quantity)
        assert isinstance(figure, Figure)
        for part in ("4dof.urdf at pose paper", "N = 500", "seed 7"):
            assert part in texts(figure)
    axes = Figure().subplots()
    assert isinstance(result.plot("attitude", axes=axes), Axes)
    assert axes.has_data()
    with pytest.raises(UnknownNameError):
        result.plot("speed")
    with pytest.raises(InputError, match="a separate figure"):
        result.plot("components", axes=axes)


@pytest.mark.slow
def test_a_bound_below_what_was_found_says_why():
    # joints that turn by a radian bend the arm far beyond its tangent
    from precision_pin.analyses.worst_case.figure import explain_excess
    from precision_pin.draws.laws import Normal, Uniform
    from precision_pin.draws.space import Space
    from precision_pin.sources.joint_offset import JointOffset
    from support.sheets import seven_joint_arm

    chain = seven_joint_arm()
    turning = [joint.name for joint in chain.joints if joint.kind != "prismatic"]

    def found(law):
        model = ErrorModel(chain, Space(()), [JointOffset(joint=turning[1], offset=law)])
        result = worst_case(model, [0.1] * len(chain.joints), samples=N, seed=1)
        return explain_excess(result.poses[0]), texts(result.plot())

    lines, words = found(Normal(1e-6))
    assert any("samples lie beyond the bound, which cuts unbounded laws" in line for line in lines)
    assert "samples lie beyond the bound" in words
    lines, _ = found(Uniform(1e-6))
    assert lines == []
