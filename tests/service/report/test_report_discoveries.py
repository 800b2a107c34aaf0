"""False discoveries across a run: what is held back, what counts, what every file says of it."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from importlib.resources import files

import jsonschema
import openpyxl
import pytest

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.explain.explain_json import to_json
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.presenter.false_discoveries import discoveries
from stemwatch.service.report import to_contract, write_report
from tests.service.example_mismatches import named, of_every_kind

SCHEMA = json.loads(
    files("stemwatch.service.report").joinpath("contract.schema.json").read_text("utf-8")
)
_, CANDIDATES, UNKNOWN, NOTHING, UNTESTABLE = of_every_kind()
# Strong, weak, and ten valves that count: with twelve tested the first limit is 0.0042.
STRONG, WEAK = 0.001, 0.02


def with_p(p_value, mismatch=None):
    """A mismatch with effects and a p value."""
    return replace(mismatch or named(), p_value=p_value)


MISMATCHES = [with_p(STRONG), with_p(WEAK), UNTESTABLE, None, UNKNOWN, *[NOTHING] * 9]
SENTENCE = (
    "Hidden physics named on 1 of 12 valves tested; at most 5 % of such findings are expected to "
    "be due to chance (Benjamini-Hochberg). 1 more is held back: across 12 valves chance alone "
    "may have named it."
)
REMARK = (
    "Held back: across 12 valves chance alone may have named this. Plan no work on it alone; see "
    "whether the next recording names it again."
)


@pytest.fixture
def valves(make_screening):
    """A run with one strong finding, one weak one, and valves that show nothing."""
    screening = make_screening("FV", samples=200)
    return [replace(screening, valve=f"FV-{k}", mismatch=item) for k, item in enumerate(MISMATCHES)]


@pytest.fixture
def written(valves, make_context, tmp_path):
    return write_report(valves, make_context(valves), tmp_path)


def words_of(path):
    """The page's text, spaces made plain."""
    text = re.sub(r"<[^>]+>", "", path.read_text("utf-8"))
    return re.sub(r"\s+", " ", text.replace("\N{NO-BREAK SPACE}", " "))


def test_strong_findings_stand_and_weak_ones_are_held_back():
    """Whether it stands, is held back, or was never named, in the order of the valves."""
    discovered = discoveries(MISMATCHES)
    assert discovered.standing == (True, False, *[None] * 12)
    assert (discovered.tested, discovered.named, discovered.held_back) == (12, 1, 1)


def test_what_could_not_be_tested_does_not_count():
    """A thousand valves without a position take nothing from the ones that were looked at."""
    few = [with_p(0.02), NOTHING]
    assert discoveries(few).standing[0] is True
    assert discoveries([*few, *[UNTESTABLE, None] * 500]).standing[0] is True
    assert discoveries([*few, NOTHING]).standing[0] is False


def test_the_valves_of_the_run_that_are_not_shown_count_too():
    """A report of the worst few is held to the whole plant, whose other findings are counted."""
    discovered = discoveries([with_p(0.02), NOTHING], elsewhere=[None] * 7 + [STRONG])
    assert discovered.standing == (False, None)
    assert (discovered.tested, discovered.named, discovered.held_back) == (10, 1, 1)


def test_an_effect_without_a_p_value_is_held_back():
    """What an older version stored has no p value: nothing shows that it is not chance."""
    discovered = discoveries([with_p(None)])
    assert discovered.standing == (False,)
    assert (discovered.named, discovered.held_back) == (0, 1)


def test_candidates_are_findings_too():
    """A class of effects that cannot be told apart is held to the same limit."""
    assert CANDIDATES.finding is Finding.CANDIDATES
    weak, strong = with_p(WEAK, CANDIDATES), with_p(STRONG, CANDIDATES)
    assert discoveries([strong, weak, *[NOTHING] * 9]).standing[:2] == (True, False)


@pytest.mark.parametrize(
    ("mismatches", "sentence"),
    [
        ([], ""),
        ([None, UNTESTABLE], ""),
        ([NOTHING], "Hidden physics named on 0 of 1 valve tested."),
        (
            [NOTHING, with_p(STRONG)],
            "Hidden physics named on 1 of 2 valves tested; at most 5 % of such findings are "
            "expected to be due to chance (Benjamini-Hochberg).",
        ),
        (
            [with_p(0.04), with_p(0.03), NOTHING],
            "Hidden physics named on 0 of 3 valves tested. 2 are held back: across 3 valves "
            "chance alone may have named them.",
        ),
        (MISMATCHES, SENTENCE),
    ],
)
def test_the_run_in_a_sentence(mismatches, sentence):
    """How many were tested, named and held back, at which level and by which procedure."""
    assert discoveries(mismatches).sentence == sentence


def test_the_page_says_it_once_and_marks_what_is_held_back(written):
    """The summary has the sentence; only the weak finding has the remark."""
    text = words_of(written.html)
    assert text.count(SENTENCE) == 1
    assert text.count(REMARK) == 1
    page = written.html.read_text("utf-8")
    section = page.split('id="valve-FV-1-mismatch"')[1].split("</section>")[0]
    assert 'class="held-back"' in section
    # The finding itself stays as it is.
    assert "hidden physics named" in section


def test_a_report_of_the_worst_valves_speaks_of_the_whole_run(valves, make_context, tmp_path):
    """With the rest of the plant in its context even the strong finding is held back."""
    context = make_context(valves[:2], p_elsewhere=(None,) * 98)
    paths = write_report(valves[:2], context, tmp_path)
    text = words_of(paths.html)
    assert "Hidden physics named on 0 of 100 valves tested. 2 are held back" in text
    stands = [load["mismatch"]["stands"] for load in json.loads(paths.json.read_text("utf-8"))]
    assert stands == [False, False]


def test_a_run_without_a_test_says_nothing(make_screening, make_context, tmp_path):
    """No sentence where nothing was fitted."""
    valves = [make_screening("FV-1", samples=200)]
    paths = write_report(valves, make_context(valves), tmp_path)
    assert "Hidden physics" not in paths.html.read_text("utf-8")


def test_the_json_has_it_for_each_valve(written, valves):
    """p value and standing; the objects of a run without files are the same."""
    objects = json.loads(written.json.read_text("utf-8"))
    jsonschema.validate(objects, SCHEMA)
    by_valve = {item["valve"]: item["mismatch"] for item in objects}
    assert (by_valve["FV-0"]["p_value"], by_valve["FV-0"]["stands"]) == (STRONG, True)
    assert (by_valve["FV-1"]["p_value"], by_valve["FV-1"]["stands"]) == (WEAK, False)
    assert (by_valve["FV-4"]["p_value"], by_valve["FV-4"]["stands"]) == (None, None)
    assert by_valve["FV-3"] is None
    standing = discoveries([screening.mismatch for screening in valves]).standing
    contracts = map(lambda valve, stands: to_contract(valve, stands=stands), valves, standing)
    assert {contract["valve"]: contract["mismatch"] for contract in contracts} == by_valve


def test_the_schema_refuses_a_probability_above_one(valves):
    """The schema is not so wide that anything passes."""
    contract = to_contract(valves[0])
    for wrong in ({"p_value": 1.5}, {"stands": "yes"}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate([contract | {"mismatch": contract["mismatch"] | wrong}], SCHEMA)


def test_the_strength_of_the_evidence_is_in_the_json():
    """How far beyond the limits an effect lies."""
    first = named().effects[0]
    strong = replace(first, evidence=replace(first.evidence, strength=7.5))
    (item,) = json.loads(to_json([explained(replace(named(), effects=(strong,)))]))
    assert item["effects"][0]["evidence"]["strength"] == 7.5


def test_csv_and_workbook_mark_it(written):
    """A word that a filter finds, the number behind it, and the sentence on the last sheet."""
    with written.csv.open(encoding="utf-8-sig", newline="") as file:
        rows = {row["valve"]: row for row in csv.DictReader(file)}
    assert [rows[f"FV-{k}"]["beyond chance"] for k in (0, 1, 2, 3)] == ["yes", "held back", "", ""]
    assert [rows[f"FV-{k}"]["p value"] for k in (0, 1, 4)] == ["0.001", "0.02", ""]
    book = openpyxl.load_workbook(written.xlsx)
    head, *cells = book["Ranking"].iter_rows(values_only=True)
    column = head.index("beyond chance")
    assert {row[head.index("valve")]: row[column] for row in cells}["FV-1"] == "held back"
    assert SENTENCE in [row[1] for row in book["Read me"].iter_rows(values_only=True)]


def explained(mismatch):
    """One explanation."""
    return Explained(source="FV.csv", valve="FV", mismatch=mismatch)


def test_recordings_that_are_explained_together_are_held_to_one_level():
    """The field depends on the others of the call, the verdict does not."""
    weak = explained(with_p(0.02))
    (alone,) = json.loads(to_json([weak]))
    (beside, *_) = json.loads(to_json([weak, *[explained(NOTHING)] * 9]))
    assert (alone["stands"], beside["stands"]) == (True, False)
    assert alone["verdict"] == beside["verdict"] == "named"
    assert alone["p_value"] == beside["p_value"] == 0.02


@pytest.mark.long
@pytest.mark.browser
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_remark_is_seen_on_a_phone(windows, written, theme):
    """It stands inside the screen, right under the finding that it holds back."""
    page = windows.open(
        written.html.as_uri(), viewport={"width": 390, "height": 800}, color_scheme=theme
    )
    remark = page.locator(".held-back")
    assert remark.count() == 1
    assert remark.is_visible()
    box = remark.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390
