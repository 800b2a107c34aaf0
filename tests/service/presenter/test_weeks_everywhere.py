"""What the windows of weeks say of a valve has the same words in every output."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import httpx
import pytest

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.evaluate import gathered
from stemwatch.service.alerts.rules import apply_rules
from stemwatch.service.config import load_plant
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.report import ReportContext, ValveFacts, write_report
from stemwatch.service.store.store import open_store
from stemwatch.service.web.site import Site
from tests.service.maintenance.example_work_list import with_effects
from tests.service.presenter.every_kind import (
    text_of,
)
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")


def test_what_weeks_say_has_the_same_words_and_days_everywhere(tmp_path: Path) -> None:
    """JSON, report, valve page, work sheet as HTML and order, and mail, also where a window ends
    late in the evening in UTC, which is the next day in the plant."""
    tz = ZoneInfo("Asia/Singapore")
    valve = "FIC-5"
    windows = [_late_on(day, valve) for day in range(4)]
    (tmp_path / "plant.toml").write_text('[plant]\nname = "Tuas"\nzone = "Asia/Singapore"\n')
    plant = load_plant(tmp_path / "plant.toml")
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        run = store.begin_run(software_version="1")
        for item in windows:
            store.save(item.without_samples(), run)
        store.finish_run(run)
        by_window = store.evidence([valve])[valve]
        answer = by_window.sentences(tz)
        assert "first seen on 2026-03-03" in answer[0]  # in UTC it is the second
        facts = {valve: ValveFacts(by_window=by_window)}
        report_context = ReportContext(
            started=example_plant.NOW, zone="Asia/Singapore", valves=facts
        )
        files = write_report(windows[-1:], report_context, tmp_path / "report")
        (item,) = json.loads(files.json.read_text("utf-8"))
        assert [effect["sentence"] for effect in item["over_weeks"]] == list(
            answer[: len(item["over_weeks"])]
        )
        book = report_of_store(store, tmp_path / "book", plant=plant, run=run).work_list
        (record,) = gathered(store, plant, [valve], {valve: (by_window, True)})
        (alert,) = [
            apply_rule
            for apply_rule in apply_rules(record, plant.alerts)[0]
            if "MISMATCH" in apply_rule.kind.name
        ]
        site = Site(store=store, plant=plant, clock=lambda: example_plant.NOW)
        with example_plant.serving(site) as base:
            page = httpx.get(
                f"{base}/valve", params={"id": valve}, cookies=cookie_of(site), trust_env=False,
                verify=False, timeout=30.0,
            ).text  # fmt: skip
    html_texts = (files.html.read_text("utf-8"), page, work_list_html(book).decode())
    for sentence in answer:
        for text in html_texts:
            assert sentence in text_of(text).replace("\N{NO-BREAK SPACE}", " ")
    assert answer[0] in alert.text


def _late_on(day: int, valve: str) -> Screening:
    """A window that ends at half past four in the afternoon in UTC, past midnight in Singapore."""
    result = with_effects(valve, Verdict.WATCH)
    assert result.recording is not None
    start = datetime(2026, 3, 2 + day, 15, 30, tzinfo=UTC)
    return replace(result, recording=replace(result.recording, start=start))
