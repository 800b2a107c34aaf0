"""A long recording, explained as windows: sentence, JSON, page and terminal agree."""

from __future__ import annotations

import io
import json
import re
from datetime import UTC, datetime
from importlib.resources import files

import jsonschema
import pytest
from rich.console import Console

from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Recording
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator.loop import PlantLoop, Transmitters
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.studies.simulator.valve import Actuator, SimulatedValve
from stemwatch.service.cli.explanation_views import explanation
from stemwatch.service.explain.explain_json import to_json
from stemwatch.service.explain.explain_recording import Explained, explain_recording
from stemwatch.service.explain.write_explanation import write_pages
from stemwatch.service.presenter.wording import span_percent
from stemwatch.service.report import ReportContext, to_contract

SCHEMA = json.loads(
    files("stemwatch.service.explain").joinpath("explain.schema.json").read_text("utf-8")
)
WINDOWS, SAMPLES = 5, 700
LIMITS = Limits(fitted_samples=float(SAMPLES))


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A valve whose air is slow, over five windows."""
    moves = tuple((60.0 + 110.0 * k, 50.0 + (-1) ** k * (6.0 + k % 5)) for k in range(32))
    loop = PlantLoop(
        tag="FIC-1",
        valve=SimulatedValve(S=3.0, J=1.0, actuator=Actuator(air_lag_s=4.0)),
        transmitters=Transmitters(position_noise=0.05),
        setpoints=moves,
        duration_s=float(WINDOWS * SAMPLES),
    )
    return simulate_loop(loop, 3).recording


@pytest.fixture(scope="module")
def result(recording: Recording) -> Explained:
    """Its explanation."""
    return explain_recording(recording, "long.csv", narx=False, limits=LIMITS)


@pytest.mark.long
def test_windows_that_agree_name_the_effect_and_pool_s_and_j(result):
    """The sentence counts the windows, and S lies near the truth with an interval that holds it."""
    evidence = result.by_window
    assert evidence is not None
    assert len(evidence.windows) == WINDOWS
    assert result.mismatch.finding in (Finding.NAMED, Finding.CANDIDATES)
    assert [finding.slug for finding in evidence.confirmed] == ["actuator_lag"]
    assert f"of {WINDOWS} windows of the recording, which confirms it." in result.mismatch.sentence
    assert evidence.pooled_sentence in result.mismatch.sentence
    assert "What follows is of the window of 0.194 h" in result.mismatch.sentence
    assert evidence.pooled.S.low < 3.0 < evidence.pooled.S.high


def test_s_and_j_are_those_of_the_verdict_and_others_are_called_alternatives(
    result, recording, tmp_path
):
    """In JSON, page and terminal: what `screen` says of the valve, and what the windows say."""
    (screened,) = screen([Case(recording=recording)], Options(limits=LIMITS, narx=False))
    (told,) = json.loads(to_json([result]))
    assert told["stiction"]["restated"] == to_contract(screened)["stiction"]
    pooled = result.by_window.pooled
    assert pooled.S != screened.S
    assert "an alternative, since of a valve and window the S and J of the verdict count" in (
        result.mismatch.sentence
    )
    console = Console(width=300, record=True, file=io.StringIO())
    console.print(explanation(result))
    lines = [line.strip() for line in console.export_text().splitlines()]
    (counts,) = [line for line in lines if line.startswith("of this valve")]
    (over,) = [line for line in lines if line.startswith("not used: over the windows")]
    assert re.findall(r"[\d.]+", counts)[0] == span_percent(screened.S.value)
    assert re.findall(r"[\d.]+", over)[0] == span_percent(pooled.S.value)
    started = datetime(2026, 3, 2, tzinfo=UTC)
    page = write_pages([result], ReportContext(started=started, zone="UTC"), tmp_path).html
    text = " ".join(page.read_text("utf-8").split())
    of_valve, alternative = text.partition('<th scope="row">of this valve</th>')[2].split(
        'alternative, not used <span class="quiet">over the windows that name just that</span>', 1
    )
    assert f"<b>{span_percent(screened.S.value)} %</b>" in of_valve[:60]
    assert f"<b>{span_percent(pooled.S.value)} %</b>" in alternative[:80]


def test_json_says_what_each_window_named(result):
    """Seconds from the beginning, by the schema; a short recording has null."""
    objects = json.loads(
        to_json([result, Explained(source="", valve="", mismatch=result.mismatch)])
    )
    jsonschema.validate(objects, SCHEMA)
    by_window = objects[0]["by_window"]
    assert [window["begin_s"] for window in by_window["windows"]] == [
        SAMPLES * k for k in range(WINDOWS)
    ]
    assert [window["end_s"] for window in by_window["windows"]] == [
        SAMPLES * (k + 1) for k in range(WINDOWS)
    ]
    named = sum(
        ["actuator_lag"] in [row[:1] for row in window["named"]] for window in by_window["windows"]
    )
    assert by_window["findings"][0]["named"] == named
    assert by_window["findings"][0]["confirmed"] is True
    assert by_window["S"]["value"] == result.by_window.pooled.S.value
    assert objects[1]["by_window"] is None


def test_page_and_terminal_show_the_evidence_by_window(result, tmp_path):
    """The picture has hours into the recording below it; the traces are of all of it."""
    started = datetime(2026, 3, 2, tzinfo=UTC)
    page = write_pages([result], ReportContext(started=started, zone="UTC"), tmp_path).html
    text = page.read_text("utf-8")
    assert "Over the windows of this recording" in text
    assert ">0 h</text>" in text
    assert "with its beginning below" in text
    assert len(result.recording) == WINDOWS * SAMPLES
    console = Console(width=300, record=True)
    console.print(explanation(result))
    assert "windows of the recording, which confirms it." in console.export_text()
