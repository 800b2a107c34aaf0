"""The views of version 2, beside those of version 1: with the whole path of a valve by ISA-95, the
verdict on the valve, and its state by NAMUR NE 107. docs/storage.md describes each column.

Their columns are guaranteed as those of version 1 are. Which defects stand is decided in
``named_effects``; a test compares the SQL here with it.
"""

from __future__ import annotations

_VALVES = """
SELECT valves.id AS valve, valves.description, valves.site, valves.area, valves.unit, valves.loop,
    valves.criticality
FROM valves
"""

_SCREENINGS = """
SELECT judged.screening_id, judged.run_id, judged.valve, judged.site, judged.area, judged.unit,
    judged.loop, judged.criticality, judged.at, judged.window_start, judged.window_end,
    judged.verdict,
    CASE WHEN judged.verdict IN ('sticky', 'defective') THEN 'out of specification'
        WHEN judged.verdict = 'watch' THEN 'maintenance required'
        WHEN judged.verdict = 'healthy' THEN 'normal' END AS ne107,
    judged.stem_verdict, judged.severity, judged.confidence, judged.grade, judged.shape,
    judged.s_percent, judged.s_low_percent, judged.s_high_percent,
    judged.j_percent, judged.j_low_percent, judged.j_high_percent,
    judged.reason, judged.advice, judged.mismatch_finding, judged.software_version
FROM (
    SELECT screenings.id AS screening_id, screenings.run_id, screenings.valve, valves.site,
        valves.area, valves.unit, valves.loop, valves.criticality, screenings.at,
        screenings.window_start, screenings.window_end, {verdict} AS verdict,
        screenings.verdict AS stem_verdict, screenings.severity, screenings.confidence,
        screenings.grade, screenings.shape, screenings.s_percent, screenings.s_low_percent,
        screenings.s_high_percent, screenings.j_percent, screenings.j_low_percent,
        screenings.j_high_percent, screenings.reason, screenings.advice,
        screenings.mismatch_finding, screenings.software_version
    FROM screenings JOIN valves ON valves.id = screenings.valve
) AS judged
"""

# The verdict on the valve: sticky where the stem is sticky, else defective where a defect stands,
# else that on the stem.
_VERDICT = """CASE WHEN screenings.verdict <> 'sticky' AND
        CASE WHEN {confirmed} IS NOT NULL THEN {confirmed} <> ''
            ELSE COALESCE(screenings.mismatch_finding IN ('named', 'candidates'), FALSE)
                AND COALESCE({held_back}, '') = '' AND COALESCE({defects}, 'all') <> '' END
        THEN 'defective' ELSE screenings.verdict END"""

_ALERTS = """
SELECT alerts.id AS alert_id, alerts.kind, alerts.severity, alerts.valve, valves.site, valves.area,
    valves.unit, valves.loop, alerts.source, alerts.text, alerts.opened, alerts.seen, alerts.closed,
    alerts.closed_why, CASE WHEN alerts.closed IS NULL THEN 1 ELSE 0 END AS is_open,
    alerts.acknowledged, alerts.acknowledged_by, alerts.snoozed_until,
    CASE WHEN alerts.false_alarm THEN 1 ELSE 0 END AS is_false_alarm, alerts.run_id
FROM alerts LEFT JOIN valves ON valves.id = alerts.valve
"""

NAMES = ("stemwatch_valves_v2", "stemwatch_screenings_v2", "stemwatch_alerts_v2")


def create(dialect: str) -> list[str]:
    """The statements that create the views on ``"sqlite"`` or ``"postgresql"``."""

    def key(column: str, name: str) -> str:
        if dialect == "sqlite":
            return f"json_extract(screenings.{column}, '$.{name}')"
        return f"(screenings.{column} ->> '{name}')"

    verdict = _VERDICT.format(
        confirmed=key("evidence", "confirmed"),
        held_back=key("mismatch", "held_back"),
        defects=key("mismatch", "defects"),
    )
    bodies = (_VALVES, _SCREENINGS.format(verdict=verdict), _ALERTS)
    return [f"CREATE VIEW {name} AS{body}" for name, body in zip(NAMES, bodies, strict=True)]


def drop() -> list[str]:
    """The statements that drop the views."""
    return [f"DROP VIEW {name}" for name in reversed(NAMES)]
