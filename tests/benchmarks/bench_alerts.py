"""The time for alerts after a run over 5,000 valves, and for checking 15,000 tags of ten devices.

    python tests/benchmarks/bench_alerts.py [--valves 5000] [--runs 60] [--url URL]

Prints seconds, seconds of work of this process, and how many statements each step sent.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from sqlalchemy import event, insert

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.alerts.evaluate import evaluate
from stemwatch.service.alerts.silent_sources import watch_sources
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.runs.tables import RunValveRow
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.screenings.tables import IndicatorRow, NetworkRow, ScreeningRow
from stemwatch.service.store.store import Store, open_store

NOW = datetime(2026, 3, 30, 12, 0, tzinfo=UTC)
DEVICES = 10
ROLES = ("OP", "ZT", "PV")
BAD_SHARE = 0.01


def made_plant(folder: Path, valves: int) -> Plant:
    """A plant file with a valve list and a register list for each device."""
    rows = ["id,area,criticality,source,op,mv,pv"]
    for number in range(valves):
        name, area = f"FIC-{number:05d}", 100 * (1 + number % 20)
        tags = ",".join(f"{name}.{role}" for role in ROLES)
        rows.append(f"{name},Area {area},{1 + number % 3},plc-{number % DEVICES},{tags}")
    (folder / "valves.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    text = 'valve_list = "valves.csv"\n[alerts]\nsilent_after_s = 300\n'
    for device in range(DEVICES):
        listing = ["tag,register,address,type"]
        mine = [number for number in range(valves) if number % DEVICES == device]
        for index, number in enumerate(mine):
            for offset, role in enumerate(ROLES):
                listing.append(f"FIC-{number:05d}.{role},holding,{3 * index + offset},INT16")
        (folder / f"plc-{device}.csv").write_text("\n".join(listing) + "\n", encoding="utf-8")
        text += f'[[devices]]\nname = "plc-{device}"\nhost = "192.0.2.1"\n'
        text += f'registers = "plc-{device}.csv"\n'
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    plant = load_plant(folder / "plant.toml", environment={})
    assert plant.problems == (), plant.problems[:3]
    return plant


def fill(store: Store, plant: Plant, runs: int) -> int:
    """``runs`` runs over all valves, one in a hundred sticky, each with a baseline."""
    store.save_valves(plant.valves.values())
    names = sorted(plant.valves)
    number = 0
    for run in range(runs):
        at = NOW - timedelta(hours=24 * (runs - 1 - run))
        number = store.queue.put(RunToQueue(), software_version="1") or 0
        with store.transactions.writing("filling") as session:
            done = {"state": "done", "reason": "", "finished": at}
            session.execute(
                insert(RunValveRow), [{"run_id": number, "valve": name, **done} for name in names]
            )
            session.execute(insert(ScreeningRow), [screening(name, number, at) for name in names])
    with store.transactions.writing("filling") as session:
        window = {"window_start": NOW - timedelta(hours=1), "window_end": NOW}
        session.execute(
            insert(NetworkRow),
            [
                {"valve": name, "kind": "baseline", "network": b"n" * 20_000, "created": NOW,
                 "reason": "healthy", "active": True, **window}
                for name in names
            ],
        )  # fmt: skip
        rows = session.query(ScreeningRow.id, ScreeningRow.valve, ScreeningRow.at)
        ratios = [
            {"screening_id": number, "name": "baseline_ratio", "valve": valve, "at": at,
             "value": 1.1, "low": None, "high": None, "unit": ""}
            for number, valve, at in rows.where(ScreeningRow.run_id >= number - 12)
        ]  # fmt: skip
        session.execute(insert(IndicatorRow), ratios)
    return number


def screening(valve: str, run: int, at: datetime) -> dict[str, object]:
    """A row of ``screenings``; one valve in a hundred sticks, one in fifty names an effect."""
    number = int(valve[-5:])
    named = number % 50 == 0
    effect = {
        "slug": "lost_motion", "members": ["lost_motion"], "sentence": "There is play.",
        "where": "", "check": "Look.", "decide": "", "parameters": {},
        "evidence": {"mean": 0.2, "t": 5.0, "share": 0.4},
    }  # fmt: skip
    unknown = {"value": None, "low": None, "high": None, "unit": "%", "reason": "few"}
    both = {"S": unknown, "J": unknown}
    mismatch = {
        "finding": "named" if named else "none", "sentence": "", "naive": both, "restated": both,
        "effects": [effect] if named else [], "p_value": 1e-5 if named else None,
        "before": {"grid": [[0.1] * 20] * 20},
    }  # fmt: skip
    return {
        "valve": valve, "run_id": run, "window_key": f"{at.isoformat()}", "at": at,
        "window_start": at - timedelta(hours=1), "window_end": at,
        "verdict": "sticky" if number % 100 == 0 else "healthy", "reason": "r" * 80,
        "advice": "Check the packing.", "shape": None, "severity": 10.0, "confidence": 0.9,
        "grade": "A", "grade_reasons": [], "s_percent": 1.0, "s_low_percent": 0.8,
        "s_high_percent": 1.2, "s_reason": None, "j_percent": 0.2, "j_low_percent": 0.1,
        "j_high_percent": 0.3, "j_reason": None, "residuals": {}, "still_seen": [],
        "baseline_note": "", "source": "s", "source_digest": "", "layout": "", "decisions": [],
        "software_version": "1", "settings_digest": "", "seconds": 0.4, "baseline_id": None,
        "mismatch_finding": mismatch["finding"],
        "mismatch_slugs": ["lost_motion"] if named else [], "mismatch": mismatch,
    }  # fmt: skip


def write_samples(store: Store, plant: Plant, minutes: int = 6) -> None:
    """Samples of every tag at 10 s; one tag in a hundred is bad throughout."""
    for device in plant.devices.values():
        tags = tuple(register.tag for register in device.registers)
        bad = np.arange(len(tags)) % round(1 / BAD_SHARE) == 0
        for step in range(minutes * 6):
            at = microseconds(NOW - timedelta(seconds=10 * step))
            store.samples.write(
                SampleBatch(
                    source=device.name,
                    tags=tags,
                    at_us=np.full(len(tags), at, dtype=np.int64),
                    values=np.where(bad, np.nan, 50.0),
                    quality=bad.astype(np.uint8),
                    reasons=tuple("no answer" if item else "" for item in bad),
                )
            )
        store.sources.note(SourceState(source=device.name, kind="modbus", last_good=NOW))


@contextmanager
def measured(store: Store, name: str) -> Iterator[None]:
    """Print how long the block took and how many statements it sent."""
    statements = 0

    def count(*_: object) -> None:
        nonlocal statements
        statements += 1

    event.listen(store.transactions.readers, "before_cursor_execute", count)
    started, worked = time.perf_counter(), time.process_time()
    try:
        yield
    finally:
        event.remove(store.transactions.readers, "before_cursor_execute", count)
    took_s, work_s = time.perf_counter() - started, time.process_time() - worked
    print(f"{took_s:8.2f} s {work_s:8.2f} s work {statements:7d} statements  {name}")


def main() -> None:
    """Fill a store and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--valves", type=int, default=5000)
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--url", default="")
    result = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plant = made_plant(folder, result.valves)
        with open_store(result.url or f"sqlite:///{folder / 'bench.db'}") as store:
            last = fill(store, plant, result.runs)
            print(f"{result.valves} valves, {result.runs} runs stored")
            with measured(store, "which findings stand"):
                hold_back(store, last)
            with measured(store, "the rules after a run, all alerts new"):
                raised = evaluate(store, plant, last)
            with measured(store, "the same again, nothing new"):
                evaluate(store, plant, last)
            print(f"{len(raised)} alerts")
            write_samples(store, plant)
            since = NOW - timedelta(hours=1)
            with measured(store, "silent devices and dead tags, all new"):
                watch_sources(store, plant, since, NOW)
            with measured(store, "the same again, nothing new"):
                watch_sources(store, plant, since, NOW)


if __name__ == "__main__":
    main()
