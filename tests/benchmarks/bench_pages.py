"""How long each page takes at the server, with a plant of 5,000 valves and months of results.

    python tests/benchmarks/bench_pages.py [--valves 5000] [--runs 12] [--url URL]

Prints the median and the slowest of several requests for every page, in milliseconds, measured
around the whole application: routing, queries and template, without a network.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import numpy as np
from sqlalchemy import insert

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.access.sessions import begin_session
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.screenings.tables import IndicatorRow, ScreeningRow
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.app import create_app
from stemwatch.service.web.auth.session_cookie import NAME
from stemwatch.service.web.site import Site

NOW = datetime(2026, 3, 30, 12, 0, tzinfo=UTC)
VERDICTS = ("healthy",) * 7 + ("watch", "sticky", "undetermined")
SOURCE = "gateway"
TIMES = 15
LIMIT_MS = 300.0


def fill(store: Store, valves: int, runs: int) -> None:
    """``runs`` runs over ``valves`` valves in 20 areas, 30 indicators each, and 300 alerts."""
    names = [f"FIC-{number:05d}" for number in range(valves)]
    store.save_valves(
        [
            StoredValve(
                id=name,
                description=f"Loop {index} of column C-{index % 97}",
                area=f"Area {100 * (1 + index % 20)}",
                criticality=1 + index % 3,
            )
            for index, name in enumerate(names)
        ]
    )
    for run in range(runs):
        at = NOW - timedelta(days=7 * (runs - 1 - run))
        number = store.begin_run(software_version="0.1")
        with store.transactions.writing("filling") as session:
            rows = [_screening(name, index, number, at) for index, name in enumerate(names)]
            session.execute(insert(ScreeningRow), rows)
        store.finish_run(number)
    _indicators(store)
    raised = [
        RaisedAlert(
            cause=f"sticky:{name}",
            kind=AlertKind.STICKY,
            severity=AlertSeverity.HIGH,
            text=f"{name} sticks.",
            valve=name,
        )
        for name in names[:300]
    ]
    store.alerts.raise_all(raised)


def _screening(name: str, place: int, run: int, at: datetime) -> dict[str, object]:
    verdict = VERDICTS[(place * 7 + run) % len(VERDICTS)]
    known = verdict != "undetermined"
    S = 0.1 + (place * 37 % 500) / 100.0 if known else None
    columns = dict.fromkeys(("source", "source_digest", "layout", "baseline_note"), "")
    numbers = {"s_low_percent": S, "s_percent": S, "s_high_percent": S}
    numbers |= {"j_low_percent": S, "j_percent": S, "j_high_percent": S}
    return {
        **columns,
        **numbers,
        "valve": name,
        "run_id": run,
        "window_key": at.isoformat(),
        "window_start": at - timedelta(hours=2),
        "window_end": at,
        "at": at,
        "verdict": verdict,
        "reason": "The stem stays put until the controller has moved far enough.",
        "advice": "Check packing and actuator at the next opportunity.",
        "shape": "undershoot" if known else None,
        "severity": 12.0 * S if S else 0.0,
        "confidence": 0.9 if known else None,
        "grade": "B",
        "grade_reasons": ["One gap of 40 s."],
        "s_reason": None if known else "OP did not move",
        "j_reason": None if known else "OP did not move",
        "residuals": {},
        "still_seen": [],
        "decisions": [],
        "software_version": "0.1",
        "settings_digest": "",
        "seconds": 0.3,
        "mismatch_finding": None,
        "mismatch_slugs": None,
        "mismatch": None,
        "baseline_id": None,
    }


def _indicators(store: Store) -> None:
    """Thirty numbers of each screening of the first hundred valves."""
    with store.transactions.reading() as session:
        result = session.query(ScreeningRow.id, ScreeningRow.valve, ScreeningRow.at)
        rows = [
            {
                "screening_id": number,
                "name": f"indicator_{index}",
                "valve": valve,
                "at": at,
                "value": float(index),
                "low": None,
                "high": None,
                "unit": "%",
            }
            for number, valve, at in result.where(ScreeningRow.valve < "FIC-00100")
            for index in range(30)
        ]
    with store.transactions.writing("filling") as session:
        session.execute(insert(IndicatorRow), rows)


def write_samples(store: Store, days: float) -> None:
    """One tag at 1 s for ``days`` days, for what thinning costs."""
    count = round(days * 86_400)
    at = microseconds(NOW) - 1_000_000 * np.arange(count, 0, -1, dtype=np.int64)
    store.samples.write(
        SampleBatch(
            source=SOURCE,
            tags=("FIC-00001.OP",) * count,
            at_us=at,
            values=50.0 + np.sin(np.arange(count) / 60.0),
            quality=np.zeros(count, dtype=np.uint8),
            reasons=("",) * count,
        )
    )


async def measure(site: Site, paths: list[str]) -> dict[str, list[float]]:
    """Milliseconds of ``TIMES`` requests for each path, after one that is not counted."""
    transport = httpx.ASGITransport(create_app(site))
    milliseconds: dict[str, list[float]] = {}
    user = site.store.accounts.add("bench", UserRole.ADMIN, "no hash", added_by="bench", now=NOW)
    cookies = {NAME: begin_session(site.store, user.id, now=NOW)}
    async with httpx.AsyncClient(
        transport=transport, base_url="http://localhost", cookies=cookies
    ) as client:
        for path in paths:
            for index in range(TIMES + 1):
                started = time.perf_counter()
                answer = await client.get(path)
                spent = 1e3 * (time.perf_counter() - started)
                answer.raise_for_status()
                if index:
                    milliseconds.setdefault(path, []).append(spent)
    return milliseconds


def thinning(store: Store) -> list[tuple[str, float]]:
    """Milliseconds to thin one tag over an hour, a day, a week."""
    milliseconds = []
    for name, length in (("1 h", 1 / 24), ("1 d", 1.0), ("7 d", 7.0)):
        started = time.perf_counter()
        start = NOW - timedelta(days=length)
        assert store.samples.plot_points(SOURCE, "FIC-00001.OP", start, NOW, 1600) is not None
        milliseconds.append((name, 1e3 * (time.perf_counter() - started)))
    return milliseconds


PATHS = [
    "/",
    "/?page=100",
    "/?q=column+C-42",
    "/?area=Area+300&verdict=sticky&verdict=watch&criticality=3",
    "/?sort=S&order=desc",
    "/?sort=valve&order=desc&page=50",
    "/valve?id=FIC-00001",
    "/alerts",
    "/runs",
    "/sources",
    "/settings",
    "/healthz",
    "/api/docs",
    "/api/v1/valves?size=500",
    "/api/v1/valve/history?id=FIC-00001",
]


def main() -> None:
    """Fill a store, ask every page, print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--valves", type=int, default=5000)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--url", default="")
    result = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        open_store(result.url or f"sqlite:///{Path(folder) / 'bench.db'}") as store,
    ):
        fill(store, result.valves, result.runs)
        results = asyncio.run(measure(Site(store=store, clock=lambda: NOW), PATHS))
        print(f"{result.valves} valves, {result.runs} runs, {TIMES} requests each, ms")
        for path, spent in results.items():
            late = "  OVER THE LIMIT" if statistics.median(spent) > LIMIT_MS else ""
            print(f"{statistics.median(spent):8.1f} {max(spent):8.1f}  {path}{late}")
        write_samples(store, 7.0)
        for name, spent_ms in thinning(store):
            print(f"{spent_ms:8.1f}           thinning {name} of one tag at 1 s")


if __name__ == "__main__":
    main()
