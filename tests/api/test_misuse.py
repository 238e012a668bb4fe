"""Wrong arguments of every public function end in one line that names the argument."""

from dataclasses import replace

import pytest

import precision_pin as pp
from api.api_calls import FINE, MISTAKES, POSE, calls, model, outcome

MADE_BY_THE_PACKAGE = {"MonteCarloResult", "Page", "PosesResult", "Posture", "Postures"}
NOT_CALLED = {"InputError", "PrecisionPinError", "Scope", "Source", "mcpc", "sources"}
SLOW = {"reliability", "budget", "worst_case", "report", "view"}


@pytest.mark.slow
def test_every_public_name_is_called():
    called = {call.name.partition(".")[0] for call in calls()}
    assert set(pp.__all__) - called == MADE_BY_THE_PACKAGE - called | NOT_CALLED - {"mcpc"}


def test_valid_calls_are_let_pass(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for call in calls():
        if call.name not in SLOW:  # in their own tests
            call.run()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_every_mistake_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wrong, count = [], 0
    for call in calls():
        for argument in call.arguments:
            fine = call.fine.get(argument, "").split(", ")
            for mistake in MISTAKES:
                if mistake not in fine:
                    count += 1
                    kind, text = outcome(call, argument, mistake)
                    wrong += [(call.name, argument, mistake, kind, text)] if kind != "refused" else []
    assert wrong == []
    assert count > 8000


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_what_looks_like_a_mistake_and_is_none_is_let_pass(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    slow = ("population", "report", "view")  # in their own tests
    for call in calls():
        for argument, names in call.fine.items() if call.name not in slow else ():
            if call.name in SLOW and argument in FINE:
                continue  # quick calls hand it to the same code
            # elsewhere than in monte_carlo a bar is drawn as a function is called
            drawn = {"true"} if argument == "progress" and call.name != "monte_carlo" else set()
            for mistake in set(filter(None, names.split(", "))) - drawn:
                given = call.arguments[argument]
                # a valid call has it already; those three are not among test_valid_calls_are_let_pass
                is_given = type(given) is type(MISTAKES[mistake]) and not given and not MISTAKES[mistake]
                if call.name in SLOW or not is_given:
                    assert outcome(call, argument, mistake)[0] == "fine", (call.name, argument, mistake)


@pytest.mark.fast(2)
@pytest.mark.parametrize("kind", sorted({source.kind() for source in model().sources}))
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_a_setting_of_a_source_that_is_none_is_refused_by_name(kind):
    arm = model()
    source = next(source for source in arm.sources if source.kind() == kind)
    for setting in source.settings():
        refused = []
        for value in MISTAKES.values():
            try:
                wrong = replace(source, **{setting: value})
                pp.ErrorModel(arm.chain, arm.space, [wrong], {"home": POSE}).at("home")
            except pp.PrecisionPinError as error:
                refused.append(str(error))
        assert len(refused) >= 10, setting  # what is no number, law, draw, formula or name
        assert [text for text in refused if "\n" in text] == []
