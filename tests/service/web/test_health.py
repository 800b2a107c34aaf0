"""What supervisors ask: alive, ready, healthy, with the reason where not, also before the pages."""

from __future__ import annotations

import json
import socket
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from stemwatch.service.config import Plant, load_plant
from stemwatch.service.scheduler import Scheduler
from stemwatch.service.serve.health_checks import health_checks
from stemwatch.service.serve.startup_server import REASON, StartupServer
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.store import Store
from stemwatch.service.web.site import Check, Site

DEVICE = """
[[devices]]
name = "plc-1"
host = "192.0.2.1"
[[devices.registers]]
tag = "A"
address = "40001"
type = "INT16"
"""


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    """A plant with one device."""
    (tmp_path / "live.toml").write_text(DEVICE, encoding="utf-8")
    loaded = load_plant(tmp_path / "live.toml", environment={})
    assert loaded.problems == ()
    return loaded


def said(result: list[Check]) -> dict[str, str]:
    """What the parts that do not work say, by name."""
    return {item.name: item.says for item in result if not item.ok}


def test_a_service_that_works_is_alive_ready_and_healthy(live: Site, client_of) -> None:
    """All three answer 200 without a word of what is wrong."""
    fine = (Check(name="scheduler", ok=True, vital=True), Check(name="device plc-1", ok=True))
    client = client_of(replace(live, checks=lambda: fine))
    for path in ("/health", "/ready", "/healthz"):
        answer = client.get(path)
        assert (answer.status_code, answer.json()["ok"]) == (200, True), path


def test_a_device_that_is_away_is_no_reason_not_to_be_ready(live: Site, client_of) -> None:
    """The others go on: only ``/healthz`` complains of it, and ``/ready`` does not name it."""
    results = (
        Check(name="collector", ok=True, vital=True),
        Check(name="device plc-1", ok=False, says="no connection"),
    )
    client = client_of(replace(live, checks=lambda: results))
    assert client.get("/ready").status_code == 200
    assert "plc-1" not in client.get("/ready").text
    assert client.get("/healthz").status_code == 503


def test_a_vital_part_that_does_not_work_is_the_reason(live: Site, client_of) -> None:
    """``/ready`` says which part and why; the process is alive nevertheless."""
    results = (Check(name="scheduler", ok=False, says="looked at 90 s ago", vital=True),)
    client = client_of(replace(live, checks=lambda: results))
    answer = client.get("/ready")
    assert answer.status_code == 503
    assert {"name": "scheduler", "ok": False, "says": "looked at 90 s ago"} in answer.json()[
        "checks"
    ]
    assert client.get("/health").status_code == 200


def test_without_the_database_nothing_is_ready(live: Site, client_of, tmp_path: Path) -> None:
    """The reason is said without the database's address."""
    client = client_of(live)
    assert client.get("/ready").status_code == 200
    live.store.close()
    (tmp_path / "filled.db").rename(tmp_path / "away.db")
    (tmp_path / "filled.db").mkdir()
    answer = client.get("/ready")
    assert answer.status_code == 503
    assert "the database does not answer" in answer.text
    assert str(tmp_path) not in answer.text
    assert client.get("/health").status_code == 200


def test_the_scheduler_and_the_collector_have_to_speak(store: Store, plant: Plant) -> None:
    """Before the schedules were looked at and a device was spoken of, the service is not ready."""
    scheduler = Scheduler(store, "UTC")
    assert set(said(health_checks(store, plant, scheduler))) == {
        "scheduler",
        "collector",
        "device plc-1",
    }
    scheduler.look()
    old = datetime.now(UTC) - timedelta(minutes=5)
    store.sources.note(SourceState(source="plc-1", kind="modbus", updated=old))
    assert set(said(health_checks(store, plant, scheduler))) == {"collector", "device plc-1"}
    store.sources.note(SourceState(source="plc-1", kind="modbus", fault="192.0.2.1 is away"))
    result = said(health_checks(store, plant, scheduler))
    assert list(result) == ["device plc-1"]
    assert "192.0.2.1" not in result["device plc-1"]


def test_a_part_that_has_ended_is_named(store: Store, plant: Plant) -> None:
    """A thread that must not end and did is a reason not to be ready."""
    ended = threading.Thread(target=lambda: None, name="runner")
    ended.start()
    ended.join()
    scheduler = Scheduler(store, "UTC")
    (result,) = [
        health_check
        for health_check in health_checks(store, plant, scheduler, [ended])
        if health_check.name == "runner"
    ]
    assert (result.ok, result.vital) == (False, True)


def test_a_database_that_cannot_be_written_is_a_reason(store: Store, plant: Plant) -> None:
    """On a full disk all can still be read: the last write tells, and the next that works."""
    scheduler = Scheduler(store, "UTC")
    scheduler.look()
    with store.transactions.readers.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
    raw = store.transactions.readers.raw_connection()
    raw.execute(f"PRAGMA max_page_count = {pages}")  # SQLite's own "disk is full"
    raw.close()
    with pytest.raises(StoreError, match="full"):
        store.add_note("FIC-101", datetime.now(UTC), "x" * 1_000_000)
    (result,) = [
        health_check
        for health_check in health_checks(store, plant, scheduler)
        if health_check.name == "store"
    ]
    assert (result.ok, result.vital) == (False, True)
    assert result.says == "the database cannot be written; the log says why"
    raw = store.transactions.readers.raw_connection()
    raw.execute("PRAGMA max_page_count = 1000000")
    raw.close()
    store.add_note("FIC-101", datetime.now(UTC), "x" * 1_000_000)
    assert "store" not in said(health_checks(store, plant, scheduler))


def ask(port: int, path: str) -> tuple[int, dict[str, object]]:
    """Status and JSON of what answers on ``port``."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=20) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)


def test_while_the_store_is_waited_for_the_reason_is_told() -> None:
    """Alive and not ready; and the socket is there for the pages afterwards."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        with StartupServer(listening):
            assert ask(port, "/health")[0] == 200
            for path in ("/ready", "/healthz", "/", "/metrics"):
                status, answer = ask(port, path)
                assert status == 503
                assert REASON in json.dumps(answer)
        with socket.create_connection(("127.0.0.1", port), timeout=5):
            accepted, _ = listening.accept()
            accepted.close()
