"""A small plant in a store: five valves with months behind them, samples, alerts and a run."""

from __future__ import annotations

import atexit
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from stemwatch.connectors.connector import Window
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Floats, Provenance, Recording, Role, Signal
from stemwatch.models.screening_result import Indicator, Residual, Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.serve.http_server import http_server
from stemwatch.service.serve.page_server import address_of, listen
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store
from stemwatch.service.web.app import create_app
from stemwatch.service.web.site import Site

NOW = datetime(2026, 3, 30, 12, 0, tzinfo=UTC)
HOSTILE = "<script>alert(1)</script>/../x'\"&?#%00;\N{RIGHT-TO-LEFT OVERRIDE}"
STICKY, WATCH, HEALTHY, BLIND = "FIC-101", "FIC-102", "PIC-201", "TIC-301"
SOURCE = "gateway 1"
HOUR_S = 3600
S_MADE, J_MADE = 4.0, 2.0

VALVES = (
    StoredValve(id=STICKY, description="Reactor feed", area="Area 100", unit="110", criticality=3),
    StoredValve(id=WATCH, description="Column reflux", area="Area 100", unit="120", criticality=1),
    StoredValve(id=HEALTHY, description="Steam to E-104", area="Area 200", criticality=2),
    StoredValve(id=BLIND, description="50 % of <b>cooling</b>", area="Area 300", criticality=2),
    StoredValve(
        id=HOSTILE, description="<img src=x onerror=alert(1)>", area="A&B <i>", criticality=1
    ),
)
FOUND = {
    STICKY: (Verdict.STICKY, S_MADE, J_MADE),
    WATCH: (Verdict.WATCH, 1.1, 0.2),
    HEALTHY: (Verdict.HEALTHY, 0.2, 0.1),
    BLIND: (Verdict.UNDETERMINED, None, None),
    HOSTILE: (Verdict.WATCH, 1.4, 0.3),
}


def screening(
    valve: str,
    verdict: Verdict = Verdict.STICKY,
    S: float | None = S_MADE,
    J: float | None = J_MADE,
    *,
    at: datetime = NOW,
    **changes: Any,
) -> Screening:
    """A finished screening of the hour before ``at``; S and J ``None`` are not known."""
    op = Signal.good(np.zeros(600), f"{valve}.OP")
    start = at - timedelta(seconds=HOUR_S)
    recording = Recording(valve=valve, signals={Role.OP: op}, interval_s=6.0, start=start)
    fields: dict[str, Any] = {
        "valve": valve,
        "verdict": verdict,
        "reason": f"The stem of {valve} was looked at.",
        "advice": "Check the packing.",
        "shape": Shape.UNDERSHOOT if S else None,
        "severity": 0.0 if S is None else min(100.0, 12.0 * S),
        "confidence": None if S is None else 0.9,
        "S": estimate(S),
        "J": estimate(J),
        "residuals": {"stiction": Residual(rmse=0.1, normalised=0.1), "baseline": None},
        "quality": DataQuality(grade="C" if S is None else "B", reasons=("One gap of 40 s.",)),
        "indicators": {name: item for name, item in indicators(S, J).items() if item is not None},
        "recording": recording,
        "provenance": Provenance(source="store", digest="ab" * 32, layout="samples of the store"),
        "seconds": 0.4,
    }
    return Screening(**fields | changes)


def estimate(value: float | None) -> Estimate:
    """``value`` with an interval of a tenth either way."""
    if value is None:
        return Estimate.unknown("OP moved less than 0.5 %", unit="%")
    return Estimate(value=value, low=0.9 * value, high=1.1 * value, unit="%")


def indicators(S: float | None, J: float | None) -> dict[str, Indicator | None]:
    """S and J as indicators, where they are known."""
    values = {"S_percent": S, "J_percent": J}
    return {
        name: None
        if value is None
        else Indicator(name=name, value=value, unit="%", meaning=name, low=value, high=value)
        for name, value in values.items()
    }


def fill(store: Store, *, months: int = 3) -> None:
    """Screenings every two weeks up to ``NOW``, S growing; an alert, notes, work, a baseline."""
    store.save_valves(VALVES)
    for step in range(2 * months):
        at = NOW - timedelta(days=14 * (2 * months - 1 - step))
        run = store.begin_run(software_version="0.1")
        grown = (1 + step) / (2 * months)
        created = [
            screening(valve, verdict, S and S * grown, J and J * grown, at=at)
            for valve, (verdict, S, J) in FOUND.items()
        ]
        store.save_many(created, run)
        store.finish_run(run)
    store.set_baseline(
        STICKY, b"network", window=(NOW - timedelta(days=120),) * 2, reason="healthy"
    )
    store.set_fitted(STICKY, b"newer", window=(NOW - timedelta(hours=1), NOW), reason="fitted")
    store.record_maintenance(STICKY, NOW - timedelta(days=40), "packing renewed", "K. Berg")
    store.add_note(STICKY, NOW - timedelta(days=3), "squeaks <b>loudly</b>", "Shift B")
    store.alerts.raise_all(
        [
            RaisedAlert(
                cause=f"sticky:{valve}",
                kind=AlertKind.STICKY,
                severity=severity,
                text=f"{valve} sticks: S 4.0 %.",
                valve=valve,
                evidence={
                    "S": 4.0,
                    "S_low": 3.6,
                    "S_high": 4.4,
                    "when_raised": {"S": 2.1, "S_low": 1.9, "S_high": 2.3},
                },
            )
            for valve, severity in ((HOSTILE, AlertSeverity.LOW), (STICKY, AlertSeverity.HIGH))
        ]
    )
    state = SourceState(source=SOURCE, kind="modbus", address="10.1.2.3:502", updated=NOW)
    store.sources.note(state)


def stick_slip(op: Floats, S: float, J: float) -> Floats:
    """Stem of the canonical element: breakaway (S + J) / 2, sliding (S - J) / 2, percent."""
    static, kinetic = (S + J) / 2, (S - J) / 2
    stem, moving, out = float(op[0]), False, np.empty_like(op)
    for k, command in enumerate(op):
        force = command - stem
        if abs(force) > (kinetic if moving else static):
            stem, moving = command - np.sign(force) * kinetic, True
        else:
            moving = False
        out[k] = stem
    return out


def write_samples(store: Store, hours: float = 2.0) -> tuple[Floats, Floats]:
    """OP and MV of the sticky valve up to ``NOW`` at 1 s, MV as 4 to 20 mA; both in percent."""
    count = round(hours * HOUR_S)
    t = np.arange(count, dtype=np.float64)
    op = 50.0 + 8.0 * np.sin(2 * np.pi * t / 400.0)
    noise = np.random.default_rng(7).normal(0.0, 0.04, count)
    mv = stick_slip(op, S_MADE, J_MADE) + noise
    at = (round(NOW.timestamp()) - count + np.arange(count, dtype=np.int64)) * 1_000_000
    good, reasons = np.zeros(count, dtype=np.uint8), ("",) * count
    for tag, values in ((f"{STICKY}.OP", op), (f"{STICKY}.ZT", 4.0 + 0.16 * mv)):
        store.samples.write(
            SampleBatch(
                source=SOURCE,
                tags=(tag,) * count,
                at_us=at,
                values=values,
                quality=good,
                reasons=reasons,
            )
        )
    return op, mv


def plant_of(folder: Path, store: Store) -> Plant:
    """A plant file that names the sticky valve's tags, in Berlin."""
    path = folder / "plant.toml"
    path.write_text(
        f"""[plant]
name = "Nordhafen"
zone = "Europe/Berlin"
[storage]
url = "{store.address.reveal()}"
[[sources]]
name = "{SOURCE}"
path = "exports/*.csv"
[[valves]]
id = "{STICKY}"
area = "Area 100"
unit = "110"
source = "{SOURCE}"
[valves.tags.op]
tag = "{STICKY}.OP"
[valves.tags.mv]
tag = "{STICKY}.ZT"
unit = "mA"
low = 4.0
high = 20.0
""",
        encoding="utf-8",
    )
    return load_plant(path)


def reader_of(store: Store) -> Any:
    """What gives the page recordings: the samples of the sticky valve on an even clock of 1 s."""

    def read(valve: str, window: Window) -> Recording | None:
        if valve != STICKY or window.start is None or window.stop is None:
            return None
        op = store.samples.read(SOURCE, f"{valve}.OP", window.start, window.stop)
        mv = store.samples.read(SOURCE, f"{valve}.ZT", window.start, window.stop)
        if not op.at_us.size:
            return None
        signals = {
            Role.OP: Signal.good(op.values, f"{valve}.OP"),
            Role.MV: Signal.good((mv.values - 4.0) / 0.16, f"{valve}.ZT"),
        }
        start = datetime.fromtimestamp(op.at_us[0] / 1e6, UTC)
        return Recording(valve=valve, signals=signals, interval_s=1.0, start=start)

    return read


@contextmanager
def serving(site: Site, *, fresh: bool = False) -> Iterator[str]:
    """The site on a free port of this machine; gives its address."""
    with serving_app(create_app(site), fresh=fresh) as address:
        yield address


class RunningServer:
    """The product's server in a thread. It serves one application after the other: starting and
    stopping one takes a quarter of a second, which hundreds of tests need not wait for."""

    def __init__(self, proxies: Sequence[str] = ()) -> None:
        self.app: Any = None
        self._listening = listen("127.0.0.1", 0)
        self.address = address_of(self._listening).rstrip("/")
        self._server = http_server(self, lifespan=False, proxies=proxies)
        self._thread = threading.Thread(
            target=self._server.run, args=([self._listening],), daemon=True
        )
        self._thread.start()
        while not self._server.started:
            self._thread.join(0.01)
            assert self._thread.is_alive(), "the server did not start"

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await self.app(scope, receive, send)

    def end(self) -> None:
        """Stop it and wait."""
        self._server.should_exit = True
        self._thread.join()
        self._listening.close()


_idle_servers: list[RunningServer] = []


@atexit.register
def _end_servers() -> None:
    while _idle_servers:
        _idle_servers.pop().end()


@contextmanager
def serving_app(app: Any, *, proxies: Sequence[str] = (), fresh: bool = False) -> Iterator[str]:
    """An application behind the server of the product on a free port; gives its address. With
    ``fresh`` by a server of its own, where limits of the server are what is tested."""
    fresh = fresh or bool(proxies)
    server = _idle_servers.pop() if _idle_servers and not fresh else RunningServer(proxies)
    server.app = app
    try:
        yield server.address
    finally:
        if fresh:
            server.end()
        else:
            _idle_servers.append(server)
