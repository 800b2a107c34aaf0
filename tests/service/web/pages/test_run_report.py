"""The report of a run on its page: all four files, and nothing beside them."""

from __future__ import annotations

import html
import re
from datetime import timedelta

import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance import write_maintenance
from stemwatch.service.maintenance.write_maintenance import WORK_FILES
from stemwatch.service.report import ReportContext, write_report
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState
from tests.service.web.example_plant import HEALTHY, NOW, STICKY, screening, serving
from tests.service.web.signed_in import cookie_of

LATER = NOW + timedelta(hours=1)


def finished(live, folder) -> int:
    """A run whose report is said to lie in ``folder``."""
    number = live.store.queue.put(RunToQueue(who="K"), software_version="0.1")
    live.store.queue.claim("worker")
    live.store.queue.finish(number, RunState.DONE, report=str(folder))
    return number


@pytest.fixture
def reported(live) -> int:
    """A run with a report where the plant keeps its reports."""
    folder = live.plant.beside(live.plant.service.reports) / "run-000099"
    write_report([screening(STICKY)], ReportContext(started=NOW), folder)
    return finished(live, folder)


def test_the_run_leads_to_its_report(client, reported):
    """The page is shown, tables are offered as files named after the run."""
    page = client.get(f"/run?id={reported}").text
    for name in ("report.html", "valves.csv", "valves.xlsx", "valves.json"):
        assert f"file={name}" in page
        answer = client.get(f"/run/report?id={reported}&file={name}")
        assert answer.status_code == 200
        kept = answer.headers.get("content-disposition", "")
        assert (f"run-{reported}-{name}" in kept) == (name != "report.html")
    assert STICKY in client.get(f"/run/report?id={reported}").text


def test_a_valve_leads_to_its_page_for_maintenance(live, client, reported):
    """Where the run that found it kept one, to that very page; a healthy valve has none."""
    folder = live.plant.beside(live.plant.service.reports) / "run-000099"
    matching = [
        screening(STICKY, at=LATER),
        screening(HEALTHY, Verdict.HEALTHY, 0.2, 0.0, at=LATER),
    ]
    for item in matching:
        live.store.save(item, reported)
    address = f"/run/report?id={reported}&amp;file=maintenance.html#"
    assert address not in client.get("/valve", params={"id": STICKY}).text
    write_maintenance(matching, ReportContext(started=NOW), folder)
    page = client.get("/valve", params={"id": STICKY}).text
    place = page.partition(address)[2].partition('"')[0]
    assert f'id="{place}"' in client.get(f"/run/report?id={reported}&file=maintenance.html").text
    assert address not in client.get("/valve", params={"id": HEALTHY}).text


def test_links_of_the_report_to_the_files_beside_it_lead_to_them(live, client):
    """On a disk they are names of files in its folder; here the same page leads to this route."""
    folder = live.plant.beside(live.plant.service.reports) / "run-000098"
    context = ReportContext(started=NOW, work_files=WORK_FILES)
    write_report([screening(STICKY)], context, folder)
    write_maintenance([screening(STICKY)], context, folder)
    on_disk = re.findall(r'href="([^#"]+)"', (folder / "report.html").read_text("utf-8"))
    assert set(on_disk) == {*WORK_FILES, "valves.xlsx", "valves.csv", "valves.json"}
    assert all((folder / name).is_file() for name in on_disk)
    page = client.get(f"/run/report?id={finished(live, folder)}")
    links = re.findall(r'href="([^#"]+)"', page.text)
    assert len(links) == len(on_disk)
    for link in links:
        assert client.get(str(page.url.join(html.unescape(link)))).status_code == 200, link


def test_the_report_is_served_in_a_sandbox(client, reported):
    """Without an origin it reaches neither the service nor its cookies."""
    policy = client.get(f"/run/report?id={reported}").headers["content-security-policy"]
    assert policy.startswith("sandbox ")
    assert "allow-same-origin" not in policy
    assert "connect-src" not in policy


@pytest.mark.parametrize("name", ["../plant.toml", "plant.toml", "report.html/..", ""])
def test_only_the_files_of_a_report_are_served(client, reported, name):
    """No name leads anywhere else."""
    answer = client.get("/run/report", params={"id": reported, "file": name})
    assert answer.status_code == 404


def test_a_report_outside_the_plants_folder_is_not_served(live, client, tmp_path):
    """Whatever the database says, no other folder is read."""
    elsewhere = tmp_path / "elsewhere"
    write_report([screening(STICKY)], ReportContext(started=NOW), elsewhere)
    number = finished(live, elsewhere)
    assert client.get(f"/run/report?id={number}").status_code == 404
    up = live.plant.beside(live.plant.service.reports) / ".." / "elsewhere"
    assert client.get(f"/run/report?id={finished(live, up)}").status_code == 404


@pytest.mark.parametrize("run", ["0", "-1", "x", "9" * 30, "1"])
def test_a_run_without_a_report_says_so(client, run):
    """Not found, with a sentence."""
    answer = client.get("/run/report", params={"id": run})
    assert answer.status_code == 404
    assert "is not kept" in answer.text


@pytest.mark.browser
def test_the_report_works_in_its_sandbox(windows, live, reported):
    """Its plots are drawn and nothing is logged, although it has no origin."""
    with serving(live) as base:
        ((name, value),) = cookie_of(live).items()
        errors: list[str] = []
        page = windows.open(
            f"{base}/run/report?id={reported}",
            cookies=[{"name": name, "value": value, "url": base}],
            logged=errors,
        )
        page.locator("#ranking-table tbody tr").wait_for()
        page.locator(".plot-travel canvas").first.wait_for()
        windows.close()
    assert errors == []
