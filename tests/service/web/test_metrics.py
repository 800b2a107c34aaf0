"""``/metrics``: numbers that agree with the store, few series, and rules and docs that fit them."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from prometheus_client.parser import text_string_to_metric_families

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.collector import Spool
from stemwatch.service.collector.spool import backlog
from stemwatch.service.config import load_plant
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.screenings.records import RunState, ValveState
from stemwatch.service.store.store import Store
from stemwatch.service.web.metrics import metrics_text
from stemwatch.service.web.site import Check, Site
from tests.service.web.example_plant import HEALTHY, HOSTILE, NOW, STICKY, WATCH

ROOT = Path(__file__).parents[3]
RULES = ROOT / "deploy" / "prometheus" / "stemwatch.rules.yml"
DOCS = ROOT / "docs" / "operations.md"
DEVICE = """
[service]
spool = "spool"
[[notifiers]]
name = "log"
kind = "file"
path = "alerts.jsonl"
[[devices]]
name = 'plc "1"'
host = "192.0.2.1"
[[devices.registers]]
tag = "A"
address = "40001"
type = "INT16"
"""
FIGURES = {
    "polls": 100, "good": 250, "bad": 50, "missed": 2, "reconnects": 1, "refused_tags": 1,
    "dropped": 3, "store_refused": 4, "late_p99_s": 0.05, "poll_p99_s": 0.03,
}  # fmt: skip

Values = dict[tuple[str, frozenset[tuple[str, str]]], float]


@pytest.fixture
def site(filled: Store, tmp_path: Path) -> Site:
    """The small plant with a device that has spoken, and a run that was finished."""
    (tmp_path / "live.toml").write_text(DEVICE, encoding="utf-8")
    plant = load_plant(tmp_path / "live.toml", environment={})
    assert plant.problems == ()
    for name in ('plc "1"', "gone"):
        last = NOW - timedelta(seconds=7)
        state = SourceState(
            source=name, kind="modbus", updated=NOW, last_good=last, figures=FIGURES
        )
        filled.sources.note(state)
    number = filled.queue.put(RunToQueue(), software_version="1")
    filled.queue.claim("w")
    filled.queue.plan(number, [STICKY, WATCH])
    filled.queue.mark(number, STICKY, ValveState.SET_ASIDE, "no result after 1 s")
    return Site(store=filled, plant=plant, clock=lambda: NOW)


def read(site: Site) -> Values:
    """Every value by its name and labels, as Prometheus reads the text."""
    deps = SimpleNamespace(site=site, store=site.store, now=site.clock())
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(metrics_text(deps).decode())
        for sample in family.samples
    }


def value(values: Values, name: str, **labels: str) -> float:
    """One value."""
    return values["stemwatch_" + name, frozenset(labels.items())]


def test_the_numbers_are_those_of_the_store(site: Site) -> None:
    """Devices, runs, verdicts, alerts and messages, each as the store has them."""
    site.store.deliveries.put({"log": {"subject": "s"}}, "k", [])
    recording = read(site)
    device = {"device": 'plc "1"'}
    assert value(recording, "database_up") == 1
    assert value(recording, "samples_total", **device, quality="good") == 250
    assert value(recording, "samples_total", **device, quality="bad") == 50
    assert value(recording, "device_last_good_age_seconds", **device) == 7
    assert value(recording, "device_lateness_p99_seconds", **device) == 0.05
    assert value(recording, "samples_dropped_total") == 3
    assert value(recording, "runs_total", outcome="done") == 6
    assert value(recording, "runs_total", outcome="failed") == 0
    assert value(recording, "queue_runs", state="running") == 1
    assert value(recording, "queue_valves") == 1
    assert value(recording, "valves_set_aside_total") == 1
    assert value(recording, "valves", verdict="sticky") == 1
    assert value(recording, "valves", verdict="watch") == 2
    assert value(recording, "valves", verdict="none") == 0
    assert value(recording, "last_run_valve_seconds", stat="mean") == pytest.approx(0.4)
    assert value(recording, "alerts_open", kind="sticky", severity="high") == 1
    assert value(recording, "alerts_open", kind="no_data", severity="high") == 0
    assert value(recording, "deliveries", notifier="log", state="waiting") == 1


def test_vital_parts_are_told(site: Site) -> None:
    """What ``/ready`` asks is a metric; a device has its own."""
    results = (Check(name="scheduler", ok=False, says="x", vital=True), Check(name="d", ok=False))
    values = read(replace(site, checks=lambda: results))
    assert value(values, "part_up", part="scheduler") == 0
    assert ("stemwatch_part_up", frozenset({("part", "d")})) not in values


def test_no_valve_and_no_tag_is_a_label(site: Site) -> None:
    """The number of series does not grow with the plant, and sources of old are no series."""
    recording = read(site)
    words = {word for _, labels in recording for _, word in labels}
    assert not words & {STICKY, WATCH, HEALTHY, HOSTILE, "A", "gone"}
    keys = {key for _, labels in recording for key, _ in labels}
    assert keys <= {
        "device", "quality", "outcome", "state", "stat", "verdict", "kind", "severity",
        "notifier", "part", "version",
    }  # fmt: skip
    assert len(recording) < 150


def test_without_the_database_the_rest_is_told(site: Site, tmp_path: Path) -> None:
    """The spool is what matters then, and it is on disk."""
    spool = Spool(tmp_path / "spool")
    spool.append(batch(NOW.timestamp() - 90))
    spool.append(batch(NOW.timestamp() - 30))
    spool.close()
    site.store.close()
    (tmp_path / "filled.db").rename(tmp_path / "away.db")
    (tmp_path / "filled.db").mkdir()
    recording = read(site)
    assert value(recording, "database_up") == 0
    assert value(recording, "spool_age_seconds") == 90
    assert value(recording, "spool_bytes") > 100
    assert ("stemwatch_queue_valves", frozenset()) not in recording


def batch(at_s: float) -> SampleBatch:
    """One sample at ``at_s`` seconds since 1970."""
    return SampleBatch(
        source="plc", tags=("A",), at_us=np.array([round(at_s * 1e6)], dtype=np.int64),
        values=np.zeros(1), quality=np.zeros(1, dtype=np.uint8), reasons=("",),
    )  # fmt: skip


def test_the_backlog_is_what_is_not_acknowledged(tmp_path: Path) -> None:
    """It shrinks as the store takes batches, is empty at the end, and where there is no spool."""
    assert backlog(tmp_path / "nowhere").size_bytes == 0
    spool = Spool(tmp_path / "spool")
    for second in (10, 20, 30):
        spool.append(batch(second))
    waiting = list(spool.waiting())
    before = backlog(spool.folder)
    assert before.oldest.timestamp() == 10
    spool.acknowledge(waiting[0].next)
    after = backlog(spool.folder)
    assert after.oldest.timestamp() == 20
    assert 0 < after.size_bytes < before.size_bytes
    spool.acknowledge(waiting[-1].next)
    assert backlog(spool.folder).oldest is None
    assert backlog(spool.folder).age_s(NOW) == 0
    spool.close()
    (spool.folder / "cursor").write_text("damaged", encoding="utf-8")
    assert backlog(spool.folder).oldest.timestamp() == 10
    shutil.rmtree(spool.folder)


def test_the_docs_list_every_metric_and_no_other(site: Site) -> None:
    """Who writes rules looks the names up there."""
    Spool(site.plant.beside("spool")).close()
    site.store.queue.finish(site.store.queue.going()[0].id, RunState.DONE)
    answer = {
        name
        for name, _ in read(replace(site, checks=lambda: [Check(name="x", ok=True, vital=True)]))
    }
    listing = set(re.findall(r"^\| `(stemwatch_\w+)`", DOCS.read_text(encoding="utf-8"), re.M))
    assert listing == answer


def test_the_example_rules_ask_for_metrics_that_there_are() -> None:
    """They are YAML as Prometheus wants it: each with a name, an expression and a summary."""
    yaml = pytest.importorskip("yaml")
    rules = yaml.safe_load(RULES.read_text(encoding="utf-8"))["groups"][0]["rules"]
    docs = DOCS.read_text(encoding="utf-8")
    listing = set(re.findall(r"`(stemwatch_\w+)`", docs))
    assert len({rule["alert"] for rule in rules}) == len(rules) > 8
    for rule in rules:
        assert set(re.findall(r"stemwatch_\w+", rule["expr"])) <= listing, rule
        assert rule["annotations"]["summary"], rule
        assert rule["labels"]["severity"] in ("critical", "warning")
        assert rule["expr"].count("(") == rule["expr"].count(")")


def test_the_example_rules_ask_for_labels_that_there_are(site: Site) -> None:
    """A rule whose label or word is misspelt never fires, and nobody notices."""
    yaml = pytest.importorskip("yaml")
    Spool(site.plant.beside("spool")).close()
    checks = replace(site, checks=lambda: [Check(name="x", ok=True, vital=True)])
    known: dict[str, set[tuple[str, str]]] = {}
    for name, labels in read(checks):
        known.setdefault(name, set()).update(labels)
    rules = yaml.safe_load(RULES.read_text(encoding="utf-8"))["groups"][0]["rules"]
    selected = [
        (name, *pair)
        for rule in rules
        for name, inside in re.findall(r"(stemwatch_\w+)\{([^}]*)\}", rule["expr"])
        for pair in re.findall(r'(\w+)="([^"]*)"', inside)
    ]
    assert len(selected) >= 5
    assert [one for one in selected if one[1:] not in known[one[0]]] == []
    for rule in rules:
        names = re.findall(r"stemwatch_\w+", rule["expr"])
        keys = {key for name in names for key, _ in known.get(name, ())}
        written = set(re.findall(r"\$labels\.(\w+)", " ".join(rule["annotations"].values())))
        assert written <= keys | {"instance"}, rule["alert"]


def test_the_address_answers_as_prometheus_asks(site: Site, client_of) -> None:
    """The text format, with its version."""
    answer = client_of(site).get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain")
    assert "stemwatch_database_up 1.0" in answer.text
