"""The JSON of ``stemwatch explain``: a documented contract, whatever was or was not found."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from io import StringIO
from pathlib import Path

import jsonschema
import pytest
from rich.console import Console

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import HeldOutFit, Mismatch
from stemwatch.service.cli.explanation_views import explanation
from stemwatch.service.explain.explain_json import to_json, to_object
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.report.mismatch_view import how_both_ran
from tests.service.example_mismatches import effect, named, of_every_kind

SCHEMA = json.loads(
    files("stemwatch.service.explain").joinpath("explain.schema.json").read_text("utf-8")
)
REPORT_SCHEMA = json.loads(
    files("stemwatch.service.report").joinpath("contract.schema.json").read_text("utf-8")
)
DOCS = Path(__file__).parents[2] / "docs"


def explained(mismatch, source="./exports/FV-1.csv", valve="FV-1") -> Explained:
    return Explained(source=source, valve=valve, mismatch=mismatch)


def test_every_verdict_follows_the_schema():
    """A list with one object per recording, in the order given, valid in every verdict."""
    objects = json.loads(to_json([explained(item) for item in of_every_kind()]))
    jsonschema.validate(objects, SCHEMA)
    words = [item["verdict"] for item in objects]
    assert words == ["named", "candidates", "unknown", "none", "not_testable"]
    assert {item["recording"] for item in objects} == {"./exports/FV-1.csv"}
    assert {item["version"] for item in objects} == {1}


def test_the_fields_are_the_ones_that_a_reader_may_rely_on():
    """Every field of a named effect, with its class, parameters and evidence."""
    as_object = to_object(explained(named()))
    assert set(as_object) == set(SCHEMA["$defs"]["mismatch"]["required"])
    first, second = as_object["effects"]
    assert first["slug"] == "asymmetric_rate_limit"
    assert second["class"] == ["dead_time", "actuator_lag"]
    assert first["parameters"]["rate_falling"] == {
        "value": 2.9,
        "low": 2.7,
        "high": 3.1,
        "unit": "%/s",
        "reason": None,
    }
    assert first["parameters"]["rate_rising"]["reason"] == "never reached"
    assert first["evidence"]["share"] == 0.88
    assert as_object["stiction"]["naive"]["S"]["value"] == 11.8
    assert as_object["stiction"]["restated"]["S"]["value"] == 1.0
    assert as_object["heldout"]["fit_extended"] == 69.4
    assert as_object["record_effects"][0]["parameters"] == {"step_percent": 0.06}
    assert [each["slug"] for each in as_object["not_testable"]] == ["travel_stop", "flow_force"]
    assert as_object["hot_places"]["before"][0]["label"] == "falling"
    assert as_object["hot_places"]["after"] == []


def test_what_could_not_be_read_is_an_object_too():
    """An unreadable recording is not testable, and its S and J say why."""
    as_object = to_object(explained(Mismatch.unknown("FV-1.csv: line 3: no number.")))
    jsonschema.validate([as_object], SCHEMA)
    assert (as_object["verdict"], as_object["sentence"]) == (
        "not_testable",
        "FV-1.csv: line 3: no number.",
    )
    assert as_object["stiction"]["restated"]["J"]["reason"] == "FV-1.csv: line 3: no number."
    assert set(as_object["heldout"].values()) == {None}


def test_nan_and_infinity_become_null():
    """Numbers that JSON has not are null; an estimate then says why."""
    nan, inf = math.nan, math.inf
    odd = replace(
        named(),
        heldout=HeldOutFit(rmse_naive=nan, rmse_ceiling=inf),
        effects=(replace(effect(), parameters={"x": Estimate(value=inf, low=0.0, high=inf)}),),
    )
    (item,) = json.loads(to_json([explained(odd)]))
    jsonschema.validate([item], SCHEMA)
    assert item["heldout"]["rmse_naive"] is None
    assert item["effects"][0]["parameters"]["x"]["reason"] == "the fit gave no finite number"


def test_the_schema_refuses_an_unknown_verdict():
    """The schema is not so wide that anything passes."""
    as_object = to_object(explained(named()))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate([as_object | {"verdict": "perhaps"}], SCHEMA)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(
            [{key: as_object[key] for key in as_object if key != "heldout"}], SCHEMA
        )


def test_the_report_and_the_command_agree_on_the_parts():
    """Both schemas define the same effect, estimate, place and held-out fit."""
    shared = set(SCHEMA["$defs"]) - {"mismatch", "by_window"}
    assert {name: SCHEMA["$defs"][name] for name in shared} == {
        name: REPORT_SCHEMA["$defs"][name] for name in shared
    }
    own = {"version", "recording", "valve", "by_window"}
    both = (SCHEMA["$defs"]["mismatch"], REPORT_SCHEMA["$defs"]["mismatch"])
    mine, reports = (set(item["properties"]) for item in both)
    assert mine - own == reports


def test_every_field_is_described():
    """Each property of the schema stands in docs/json.md."""
    page = (DOCS / "json.md").read_text("utf-8")
    names = set(properties(SCHEMA))
    assert len(names) > 40
    assert {name for name in names if f"`{name}`" not in page} == set()


def properties(schema) -> Iterator[str]:
    """Every property name in a schema, at any depth."""
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        schema = list(schema.values())
    if isinstance(schema, list):
        for inner in schema:
            yield from properties(inner)


@pytest.mark.parametrize(
    ("way", "words"),
    [("slip_by_slip", "slip by slip"), ("alternate_blocks", "over every other block of time")],
)
def test_how_both_models_were_compared_is_told_alike(way, words):
    """JSON and terminal say by which of the three comparisons the effects stand."""
    freely = named()
    otherwise = replace(freely, heldout=replace(freely.heldout, **{way: True}))
    assert to_object(explained(otherwise))["heldout"][way] is True
    assert to_object(explained(freely))["heldout"][way] is False
    assert words in how_both_ran(otherwise)
    assert words in in_terminal(otherwise)
    assert words not in in_terminal(freely)


def in_terminal(mismatch: Mismatch) -> str:
    """What the terminal prints of it, in one long line each."""
    console = Console(width=2000, record=True, file=StringIO())
    console.print(explanation(explained(mismatch)))
    return console.export_text()
