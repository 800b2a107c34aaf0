"""Settings: schedules, limits and the plant file as it was read, without its secrets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from enum import Enum
from typing import Any
from urllib.parse import urlsplit

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from stemwatch.connectors.modbus import Device
from stemwatch.connectors.modbus.device_tables import keys_of
from stemwatch.connectors.secret import masked
from stemwatch.service.config import Plant
from stemwatch.service.web.dependencies import Deps

SECRET_WORDS = ("password", "secret", "token", "key", "url")
MOST_SHOWN = 4  # entries of a list; a register map is counted instead

Given = list[tuple[str, str]]

router = APIRouter(include_in_schema=False)


@router.get("/settings")
def settings(request: Request, deps: Deps) -> HTMLResponse:
    """What the service goes by. It is changed in the plant file, where it has a history."""
    plant = deps.site.plant
    return deps.renderer.page(
        request,
        "settings_page.html",
        here="settings",
        open_alerts=deps.open_alerts(),
        plant=plant,
        limits=shown(asdict(deps.site.limits)),
        rules=shown(plant.alerts.model_dump()) if plant else [],
        schedules=deps.store.schedules.all(),
        storage=str(deps.store.address),
        sources=_sources(plant),
        notifiers=_notifiers(plant),
        problems=[masked(str(problem)) for problem in plant.problems] if plant else [],
    )


def _sources(plant: Plant | None) -> list[dict[str, Any]]:
    """Each source and device with what was given of it and how many valves it has."""
    if plant is None:
        return []
    counts = Counter(valve.source for valve in plant.valves.values())
    given = {name: source.model_dump() for name, source in plant.sources.items()}
    given |= {name: archive.model_dump() for name, archive in plant.archives.items()}
    given |= {name: _keys_of(device) for name, device in plant.devices.items()}
    return [
        {"name": name, "valves": counts[name], "given": shown(fields)}
        for name, fields in given.items()
    ]


def _keys_of(device: Device) -> dict[str, Any]:
    """A device's keys as they stand in the plant file, without those of links of another type."""
    given = asdict(device)
    del given["link"]
    return keys_of(device.link) | given


def _notifiers(plant: Plant | None) -> list[tuple[str, Given]]:
    if plant is None:
        return []
    return [(name, shown(notifier.model_dump())) for name, notifier in plant.notifiers.items()]


def shown(given: Mapping[str, Any], before: str = "") -> Given:
    """Keys and values as text; what could hold a secret is masked, long lists are counted."""
    lines: Given = []
    for key, value in given.items():
        name = f"{before}{key}"
        if value is None or value == [] or key == "name":
            continue
        if isinstance(value, Mapping):
            lines += shown(value, f"{name}.")
        elif any(word in key.lower() for word in SECRET_WORDS):
            lines.append((name, _masked(str(value))))
        elif isinstance(value, list | tuple) and len(value) > MOST_SHOWN:
            lines.append((name, f"{len(value)} entries"))
        elif isinstance(value, list | tuple):
            lines.append((name, ", ".join(_text(item) for item in value)))
        else:
            lines.append((name, _text(value)))
    return lines


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return str(value.get("tag") or value.get("name") or "…")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    return masked(str(value.value if isinstance(value, Enum) else value))


def _masked(secret: str) -> str:
    """Of an address its machine, since paths and queries of webhooks are passwords; else stars."""
    parts = urlsplit(secret)
    host = parts.netloc.rpartition("@")[2]
    return f"{parts.scheme}://{host}/***" if host else "***"
