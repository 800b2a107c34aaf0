"""A small plant of made-up valves: enough of every kind of finding to fill a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import ClockFacts, Floats, Provenance, Recording, Role, Signal
from stemwatch.models.screening_result import (
    Indicator,
    PreviousFinding,
    Residual,
    Screening,
    Traces,
)
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.report import (
    ReportContext,
    SourceNotRead,
    ValveFacts,
    write_report,
)

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
EARLIER = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)


def stick_slip(op: Floats, S: float, J: float) -> Floats:
    """Stem of a valve with stick band plus dead band S and slip jump J, both percent of OP."""
    static, kinetic = (S + J) / 2, (S - J) / 2
    stem, moving, out = op[0], False, np.empty_like(op)
    for k, command in enumerate(op):
        force = command - stem
        if abs(force) > (kinetic if moving else static):
            stem, moving = command - np.sign(force) * kinetic, True
        else:
            moving = False
        out[k] = stem
    return out


def recording(
    valve: str, S: float, J: float, samples: int = 3600, seed: int = 1, interval_s: float = 1.0
) -> Recording:
    """One valve in a slow limit cycle, with noise, a set point step and a gap."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples, dtype=np.float64)
    op = 48 + 7 * np.sin(2 * np.pi * t / 520) + 2.5 * np.sin(2 * np.pi * t / 1900 + seed)
    mv = stick_slip(op, S, J) + rng.normal(0, 0.06, samples)
    pv = 120 + np.convolve(mv - 48, np.exp(-np.arange(180) / 40) / 40)[:samples]
    sp = np.where(t < samples * 0.6, 120.0, 121.5)
    for gap in (mv, pv):
        gap[samples // 3 : samples // 3 + 40] = np.nan
    signals = {
        Role.OP: Signal.good(op, f"{valve}.OP"),
        Role.MV: Signal.good(mv, f"{valve}.MV"),
        Role.PV: Signal.good(pv, f"{valve}.PV", unit="m³/h"),
        Role.SP: Signal.good(sp, f"{valve}.SP", unit="m³/h"),
    }
    return Recording(
        valve=valve,
        signals=signals,
        interval_s=interval_s,
        start=START,
        clock=ClockFacts(gaps=1, longest_gap_s=40, zone="Times were read as Europe/Berlin."),
        provenance=provenance(valve),
    )


def provenance(valve: str) -> Provenance:
    return Provenance(
        source=f"exports/{valve}.csv",
        digest="9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
        layout="Semicolon-separated text, one column per tag, decimal comma.",
        decisions=("The first line was taken for the header.", "MV was told by the tag mapping."),
    )


REASONS = {
    Verdict.STICKY: "The stem stays put until the controller has moved {S:.1f} %, then jumps by "
    "{J:.1f} % at once; the loop cycles because of it.",
    Verdict.WATCH: "The stem lags a change of direction by {S:.1f} %; the loop does not cycle yet.",
    Verdict.HEALTHY: "The stem follows the controller within the noise of the position signal.",
    Verdict.UNDETERMINED: "The controller output moved less than 0.5 % in this window, so that "
    "sticking could not show itself.",
}
ADVICE = {
    Verdict.STICKY: "Check packing and actuator at the next opportunity; until then keep the loop "
    "out of tight integral action.",
    Verdict.WATCH: "Look again in two weeks; ask operations whether the packing was tightened.",
    Verdict.HEALTHY: "Nothing to do.",
    Verdict.UNDETERMINED: "Record again over a load change, or make two 3 % steps in manual.",
}
STILL_SEEN = (
    "The position signal is alive and agrees with OP within 1 % on average.",
    "A stickband above 2.4 % would have shown itself in this window.",
)


def indicators(S: float) -> dict[str, Indicator]:
    results = (
        Indicator(
            name="stickband_percent",
            value=S,
            low=0.9 * S,
            high=1.1 * S,
            unit="% of OP span",
            meaning="OP change that the stem ignores after a reversal",
        ),
        Indicator(
            name="reversals_per_h",
            value=14.2,
            unit="1/h",
            meaning="How often the stem changes direction",
        ),
        Indicator(
            name="fit_percent",
            value=float("nan"),
            unit="%",
            meaning="How much of MV the model explains",
            worse="down",
        ),
    )
    return {item.name: item for item in results}


def screening(
    valve: str,
    verdict: Verdict = Verdict.STICKY,
    S: float = 5.2,
    J: float = 2.1,
    samples: int = 3600,
    seed: int = 1,
) -> Screening:
    """One finished screening with all its evidence."""
    read = recording(valve, S, J, samples, seed)
    known = verdict is not Verdict.UNDETERMINED
    simulated = stick_slip(read.op.values, S * 0.97, J * 1.05)
    narx = simulated + 0.3 * np.sin(np.arange(samples) / 90)
    none = "OP moved less than 0.5 %"
    return Screening(
        valve=valve,
        verdict=verdict,
        reason=REASONS[verdict].format(S=S, J=J),
        advice=ADVICE[verdict],
        shape=Shape.UNDERSHOOT if known and J else None,
        severity=min(100.0, 12 * S) if known else 0.0,
        confidence=0.93 if known else None,
        S=Estimate(value=S, low=S * 0.92, high=S * 1.1, unit="%") if known else unknown(none),
        J=Estimate(value=J, low=J * 0.8, high=J * 1.15, unit="%") if known else unknown(none),
        residuals={
            "stiction": Residual(rmse=0.11, normalised=0.021) if known else None,
            "narx": Residual(rmse=0.19, normalised=0.036, one_step=0.07) if known else None,
            "baseline": None,
        },
        quality=DataQuality(
            grade="B" if known else "C",
            reasons=("One gap of 40 s.", "MV is quantised to 0.06 %."),
        ),
        indicators=indicators(S) if known else {},
        still_seen=() if known else STILL_SEEN,
        baseline_note="There is no baseline yet: this is the first healthy look at this valve.",
        traces=Traces(stiction=simulated, narx=narx, heldout_from=int(samples * 0.7))
        if known
        else Traces(),
        recording=read,
        provenance=read.provenance,
        seconds=0.84,
    )


def unknown(reason: str) -> Estimate:
    return Estimate.unknown(reason, unit="%")


def without_mv(valve: str) -> Screening:
    """A valve whose stem position nobody records."""
    complete = screening(valve, Verdict.UNDETERMINED, S=3.0, J=1.0, seed=5)
    assert complete.recording is not None
    signals: dict[Role, Signal] = dict(complete.recording.signals)
    del signals[Role.MV]
    return replace(complete, recording=replace(complete.recording, signals=signals))


def unreadable(valve: str) -> Screening:
    """A valve whose source made no sense."""
    complete = screening(valve, Verdict.UNDETERMINED, samples=10)
    return replace(
        complete,
        reason="exports/broken.csv: line 1: expected a header with a time column, found binary "
        "data; export the tags again as text.",
        advice="Export the tags again and rerun.",
        recording=None,
        traces=Traces(),
        still_seen=(),
        quality=DataQuality(grade="D", reasons=("Nothing could be read.",)),
    )


def plant(valves: int) -> list[Screening]:
    """``valves`` screenings: about a sixth sticky, a sixth to watch, a ninth undetermined."""
    kinds = {0: Verdict.STICKY, 3: Verdict.WATCH, 7: Verdict.UNDETERMINED}
    sizes = {Verdict.STICKY: 4.0, Verdict.WATCH: 1.1, Verdict.HEALTHY: 0.2}
    matching = []
    for k in range(valves):
        verdict = kinds.get(k % 9, Verdict.HEALTHY)
        S = sizes.get(verdict, 1.0) * (1 + 0.13 * (k % 7))
        matching.append(screening(f"FV-{100 + k}", verdict, S=S, J=0.45 * S, seed=k))
    return matching


SERVICES = ("Reactor feed", "Column reflux", "Steam to reboiler E-104", "Cooling water return")


def facts(screenings: list[Screening]) -> dict[str, ValveFacts]:
    before = (
        None,
        PreviousFinding(at=EARLIER, run=6, verdict=Verdict.WATCH, S=1.1, J=0.4, severity=14.0),
        PreviousFinding(at=EARLIER, run=6, verdict=Verdict.STICKY, S=4.6, J=2.0, severity=55.0),
    )
    return {
        screening.valve: ValveFacts(
            description=SERVICES[k % 4],
            area=f"Area {100 * (1 + k % 3)}",
            criticality="AB"[k % 2],
            previous=before[k % 3],
        )
        for k, screening in enumerate(screenings)
    }


def context_of(screenings: list[Screening], **changes: object) -> ReportContext:
    report_context = ReportContext(
        started=datetime(2026, 3, 2, 12, 30, tzinfo=UTC),
        title="Control valve stiction",
        plant="Nordhafen, refinery 2",
        zone="Europe/Berlin",
        command="stemwatch screen exports --zone Europe/Berlin",
        settings_digest="a3f1c09e",
        valves=facts(screenings),
        sources_not_read=(
            SourceNotRead(source="exports/notes.pdf", reason="It is not a table of numbers."),
        ),
    )
    return replace(report_context, **changes)  # type: ignore[arg-type]


@pytest.fixture
def make_screening() -> Callable[..., Screening]:
    return screening


@pytest.fixture
def make_context() -> Callable[..., ReportContext]:
    return context_of


@pytest.fixture
def make_plant() -> Callable[[int], list[Screening]]:
    return plant


@pytest.fixture
def mixed_plant() -> list[Screening]:
    """Twelve ordinary valves, one without MV, one that could not be read."""
    return [*plant(12), without_mv("PV-310"), unreadable("LV-404")]


@pytest.fixture
def open_page(windows, mixed_plant, make_context, tmp_path):
    """Opens the report; at the end no error was logged and nothing but the file was asked for."""
    path = write_report(mixed_plant, make_context(mixed_plant), tmp_path).html
    errors: list[str] = []
    requests: list[str] = []

    def open_it(**options):
        return windows.open(path.as_uri(), logged=errors, asked=requests, offline=True, **options)

    yield open_it
    assert errors == []
    assert {url for url in requests if not url.startswith("file://")} == set()
