"""The views of version 1, for Grafana and other readers: docs/storage.md describes each column.

Their columns are guaranteed: what stands here is never changed. A view that must change gets a name
that ends in ``_v2`` and a migration of its own.
"""

from __future__ import annotations

_VALVES = """
SELECT valves.id AS valve, valves.description, valves.area, valves.criticality FROM valves
"""

_RUNS = """
SELECT runs.id AS run_id, runs.state, runs.schedule, runs.started, runs.finished,
    runs.total AS valves_total, runs.done AS valves_done, runs.set_aside AS valves_set_aside,
    runs.reason, runs.software_version
FROM runs
"""

_SCREENINGS = """
SELECT screenings.id AS screening_id, screenings.run_id, screenings.valve, valves.area,
    valves.criticality, screenings.at, screenings.window_start, screenings.window_end,
    screenings.verdict, screenings.severity, screenings.confidence, screenings.grade,
    screenings.shape, screenings.s_percent, screenings.s_low_percent, screenings.s_high_percent,
    screenings.j_percent, screenings.j_low_percent, screenings.j_high_percent,
    screenings.reason, screenings.advice, screenings.mismatch_finding,
    screenings.software_version
FROM screenings JOIN valves ON valves.id = screenings.valve
"""

_INDICATORS = """
SELECT indicators.screening_id, indicators.valve, valves.area, valves.criticality, indicators.at,
    indicators.name AS indicator, indicators.value, indicators.low, indicators.high,
    indicators.unit
FROM indicators JOIN valves ON valves.id = indicators.valve
"""

_ALERTS = """
SELECT alerts.id AS alert_id, alerts.kind, alerts.severity, alerts.valve, valves.area,
    alerts.source, alerts.text, alerts.opened, alerts.seen, alerts.closed, alerts.closed_why,
    CASE WHEN alerts.closed IS NULL THEN 1 ELSE 0 END AS is_open, alerts.acknowledged,
    alerts.acknowledged_by, alerts.snoozed_until,
    CASE WHEN alerts.false_alarm THEN 1 ELSE 0 END AS is_false_alarm, alerts.run_id
FROM alerts LEFT JOIN valves ON valves.id = alerts.valve
"""

_TAGS = """
SELECT tags.source, tags.name AS tag, tags.unit FROM tags
"""

_SAMPLES = """
SELECT tags.source, tags.name AS tag, tags.unit, samples.at_us, {at} AS at, samples.value,
    samples.quality,
    CASE samples.quality WHEN 0 THEN 'good' WHEN 1 THEN 'held' WHEN 2 THEN 'bad'
        WHEN 3 THEN 'missing' WHEN 4 THEN 'code' WHEN 5 THEN 'range' END AS quality_name,
    sample_reasons.words AS reason
FROM samples JOIN tags ON tags.id = samples.tag_id
    LEFT JOIN sample_reasons ON sample_reasons.id = samples.reason_id
"""
_AT = {
    "postgresql": "TIMESTAMPTZ 'epoch' + samples.at_us * INTERVAL '1 microsecond'",
    # In the form in which SQLite keeps the times of other tables.
    "sqlite": "strftime('%Y-%m-%d %H:%M:%S', samples.at_us / 1000000, 'unixepoch') || "
    "printf('.%06d', samples.at_us % 1000000)",
}

NAMES = (
    "stemwatch_valves_v1",
    "stemwatch_runs_v1",
    "stemwatch_screenings_v1",
    "stemwatch_indicators_v1",
    "stemwatch_alerts_v1",
    "stemwatch_tags_v1",
    "stemwatch_samples_v1",
)


def create(dialect: str) -> list[str]:
    """The statements that create the views on ``"sqlite"`` or ``"postgresql"``."""
    samples = _SAMPLES.format(at=_AT[dialect])
    bodies = (_VALVES, _RUNS, _SCREENINGS, _INDICATORS, _ALERTS, _TAGS, samples)
    return [f"CREATE VIEW {name} AS{body}" for name, body in zip(NAMES, bodies, strict=True)]


def drop() -> list[str]:
    """The statements that drop the views."""
    return [f"DROP VIEW {name}" for name in reversed(NAMES)]
