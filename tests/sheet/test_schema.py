"""The JSON schema of a sheet, judged by the package jsonschema where it is installed."""

import json
from typing import Any

import pytest
from ruamel.yaml import YAML

from precision_pin.draws.laws import laws_of_sheets
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema
from precision_pin.sources import catalogue

from .test_contract import CONTRACT


def contents(text: str) -> Any:
    """Return a sheet as an editor sees it, with the types of YAML."""
    return YAML(typ="safe", pure=True).load(text)


def faults(sheet: Any) -> list[str]:
    jsonschema = pytest.importorskip("jsonschema")
    return [error.message for error in jsonschema.Draft202012Validator(json_schema()).iter_errors(sheet)]


@pytest.mark.slow
def test_it_is_a_schema_and_json() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert json.loads(json.dumps(schema)) == schema


def test_every_kind_of_source_and_every_law_is_in_it() -> None:
    schema = json_schema()
    kinds = {next(iter(choice["properties"])) for choice in schema["properties"]["sources"]["items"]["oneOf"]}
    assert kinds == set(catalogue())
    assert {"length", "axis_install", "beam", "joint_compliance", "payload", "frame", "joint_offset", "mcpc"} <= kinds
    assert set(laws_of_sheets()) <= set(schema["$defs"]["law"]["properties"])
    top = {"precision-pin", "robot", "tip", "base", "gravity", "statics", "locked", "poses", "parameters", "sources"}
    top |= {
        "correlations",
        "target",
        "calibrated",
        "allocate",
        "measurement",
        "provenance",
        "accept",
        "limits",
        "keep_out",
    }
    assert set(schema["properties"]) == top
    assert set(schema["required"]) == {"precision-pin", "robot"}
    assert schema["additionalProperties"] is False


def test_every_reference_leads_somewhere() -> None:
    schema = json_schema()

    def references(node: Any) -> set[str]:
        if isinstance(node, dict):
            own = {node["$ref"]} if "$ref" in node else set()
            return own.union(*(references(value) for value in node.values()))
        return set().union(*(references(value) for value in node)) if isinstance(node, list) else set()

    assert {reference.removeprefix("#/$defs/") for reference in references(schema)} <= set(schema["$defs"])


@pytest.mark.parametrize("text", [PAPER_SHEET.read_text(encoding="utf-8"), CONTRACT], ids=["paper", "contract"])
def test_good_sheets_pass(text: str) -> None:
    assert faults(contents(text)) == []


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("text", "is_right"),
    [
        ("{kind: plane, plane: {point: 0 0 1 mm, normal: 0 0 1}, target_known: false, load: none}", True),
        ("{kind: socket, sockets: [0 0 1 mm], base: free, load: [{at: tool, mass: 1 kg}]}", True),
        ("{visible_from: 2 0 0 m, facing: 0 0 1, cone: 30 deg, target_known: true}", True),
        ("{kind: planes}", False),
        ("{target_known: perhaps}", False),
        ("{load: [{mass: 1 kg}]}", False),
    ],
)
def test_a_measurement_is_judged(text: str, is_right: bool) -> None:
    sheet = PAPER_SHEET.read_text(encoding="utf-8") + f"\nmeasurement: {text}\n"
    assert (faults(contents(sheet)) == []) is is_right


@pytest.mark.fast(5)
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("statics: nominal", "static: nominal"),
        ("statics: nominal", "statics: dynamic"),
        ("precision-pin: 1", "precision-pin: 2"),
        ("{uniform: 0.05 mm}\n  tool", "{unifrom: 0.05 mm}\n  tool"),
        ("{uniform: 0.05 mm}\n  tool", "{uniform: 0.05 mm, normal: 1 mm}\n  tool"),
        ("scope: visit", "scope: day"),
        ("- beam: {link: link2, EI", "- beam: {link: link2, EIx"),
        ("- beam: {link: link2, ", "- beam: {"),
        ("- beam:", "- beem:"),
        ("span: 100 mm", "span: 100"),
        ("compliance: {uniform: 1e-6", "compliance: {unifrom: 1e-6"),
    ],
)
def test_bad_sheets_fail(old: str, new: str) -> None:
    assert CONTRACT.count(old) == 1
    assert faults(contents(CONTRACT.replace(old, new)))
