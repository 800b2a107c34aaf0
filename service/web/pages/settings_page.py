"""Settings: schedules, limits and the plant file as it was read, without its secrets. Admins can
set here what the file does not name; the rest is changed in the file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import Enum
from types import MappingProxyType
from typing import Any
from urllib.parse import urlsplit

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, PlainTextResponse

from stemwatch.connectors.modbus import Device
from stemwatch.connectors.modbus.device_tables import keys_of
from stemwatch.connectors.secret import masked
from stemwatch.models.limits import Limits
from stemwatch.service.config import Plant
from stemwatch.service.config.in_force import (
    BadSetting,
    as_plant_toml,
    checked_limits,
    checked_schedule,
)
from stemwatch.service.config.service_schema import ServiceSection
from stemwatch.service.presenter.setting_words import LIMIT_WORDS, RULE_WORDS
from stemwatch.service.presenter.wording import duration
from stemwatch.service.store.runs.browser_settings import SetLimit
from stemwatch.service.store.runs.schedules import FROM_BROWSER
from stemwatch.service.web.auth.current_user import SignedIn, note_about
from stemwatch.service.web.auth.forms import Form, SentForm
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.redirects import to_page

# Keys of a schedule that are typed in another unit than seconds: the key, the field, its seconds.
TIMES = (
    ("every_s", "every_hours", 3600.0),
    ("window_s", "window_hours", 3600.0),
    ("jitter_s", "spread_minutes", 60.0),
)
SECRET_WORDS = ("password", "secret", "token", "key", "url")
MOST_SHOWN = 4  # entries of a list; a register map is counted instead

Given = list[tuple[str, str]]

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, kw_only=True)
class ShownLimit:
    """One limit with where its value comes from. ``given`` is what was set here, in force or not;
    ``named`` whether the plant file has it."""

    name: str
    value: float
    default: float
    named: bool
    given: SetLimit | None


@router.get("/settings")
def settings(request: Request, deps: Deps) -> HTMLResponse:
    """What the service goes by: the plant file, and for what it leaves open, what was set here."""
    return _page(request, deps)


@router.get("/settings/plant.toml")
def export(deps: Deps) -> PlainTextResponse:
    """What was set here as text for the plant file."""
    named = frozenset() if deps.site.plant is None else deps.site.plant.named_limits
    limits_set = deps.store.browser_settings.limits()
    own_schedules = [
        stored.schedule for stored in deps.store.schedules.all() if stored.origin == FROM_BROWSER
    ]
    text = as_plant_toml(
        {name: limit for name, limit in limits_set.items() if name not in named}, own_schedules
    )
    return PlainTextResponse(text or "# Nothing was set on the pages.\n")


@router.post("/settings/limits")
def set_limits(request: Request, deps: Deps, current_user: SignedIn, form: SentForm) -> Response:
    """Set limits that the plant file leaves open; an empty field takes one back."""
    limits_before, now = deps.store.browser_settings.limits(), deps.site.limits
    typed = {
        field.name: form.text(field.name, longest=40)
        for field in fields(Limits)
        if form.all(field.name)
    }
    changes = {
        name: text
        for name, text in typed.items()
        if text != (f"{limits_before[name].value:g}" if name in limits_before else "")
    }
    try:
        read = checked_limits(deps.site.plant, limits_before, changes)
    except BadSetting as error:
        return _refused(request, deps, error, form)
    deps.store.browser_settings.set_limits(read, current_user.signature(), deps.now)
    for name, value in read.items():
        new_text = "as in the plant file" if value is None else f"{value:g}"
        note_about(request, f"{name} {getattr(now, name):g} -> {new_text}")
    return to_page(request, "/settings", "limits")


@router.post("/settings/schedule")
def set_schedule(request: Request, deps: Deps, current_user: SignedIn, form: SentForm) -> Response:
    """Make a schedule, or change one that was made here; what is refused is shown as it was
    typed."""
    table: dict[str, Any] = {
        "name": form.text("name", longest=100),
        "cron": form.text("cron", longest=100) or None,
        "areas": [area for area in form.all("area") if area],
        "units": [unit for unit in form.all("unit") if unit],
        "valves": form.text("valves").replace(",", " ").split(),
        "enabled": form.text("off") == "",
    }
    try:
        for key, field, unit_s in TIMES:
            table |= _seconds(form.text(field, longest=20), key, field, unit_s)
        known_valves = [valve.id for valve in deps.store.valves()]
        schedule = checked_schedule(table, deps.store.levels(), known_valves)
    except BadSetting as error:
        return _refused(request, deps, error, form)
    deps.actions.set_schedule(schedule, current_user.signature(), deps.now)
    return to_page(request, "/settings", "schedule")


@router.post("/settings/schedule/remove")
def remove_schedule(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> Response:
    """Remove a schedule that was made here."""
    deps.actions.remove_schedule(form.text("name", needed="the name of a schedule"))
    return to_page(request, "/settings", "unscheduled")


def _seconds(text: str, key: str, field: str, unit_s: float) -> dict[str, float]:
    """A time that was typed in the field's unit, in seconds; nothing where nothing was typed."""
    if not text:
        return {}
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        named = field.replace("_", " ")
        raise BadSetting(f"{named}: found {text!r}; expected a number")
    return {key: value * unit_s}


def _refused(request: Request, deps: Dependencies, error: BadSetting, form: Form) -> HTMLResponse:
    return _page(
        request, deps, message=f"{error}. Nothing is changed.", typed=form.typed(), status=422
    )


def _page(
    request: Request,
    deps: Dependencies,
    *,
    message: str = "",
    typed: Mapping[str, Sequence[str]] = MappingProxyType({}),
    status: int = 200,
) -> HTMLResponse:
    plant = deps.site.plant
    return deps.renderer.page(
        request,
        "settings_page.html",
        status=status,
        here="settings",
        open_alerts=deps.open_alerts(),
        said=message,
        typed=typed,
        plant=plant,
        limits=_limits(deps),
        limit_words=LIMIT_WORDS,
        rule_words=RULE_WORDS,
        rules=shown_keys(plant.alerts.model_dump()) if plant else [],
        schedules=deps.store.schedules.all(),
        unsaid_window=_unsaid_window(plant),
        authors=deps.store.browser_settings.schedules(),
        levels=deps.store.levels(),
        storage=str(deps.store.address),
        sources=_sources(plant),
        notifiers=_notifiers(plant),
        problems=[masked(str(problem)) for problem in plant.problems] if plant else [],
    )


def _unsaid_window(plant: Plant | None) -> str:
    """How far back a run looks whose schedule does not say it."""
    window_s = (ServiceSection() if plant is None else plant.service).window_s
    return f"whole files; of stored samples the last {duration(window_s)}"


def _limits(deps: Dependencies) -> list[ShownLimit]:
    named = frozenset() if deps.site.plant is None else deps.site.plant.named_limits
    limits_set, now = deps.store.browser_settings.limits(), deps.site.limits
    return [
        ShownLimit(
            name=limit.name,
            value=getattr(now, limit.name),
            default=getattr(Limits(), limit.name),
            named=limit.name in named,
            given=limits_set.get(limit.name),
        )
        for limit in fields(Limits)
    ]


def _sources(plant: Plant | None) -> list[dict[str, Any]]:
    """Each source and device with what was given of it and how many valves it has."""
    if plant is None:
        return []
    counts = Counter(valve.source for valve in plant.valves.values())
    tables = {name: source.model_dump() for name, source in plant.sources.items()}
    tables |= {name: archive.model_dump() for name, archive in plant.archives.items()}
    tables |= {name: _keys_of(device) for name, device in plant.devices.items()}
    return [
        {"name": name, "valves": counts[name], "given": shown_keys(fields)}
        for name, fields in tables.items()
    ]


def _keys_of(device: Device) -> dict[str, Any]:
    """A device's keys as they stand in the plant file, without those of links of another type."""
    keys = asdict(device)
    del keys["link"]
    return keys_of(device.link) | keys


def _notifiers(plant: Plant | None) -> list[tuple[str, Given]]:
    if plant is None:
        return []
    return [(name, shown_keys(notifier.model_dump())) for name, notifier in plant.notifiers.items()]


def shown_keys(keys: Mapping[str, Any], before: str = "") -> Given:
    """Keys and values as text; what could hold a secret is masked, long lists are counted."""
    lines: Given = []
    for key, value in keys.items():
        name = f"{before}{key}"
        if value is None or value == [] or key == "name":
            continue
        if isinstance(value, Mapping):
            lines += shown_keys(value, f"{name}.")
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
    """The host of an address, since paths and queries of webhooks are secrets; otherwise
    asterisks."""
    parts = urlsplit(secret)
    host = parts.netloc.rpartition("@")[2]
    return f"{parts.scheme}://{host}/***" if host else "***"
