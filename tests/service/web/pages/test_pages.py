"""What the pages say: about a valve, about nothing at all, about the API itself."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape

import pytest

from stemwatch.service.config import load_plant
from stemwatch.service.presenter.finding import present_effect
from stemwatch.service.store.samples.sources import SourceState, TakenFile
from stemwatch.service.web.site import Site
from tests.service.example_mismatches import named
from tests.service.web.example_plant import BLIND, HOSTILE, NOW, SOURCE, STICKY, screening
from tests.service.web.signed_in import cookie_of


def page_of(client, valve: str) -> str:
    """A valve's page as running text without tags."""
    answer = client.get("/valve", params={"id": valve})
    assert answer.status_code == 200
    return " ".join(re.sub(r"<[^>]+>", " ", answer.text).split())


def test_a_valves_page_says_what_was_found_and_what_is_known(client):
    """Finding, numbers with intervals, alerts, notes, work, baseline, tags: all of it."""
    text = page_of(client, STICKY)
    for answer in (
        f"The stem of {STICKY} was looked at.",
        "4.00 %",
        "3.60 to 4.40",
        "sticks: S 4.0 %",
        "squeaks &lt;b&gt;loudly&lt;/b&gt;",
        "packing renewed",
        "Dead band plus stick band",
        f"{STICKY}.ZT",
        "2026-03-30 13:00 to 14:00 (Europe/Berlin)",
    ):
        assert answer in text


def test_an_alert_tells_S_when_it_was_raised_and_now(client):
    """On the valve's page, on that of alerts and in JSON: who plans the work sees that it grew."""
    said = "S 2.10 % (1.90 to 2.30) when raised, 4.00 % (3.60 to 4.40) when last found."
    assert said in page_of(client, STICKY)
    assert said in client.get("/alerts").text.replace("\N{NO-BREAK SPACE}", " ")
    first, *_ = client.get("/api/v1/alerts").json()
    assert (first["S"], first["S_when_raised"]) == (4.0, 2.1)


def test_a_valve_that_left_the_plant_file_is_marked(live, client_of):
    """In the ranking and on its page: its last finding must not be taken for one of today."""
    assert live.plant is not None
    fewer = {name: of for name, of in live.plant.valves.items() if name != STICKY}
    client = client_of(replace(live, plant=replace(live.plant, valves=fewer)))
    assert "The plant file does not name this valve" in page_of(client, STICKY)
    row = client.get("/").text.partition(f"<bdi>{STICKY}</bdi>")[2].partition("</th>")[0]
    assert "not in the plant file" in row
    client = client_of(live)
    assert "The plant file does not name" not in page_of(client, STICKY)
    assert "not in the plant file" not in client.get(f"/?q={STICKY}").text


def test_a_valve_without_a_verdict_says_why(client):
    """The reason stands where the numbers would, and no number looks like one."""
    text = page_of(client, BLIND)
    assert "Why there is no verdict" in text
    assert "S and J are not known" in text


def test_plots_are_called_by_the_signals_in_them(live, client_of):
    """PV stands in for a position that is not recorded; the heading does not call it the stem."""
    assert live.plant is not None
    entry = live.plant.valves[STICKY]
    without = entry.model_copy(update={"tags": entry.tags.model_copy(update={"mv": None})})
    plant = replace(live.plant, valves={**live.plant.valves, STICKY: without})
    for site, travel, loop in (
        (live, "Controller output and stem", "Stem against controller output"),
        (replace(live, plant=plant), "Controller output", "Process against controller output"),
    ):
        page = client_of(site).get(f"/valve?id={STICKY}").text
        assert f"<figcaption>{travel}</figcaption>" in page
        assert f"<figcaption>{loop}</figcaption>" in page
        # A baseline is a model of how MV follows OP.
        has_position = site is live
        assert ("Set the baseline" in page) is has_position
        assert ("no baseline without a measured position" in page) is not has_position


def test_what_the_model_leaves_out_is_on_the_page(live, client):
    """Named effects come back from the database with all they say."""
    run = live.store.begin_run(software_version="0.1")
    selection = named()
    live.store.save(screening(STICKY, mismatch=selection), run)
    text = page_of(client, STICKY)
    assert "Where simulation and recording differ" in text
    assert present_effect(selection.effects[0]).check in unescape(text)
    assert "◆" in client.get("/").text


def test_a_valve_of_the_plant_file_that_no_run_met_has_a_page(store, client_of, tmp_path):
    """It says that nothing is known yet, and can be screened from there."""
    from tests.service.web.example_plant import plant_of

    client = client_of(Site(store=store, plant=plant_of(tmp_path, store)))
    text = page_of(client, STICKY)
    assert "No run has screened it" in text
    assert "Run now" in text


@pytest.mark.parametrize("valve", ["nobody", "", "\x00", "x" * 5000, "FIC-101 ", "fic-101"])
def test_a_valve_that_is_not_there_is_not_found(client, valve):
    """Names are taken letter by letter, and the page says so."""
    answer = client.get("/valve", params={"id": valve})
    assert answer.status_code == 404
    assert "There is no valve" in answer.text


@pytest.mark.parametrize(
    "path", ["/", "/alerts", "/alerts?state=all", "/runs", "/sources", "/settings", "/api/docs"]
)
def test_an_empty_database_makes_pages_that_help(store, client_of, path):
    """The first start shows what to do next on every page."""
    client = client_of(Site(store=store))
    answer = client.get(path)
    assert answer.status_code == 200
    if path == "/":
        assert "stemwatch serve --plant plant.toml" in answer.text


def test_sources_say_how_they_are(live, client):
    """In order, at fault with its words, and files that were taken in or not. What is counted is
    said to begin anew with a restart; a folder has files and no last sample."""
    fault = "no answer within 1 s; tried again in 30 s"
    state = SourceState(
        source="gateway 2", kind="modbus", connected=False, fault=fault, updated=NOW
    )
    live.store.sources.note(state)
    figures = {"taken": 0.0}
    drop = SourceState(source="drop", kind="folder", connected=True, figures=figures, updated=NOW)
    live.store.sources.note(drop)
    rejected = TakenFile(
        digest="ab", name="<b>.pdf", source=SOURCE, accepted=False, note="It is not text."
    )
    live.store.sources.note_taken(rejected)
    text = client.get("/sources").text
    assert "in order" in text
    assert fault in text
    assert "&lt;b&gt;.pdf" in text
    assert "rejected" in text
    card = text[text.index("<bdi>drop</bdi>") :].partition("</li>")[0]
    assert ("Last file taken in" in card, "Last good sample" in card) == (True, False)
    assert "Counted since the reading of this source last began." in card


def test_a_source_that_nobody_speaks_for_is_silent(live, client):
    """The collector's last word is not taken for the present."""
    from datetime import timedelta

    object.__setattr__(live, "clock", lambda: NOW + timedelta(minutes=10))
    assert ">silent<" in client.get("/sources").text


def test_the_api_describes_every_operation_it_has(client):
    """Each has a description, and the plain page shows every path and every shape."""
    document = client.get("/api/openapi.json").json()
    page = client.get("/api/docs").text
    assert len(document["paths"]) >= 15
    for path, methods in document["paths"].items():
        assert path in page
        for operation in methods.values():
            assert len(operation["description"]) > 15
    for name, shape in document["components"]["schemas"].items():
        assert f'id="shape-{name}"' in page
        assert shape["description"]


def test_the_ranking_over_the_api_is_that_of_the_page(client):
    """Same order, same numbers, the hostile name as it is."""
    result = client.get("/api/v1/valves", params={"verdict": ["sticky", "watch"]}).json()
    assert [line["valve"] for line in result["valves"]][:2] == [STICKY, HOSTILE]
    assert result["valves"][0]["S"]["value"] == pytest.approx(4.0)
    assert result["total"] == 3
    assert result["counts"]["healthy"] == 1


def test_unknown_numbers_are_null_with_their_reason(client):
    """Neither NaN nor zero."""
    valve = client.get("/api/v1/valves", params={"q": BLIND}).json()["valves"][0]
    assert valve["S"]["value"] is None
    assert valve["S"]["reason"] == "OP moved less than 0.5 %"


def test_the_history_has_limits_points_and_marks(client):
    """What the months chart draws, oldest first."""
    result = client.get("/api/v1/valve/history", params={"id": STICKY}).json()
    S = [point["S"] for point in result["points"]]
    assert S == sorted(S)
    assert len(S) == 6
    assert result["sticky_S_percent"] == 1.5
    assert [mark["kind"] for mark in result["marks"]] == ["baseline", "maintenance", "note"]


@pytest.mark.parametrize(
    ("start", "stop", "text"),
    [
        ("2026-03-30T12:00:00Z", "2026-03-30T11:00:00Z", "at least a second"),
        ("2026-01-01T00:00:00Z", "2026-03-30T11:00:00Z", "at most 31 days"),
        ("0001-01-01T00:00:00+14:00", "0001-01-02T00:00:00Z", "between 1970 and 2200"),
        ("2026-03-30T11:00:00", "2026-03-30T12:00:00Z", "timezone"),
        ("yesterday", "2026-03-30T12:00:00Z", "start"),
    ],
)
@pytest.mark.parametrize("what", ["signals", "loop"])
def test_a_window_that_makes_no_sense_is_refused(client, what, start, stop, text):
    """With a sentence that says which window is expected."""
    fields = {"id": STICKY, "start": start, "stop": stop}
    answer = client.get(f"/api/v1/valve/{what}", params=fields)
    assert answer.status_code == 422
    assert text in answer.json()["detail"]


def test_json_of_the_api_is_strict(live, client):
    """No NaN or Infinity stands in it, whatever a source's figures were."""
    figures = {"lateness_s": float("nan"), "polls": 4.0}
    live.store.sources.note(SourceState(source="odd", kind="modbus", figures=figures))

    def refuse(word: str) -> float:
        raise AssertionError(word)

    loaded = json.loads(client.get("/api/v1/sources").text, parse_constant=refuse)
    assert [item["figures"] for item in loaded if item["source"] == "odd"] == [
        {"lateness_s": None, "polls": 4.0}
    ]


def test_behind_a_proxy_every_link_keeps_the_prefix(live):
    """With a root path, no link leads out of it."""
    import asyncio

    import httpx

    from stemwatch.service.web.app import create_app

    transport = httpx.ASGITransport(create_app(live), root_path="/stem")

    async def ask() -> str:
        async with httpx.AsyncClient(
            transport=transport, base_url="http://localhost", cookies=cookie_of(live)
        ) as client:
            return (await client.get("/valve", params={"id": STICKY})).text

    text = asyncio.run(ask())
    inside = re.findall(r"""(?:href|src|action)="(/[^"]*)""", text)
    assert len(inside) > 10
    assert [item for item in inside if not item.startswith("/stem/")] == []


def test_settings_show_the_keys_of_a_device_that_its_link_has(store, client_of, tmp_path):
    """As the plant file spells them: no baud rate of a connection over TCP, no port number of a
    serial line."""
    register = """
[[devices.registers]]
tag = "{name}.OP"
register = "holding"
address = 0
type = "UINT16"
"""
    file = tmp_path / "plant.toml"
    file.write_text(
        '[[devices]]\nname = "plc"\nhost = "10.1.2.3"\n'
        + register.format(name="plc")
        + '[[devices]]\nname = "bus"\ntype = "serial"\nserial_port = "COM3"\n'
        + register.format(name="bus"),
        encoding="utf-8",
    )
    plant = load_plant(file)
    assert plant.problems == ()
    page = client_of(Site(store=store, plant=plant)).get("/settings").text
    _, plc, bus = re.split("Source <bdi>", page)
    common = {
        "registers",
        "every_s",
        "timeout_s",
        "retries",
        "pause_s",
        "max_words",
        "max_gap",
        "latest_answer_s",
    }
    serial = {"serial_port", "baudrate", "bytesize", "parity", "stopbits"}
    keys = r"<dt><code>(\w+)</code>"
    assert set(re.findall(keys, plc)) == {"type", "host", "port"} | common
    assert set(re.findall(keys, bus)) == {"type"} | serial | common
