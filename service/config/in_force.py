"""The settings in force for a plant: those of its file, and where the file names none, those that
people set on the pages."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from pydantic import ValidationError

from stemwatch.connectors.settings import toml_value
from stemwatch.models.limits import Limits
from stemwatch.service.config.load import LimitsTable
from stemwatch.service.config.plant import Plant
from stemwatch.service.config.problems import TableLocation, problems_of
from stemwatch.service.config.service_schema import ScheduleTable
from stemwatch.service.store.runs.browser_settings import SetLimit
from stemwatch.service.store.runs.schedule import ScreeningSchedule

log = logging.getLogger(__name__)


class BadSetting(ValueError):
    """A setting from a page is not possible; the text says what was found and what is expected."""


def limits_in_force(plant: Plant | None, limits_set: Mapping[str, SetLimit]) -> Limits:
    """The plant file's limits, completed by the ``limits_set`` on the pages where the file names
    none.

    Where the two contradict each other, only those of the file are used.
    """
    limits = plant.limits if plant is not None else Limits()
    named = plant.named_limits if plant is not None else frozenset()
    limit_names = {limit.name for limit in fields(Limits)}
    unfixed = {
        name: set_limit.value
        for name, set_limit in limits_set.items()
        if name in limit_names - named
    }
    try:
        return replace(limits, **unfixed)
    except ValueError as error:
        log.error("the limits that were set on the pages are not in force: %s", error)
        return limits


def checked_limits(
    plant: Plant | None, limits_set: Mapping[str, SetLimit], changes: Mapping[str, str]
) -> dict[str, float | None]:
    """``changes`` of limits, as typed by a user, as numbers; ``None`` removes a setting.

    Raises ``BadSetting`` for an unknown limit, a text that is not a number, a limit that the plant
    file names, and one that contradicts the others.
    """
    named = plant.named_limits if plant is not None else frozenset()
    limit_names = {limit.name for limit in fields(Limits)}
    read: dict[str, float | None] = {}
    for name, text in changes.items():
        if name not in limit_names:
            raise BadSetting(f"there is no limit {name}")
        if name in named:
            raise BadSetting(
                f"{name} stands in the plant file, which is its source: change it there"
            )
        read[name] = _number(name, text) if text else None
    set_in_browser = {
        name: set_limit.value
        for name, set_limit in limits_set.items()
        if name in limit_names - named
    }
    all_limits = {
        **set_in_browser,
        **{name: value for name, value in read.items() if value is not None},
    }
    for name, value in read.items():
        if value is None:
            all_limits.pop(name, None)
    base = plant.limits if plant is not None else Limits()
    try:
        replace(base, **all_limits)
    except ValueError as error:
        raise BadSetting(str(error)) from None
    return read


def _number(name: str, text: str) -> float:
    try:
        table = LimitsTable.model_validate({name: float(text)})
    except (ValidationError, ValueError):
        raise BadSetting(f"{name}: found {text[:40]!r}; expected a number") from None
    value = float(getattr(table, name))
    if not 0.0 <= value < float("inf"):
        raise BadSetting(f"{name}: found {text[:40]!r}; expected a number of 0 or more")
    return value


def checked_schedule(
    table: Mapping[str, Any], levels: Mapping[str, Iterable[str]], valves: Iterable[str]
) -> ScreeningSchedule:
    """The schedule of a form, by the rules of ``[[schedules]]``.

    ``levels`` has the names of areas and units by "area" and "unit". Raises ``BadSetting`` with
    every mistake; also for areas, units and valves that nobody knows.
    """
    try:
        schedule = ScheduleTable.model_validate(table).schedule()
    except ValidationError as error:
        location = TableLocation("", "schedule", lambda path: None)
        problems = problems_of(error, ScheduleTable, location)
        complaints = (
            f"{problem.key}: found {problem.found}; expected {problem.expected}"
            for problem in problems
        )
        raise BadSetting("; ".join(complaints)) from None
    for noun, asked_names, known_names in (
        ("area", schedule.areas, set(levels["area"])),
        ("unit", schedule.units, set(levels["unit"])),
        ("valve", schedule.valves, set(valves)),
    ):
        for name in asked_names:
            if name not in known_names:
                raise BadSetting(f"there is no {noun} {name!r}")
    return schedule


def as_plant_toml(limits: Mapping[str, SetLimit], schedules: Iterable[ScreeningSchedule]) -> str:
    """What was set on the pages as text for the plant file, where it then has its source."""
    parts = []
    if limits:
        lines = [f"{name} = {field.value!r}" for name, field in sorted(limits.items())]
        parts.append("\n".join(["[limits]", *lines]))
    for schedule in schedules:
        defaults = ScreeningSchedule(name="")
        lines = [
            f"{field.name} = {toml_value(getattr(schedule, field.name))}"
            for field in fields(schedule)
            if getattr(schedule, field.name) != getattr(defaults, field.name)
        ]
        parts.append("\n".join(["[[schedules]]", *lines]))
    return "\n\n".join(parts) + ("\n" if parts else "")
