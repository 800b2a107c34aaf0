"""What if: the page with the sliders, on a sticking loop and where there is none to run."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import replace
from datetime import timedelta

import pytest

from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.service.web.pages import twin_page
from tests.models.closed_loop.test_fitted_loop import plant
from tests.models.health_indicators.test_response_figures import judged, percent
from tests.service.web.example_plant import BLIND, HOUR_S, NOW, STICKY, screening


@pytest.fixture
def looped(live, client_of):
    """The small plant with an hour of a sticking PI loop, S 5 % and J 2 %, as its valve's."""
    made = plant(5.0, 2.0)
    loop = Recording(
        valve=STICKY,
        signals={Role(name): Signal.good(values, name) for name, values in made.items()},
        interval_s=1.0,
        start=NOW - timedelta(seconds=HOUR_S),
    )
    mismatch = judged(percent(5.0), percent(2.0), question=OpenQuestion(interval=1.0)).mismatch
    found = screening(STICKY, S=5.0, J=2.0, mismatch=mismatch)
    live.store.save(found, live.store.begin_run(software_version="1"))
    return client_of(replace(live, read=lambda valve, window: loop))


def test_sliders_run_the_loop_again(looped) -> None:
    """Repair by default, with figures and a picture; at the present friction nothing is saved."""
    repaired = looped.get("/valve/what-if", params={"id": STICKY}).text
    assert "The variance of SP - PV would fall by" in repaired
    assert "Controller: gain" in repaired
    assert "PV with the change" in repaired
    assert repaired.count('type="range"') == 3
    present = {"id": STICKY, "S": "1", "gain": "1", "reset": "1"}
    assert looped.get("/valve/what-if", params=present).status_code == 200
    assert "What if</a>" in looped.get("/valve", params={"id": STICKY}).text


def test_numbers_without_sense_are_refused_by_name(looped) -> None:
    """The sentence says what is expected; no page breaks."""
    page = looped.get("/valve/what-if", params={"id": STICKY, "gain": "<b>"}).text
    assert "Controller gain, times the present: 0.25 to 4 is expected" in page
    assert "received &#39;&lt;b&gt;&#39;" in page


def test_a_loop_that_cannot_be_run_again_says_why(client) -> None:
    """The small plant's own samples are no loop: the page says what is missing."""
    page = client.get("/valve/what-if", params={"id": STICKY}).text
    assert "The loop cannot be run again" in page
    assert client.get("/valve/what-if", params={"id": "nothing"}).status_code == 404


def test_a_twin_is_fitted_once(looped, monkeypatch: pytest.MonkeyPatch) -> None:
    """Moving a slider does not fit the loop again."""
    looped.get("/valve/what-if", params={"id": STICKY})
    monkeypatch.setattr(twin_page, "read_recording", lambda *_: pytest.fail("read again"))
    page = looped.get("/valve/what-if", params={"id": STICKY, "S": "0.5"}).text
    assert "would fall by" in page


def test_the_valve_is_downloaded_for_other_simulators(looped) -> None:
    """The page links an FMU with the S and J that the page shows."""
    page = looped.get("/valve/what-if", params={"id": STICKY}).text
    link = re.search(r'href="([^"]*valve\.fmu[^"]*)"', page)
    assert link is not None
    answer = looped.get(link[1].replace("&amp;", "&"))
    assert answer.status_code == 200
    assert answer.headers["content-disposition"].endswith('.fmu"')
    with zipfile.ZipFile(io.BytesIO(answer.content)) as unit:
        described = unit.read("modelDescription.xml").decode()
    assert re.search(r'name="S" .* start="5\.0"', described)
    assert re.search(r'name="J" .* start="2\.0"', described)


def test_a_valve_without_S_has_no_model(client) -> None:
    """Neither a link nor a file, but why."""
    assert "valve.fmu" not in client.get("/valve/what-if", params={"id": BLIND}).text
    answer = client.get("/valve/what-if/valve.fmu", params={"id": BLIND})
    assert answer.status_code == 404
    assert "There is no model" in answer.text
