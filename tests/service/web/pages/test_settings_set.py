"""Schedules and limits set on the pages: checked, signed, apart from the plant file, exported."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from stemwatch.models.limits import Limits
from stemwatch.service.config import load_plant
from stemwatch.service.config.in_force import as_plant_toml, limits_in_force
from stemwatch.service.config.service_schema import ScheduleTable
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.runs.schedules import FROM_BROWSER, FROM_FILE
from stemwatch.service.store.store import Store
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import NOW, STICKY
from tests.service.web.signed_in import NAMES

NIGHTLY = {"name": "nightly", "cron": "30 2 * * *", "window_hours": "24", "spread_minutes": "10"}
FILE = """
[limits]
sticky_S_percent = 2.0
[[schedules]]
name = "weekly"
cron = "0 5 * * 1"
"""


@pytest.fixture
def site(live: Site, tmp_path: Path) -> Site:
    """The small plant with a plant file that names one limit and one schedule."""
    file = tmp_path / "named.toml"
    file.write_text(FILE, encoding="utf-8")
    plant = load_plant(file, environment={})
    live.store.schedules.take_from_file(plant.schedules)
    return replace(live, plant=plant)


def sender(client: httpx.Client) -> Callable[..., httpx.Response]:
    """Sends a form with the token of the settings page."""
    page = client.get("/runs")
    mark = re.search(r'name="mark" value="([0-9a-f]+)"', page.text)

    def post(path: str, **fields: str) -> httpx.Response:
        return client.post(path, data={"mark": mark[1] if mark else "", **fields})

    return post


def test_a_schedule_is_made_changed_and_removed(site: Site, client_of) -> None:
    """Signed and dated, in force at once, and noted in the audit log."""
    client = client_of(site)
    post = sender(client)
    assert post("/settings/schedule", **NIGHTLY).status_code == 303
    stored = {schedule.schedule.name: schedule for schedule in site.store.schedules.all()}
    assert stored["nightly"].origin == FROM_BROWSER
    assert stored["nightly"].schedule == ScreeningSchedule(
        name="nightly", cron="30 2 * * *", window_s=86400.0, jitter_s=600.0
    )
    page = client.get("/settings").text
    assert f"set here by <bdi>{NAMES[UserRole.ADMIN]}" in page
    assert post("/settings/schedule", **NIGHTLY | {"cron": "", "every_hours": "0.5"})
    changed = {
        schedule.schedule.name: schedule.schedule for schedule in site.store.schedules.all()
    }["nightly"]
    assert (changed.cron, changed.every_s) == (None, 1800.0)
    assert post("/settings/schedule/remove", name="nightly").status_code == 303
    assert [schedule.schedule.name for schedule in site.store.schedules.all()] == ["weekly"]
    sentences = [
        entry.about for entry in site.store.audit.read(AuditFilter(action="change settings"))
    ]
    assert sum("name nightly" in about for about in sentences) == 3


def test_the_plant_file_stays_the_source_of_what_it_names(site: Site, client_of) -> None:
    """Neither its schedules nor its limits are changed here, and the page says where."""
    client = client_of(site)
    post = sender(client)
    refused = post("/settings/schedule", **NIGHTLY | {"name": "weekly"})
    assert refused.status_code == 409
    assert "stands in the plant file" in refused.text
    assert post("/settings/schedule/remove", name="weekly").status_code == 404
    refused = post("/settings/limits", sticky_S_percent="3")
    assert refused.status_code == 422
    assert "stands in the plant file, which is its source" in refused.text
    assert site.limits.sticky_S_percent == 2.0
    assert [schedule.origin for schedule in site.store.schedules.all()] == [FROM_FILE]


def test_a_name_that_the_file_takes_becomes_the_files(site: Site, client_of) -> None:
    """At the next start the file's schedule holds, and is no longer removed here."""
    post = sender(client_of(site))
    assert post("/settings/schedule", **NIGHTLY).status_code == 303
    theirs = ScreeningSchedule(name="nightly", every_s=60.0)
    site.store.schedules.take_from_file([theirs])
    assert [(schedule.schedule, schedule.origin) for schedule in site.store.schedules.all()] == [
        (theirs, FROM_FILE)
    ]
    assert post("/settings/schedule/remove", name="nightly").status_code == 404


def test_the_file_does_not_touch_schedules_of_other_names(site: Site, client_of) -> None:
    """A restart keeps what was set here."""
    assert sender(client_of(site))("/settings/schedule", **NIGHTLY).status_code == 303
    site.store.schedules.take_from_file(site.plant.schedules if site.plant else ())
    assert {schedule.schedule.name for schedule in site.store.schedules.all()} == {
        "weekly",
        "nightly",
    }


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"cron": "at noon"}, "five cron fields"),
        ({"cron": ""}, "neither cron nor every_s"),
        ({"every_hours": "1"}, "both cron and every_s"),
        ({"cron": "", "every_hours": "0.001"}, "10 or more"),
        ({"window_hours": "-1"}, "above 0"),
        ({"window_hours": "soon"}, "window hours: found &#39;soon&#39;; expected a number"),
        ({"window_hours": "nan"}, "expected a number"),
        ({"spread_minutes": "1e9"}, "0 to 86400"),
        ({"name": ""}, "name"),
        ({"area": "Area 999"}, "there is no area"),
        ({"valves": "FIC-999"}, "there is no valve"),
    ],
)
def test_a_schedule_that_cannot_hold_is_refused(site: Site, client_of, changes, text) -> None:
    """With what was found and what is expected; nothing is changed."""
    refused = sender(client_of(site))("/settings/schedule", **NIGHTLY | changes)
    assert refused.status_code == 422
    assert text in refused.text
    assert len(site.store.schedules.all()) == 1


def test_a_refused_form_comes_back_as_it_was_typed(site: Site, client_of) -> None:
    """Nobody types ten fields again for one mistake, and what was typed is text and no markup."""
    sent = NIGHTLY | {"window_hours": "soon", "valves": '"><b>X', "off": "1"}
    page = sender(client_of(site))("/settings/schedule", **sent).text
    assert "<details open>" in page
    for name, value in sent.items():
        if name in ("name", "cron", "window_hours"):
            assert f'name="{name}" value="{value}"' in page, name
    assert 'name="valves" value="&#34;&gt;&lt;b&gt;X"' in page
    assert 'name="off" value="1" checked' in page
    assert "<details open>" not in client_of(site).get("/settings").text
    refused = sender(client_of(site))("/settings/limits", watch_S_percent="a lot")
    assert refused.status_code == 422
    assert 'name="watch_S_percent" value="a lot"' in refused.text


def test_a_limit_that_is_set_holds_from_the_next_run_on(site: Site, client_of) -> None:
    """It is what pages and runs go by, until it is taken back."""
    client = client_of(site)
    post = sender(client)
    assert post("/settings/limits", watch_S_percent="1.0", min_samples="").status_code == 303
    assert site.limits == replace(Limits(), watch_S_percent=1.0, sticky_S_percent=2.0)
    history = client.get("/api/v1/valve/history", params={"id": STICKY}).json()
    assert (history["watch_S_percent"], history["sticky_S_percent"]) == (1.0, 2.0)
    page = client.get("/settings").text
    assert re.search(r"watch_S_percent</code>.*?>1<.*?set here by", page, re.DOTALL)
    entry = site.store.audit.read(AuditFilter(action="change settings"))[0]
    assert "watch_S_percent 0.75 -> 1" in entry.about
    assert post("/settings/limits", watch_S_percent="").status_code == 303
    assert site.limits.watch_S_percent == Limits().watch_S_percent


@pytest.mark.parametrize(
    ("name", "text", "answer"),
    [
        ("watch_S_percent", "2.5", "watch_S_percent &lt;= sticky_S_percent"),
        ("watch_S_percent", "much", "expected a number"),
        ("watch_S_percent", "nan", "expected"),
        ("watch_S_percent", "inf", "expected"),
        ("min_fit_percent", "-5", "0 or more"),
        ("min_samples", "5000", "fitted_samples of at least min_samples"),
    ],
)
def test_a_limit_that_cannot_hold_is_refused(site: Site, client_of, name, text, answer) -> None:
    """A limit must be a number and must not contradict the others, the file's included."""
    before = site.limits
    refused = sender(client_of(site))("/settings/limits", **{name: text})
    assert refused.status_code == 422
    assert answer in refused.text
    assert site.limits == before


def test_limits_that_contradict_a_later_file_are_not_in_force(store: Store, tmp_path) -> None:
    """What was set stays aside, and the file's limits hold."""
    store.browser_settings.set_limits({"watch_S_percent": 1.4}, "Ann", NOW)
    file = tmp_path / "plant.toml"
    file.write_text("[limits]\nsticky_S_percent = 1.2\n", encoding="utf-8")
    plant = load_plant(file, environment={})
    assert limits_in_force(plant, store.browser_settings.limits()) == plant.limits
    file.write_text("[limits]\nwatch_S_percent = 0.9\n", encoding="utf-8")
    plant = load_plant(file, environment={})
    assert limits_in_force(plant, store.browser_settings.limits()).watch_S_percent == 0.9


@pytest.mark.parametrize("role", [UserRole.VIEWER, UserRole.ENGINEER])
def test_only_admins_set_anything(site: Site, client_of, role: UserRole) -> None:
    """Others read the page, without forms; a form of theirs is refused."""
    client = client_of(site, role)
    page = client.get("/settings")
    assert page.status_code == 200
    assert "/settings/limits" not in page.text
    post = sender(client)
    assert post("/settings/limits", watch_S_percent="1").status_code == 403
    assert post("/settings/schedule", **NIGHTLY).status_code == 403
    assert post("/settings/schedule/remove", name="weekly").status_code == 403


def test_a_form_without_its_token_or_from_elsewhere_is_refused(site: Site, client_of) -> None:
    """Another site's page cannot set a limit in an admin's name."""
    client = client_of(site)
    for path in ("/settings/limits", "/settings/schedule", "/settings/schedule/remove"):
        forged = client.post(path, data={"mark": "0" * 64, "watch_S_percent": "1", **NIGHTLY})
        assert forged.status_code == 403
        foreign = client.post(path, data=NIGHTLY, headers={"origin": "https://x.example"})
        assert foreign.status_code == 403
    assert site.limits.watch_S_percent == Limits().watch_S_percent


def test_what_was_set_is_given_as_text_for_the_plant_file(site: Site, client_of) -> None:
    """Pasted there it means the same, and what the file names already is not in it."""
    client = client_of(site)
    post = sender(client)
    assert "Nothing was set" in client.get("/settings/plant.toml").text
    post("/settings/limits", watch_S_percent="1.25")
    post("/settings/schedule", **NIGHTLY | {"area": "Area 100", "valves": STICKY, "off": "1"})
    read = tomllib.loads(client.get("/settings/plant.toml").text)
    assert read["limits"] == {"watch_S_percent": 1.25}
    (table,) = read["schedules"]
    stored = {schedule.schedule.name: schedule.schedule for schedule in site.store.schedules.all()}
    assert ScheduleTable.model_validate(table).schedule() == stored["nightly"]


def test_hostile_names_are_written_as_toml() -> None:
    """Quotes, line breaks, what lies beyond 16 bits and U+007F come back as they were."""
    for name in ('a"b\\c', "x\ny\t[limits]", "\U0001f527", "d\x7fe"):
        schedule = ScreeningSchedule(name=name, every_s=60.0, areas=(name,))
        (table,) = tomllib.loads(as_plant_toml({}, [schedule]))["schedules"]
        assert (table["name"], table["areas"]) == (name, [name])


def test_a_schedule_without_a_window_says_how_far_back_it_looks(
    live: Site, tmp_path: Path, client_of
) -> None:
    """What the plant file says of stored samples stands there, not "all there is"."""
    file = tmp_path / "short.toml"
    file.write_text(FILE + "[service]\nwindow_s = 7200\n", encoding="utf-8")
    plant = load_plant(file, environment={})
    live.store.schedules.take_from_file(plant.schedules)
    page = client_of(replace(live, plant=plant)).get("/settings").text
    says = "whole files; of stored samples the last 2 h"
    assert f'<td data-label="Looks back">{says}</td>' in page
    assert f"(empty: {says})" in page
