"""An inspection as the text of a proposed ``plant.toml``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from stemwatch.models.recording import PERCENT, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.inspection import Inspection, TagInspection

_ORDER = (Role.OP, Role.MV, Role.PV, Role.SP, Role.MODE)


def plant_toml(inspection: Inspection, name: str) -> str:
    """One source and every valve whose OP is certain; what is not certain is a commented line."""
    lines = [
        "[[sources]]",
        f"name = {_text(name)}",
        f"path = {_text(inspection.source)}",
        _zone_line(inspection),
    ]
    for valve in _valves(inspection):
        lines += ["", *_valve_lines(inspection, valve, name)]
    lines += _questions(inspection)
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    # JSON's escapes are TOML's, too.
    return json.dumps(value, ensure_ascii=False)


def _zone_line(inspection: Inspection) -> str:
    if inspection.zone_name:
        return f"zone = {_text(inspection.zone_name)}"
    if inspection.start is not None:
        return "# the times carry their offset or are in UTC; no zone is needed"
    return '# zone = "Europe/Berlin"   # the file does not say; without it dates stay unknown'


def _valves(inspection: Inspection) -> list[str]:
    return sorted({tag.valve for tag in inspection.tags if tag.role == Role.OP and tag.valve})


def _valve_lines(inspection: Inspection, valve: str, source: str) -> list[str]:
    mine = {tag.role: tag for tag in inspection.tags if tag.valve == valve and tag.role}
    description = next((t.description for t in mine.values() if t.description), "")
    lines = [
        "[[valves]]",
        f"id = {_text(valve)}",
        f"description = {_text(description)}",
        f"source = {_text(source)}",
    ]
    for role in _ORDER:
        if role in mine:
            lines += _tag_lines(role, mine[role])
        elif role is Role.MV:
            lines += _ask_position(inspection, valve)
    return lines


def _tag_lines(role: Role, tag: TagInspection) -> list[str]:
    lines = [f"[valves.tags.{role.value}]", f"tag = {_text(tag.tag)}"]
    if role is Role.MODE:
        return lines
    lines.append(f"unit = {_text(tag.unit)}" if tag.unit else '# unit = "%"   # not in the file')
    percent = tag.unit == PERCENT or (not tag.unit and role is Role.OP and _within_percent(tag))
    if percent:
        return [*lines, "low = 0.0", "high = 100.0"]
    seen = "" if tag.low is None else f"   # seen: {tag.low:g} to {tag.high:g}"
    return [*lines, f"# low = 0.0{seen}", "# high = 100.0   # engineering values at 0 % and 100 %"]


def _within_percent(tag: TagInspection) -> bool:
    return tag.low is not None and tag.high is not None and tag.low >= -15 and tag.high <= 115


def _ask_position(inspection: Inspection, valve: str) -> list[str]:
    maybe = [t.tag for t in inspection.tags if t.valve == valve and not t.role and t.remark]
    hint = f" (perhaps {', '.join(maybe[:3])})" if maybe else ""
    return [
        f"# which tag is the measured position (MV) of {valve}?{hint}".replace("\n", " "),
        "# [valves.tags.mv]",
        '# tag = ""',
    ]


def _questions(inspection: Inspection) -> list[str]:
    """Loops without a certain OP, so that a person sees what was left open."""
    certain = set(_valves(inspection))
    open_tags = [t for t in inspection.tags if t.valve and t.valve not in certain]
    if not open_tags:
        return []
    lines = ["", "# Not proposed, because the controller output (OP) is not certain:"]
    return lines + [
        f"#   {t.tag} ({t.valve}): {t.remark}".replace("\n", " ") for t in open_tags[:200]
    ]
