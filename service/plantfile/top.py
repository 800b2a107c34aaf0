"""The top of ``plant.toml``: what holds for the whole plant."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, get_type_hints

from pydantic import Field, ValidationError, create_model

from stemwatch.models.limits import Limits
from stemwatch.service.plantfile.explain import Place, problems_of
from stemwatch.service.plantfile.live import AlertRules, ServiceSection
from stemwatch.service.plantfile.problem import Problem
from stemwatch.service.plantfile.schema import PlantSection, StorageSection, Table

# The science owns the limits: a field it adds can be set at once.
_TYPES = get_type_hints(Limits)
_FIELDS: dict[str, Any] = {
    limit.name: (_TYPES[limit.name], Field(default=limit.default, description="a number"))
    for limit in fields(Limits)
}
LimitsSection = create_model("LimitsSection", __base__=Table, **_FIELDS)


class Top(Table):
    """The whole file; its limits, sources and valves are looked into one by one."""

    plant: PlantSection = Field(default=PlantSection(), description="a table with name and zone")
    storage: StorageSection = Field(default=StorageSection(), description="a table with the url")
    limits: dict[str, Any] = Field(default={}, description="a table of limits, each a number")
    sources: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[sources]]")
    valves: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[valves]]")
    devices: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[devices]]")
    schedules: list[dict[str, Any]] = Field(
        default=[], description="tables, each headed [[schedules]]"
    )
    notifiers: list[dict[str, Any]] = Field(
        default=[], description="tables, each headed [[notifiers]]"
    )
    alerts: AlertRules = Field(default=AlertRules(), description="a table of rules for alerts")
    service: ServiceSection = Field(
        default=ServiceSection(), description="a table of settings of the service"
    )
    valve_list: Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description='the name of a CSV file, such as "valves.csv"'
    )


def read_top(data: dict[str, Any], place: Place) -> tuple[Top, list[Problem]]:
    """What holds for the whole plant; where there are problems, an empty ``Top`` with them."""
    try:
        return Top.model_validate(data), []
    except ValidationError as error:
        return Top(), problems_of(error, Top, place)


def read_limits(table: Any, place: Place) -> tuple[Limits, list[Problem]]:
    """The limits, with the default for each that is not given."""
    if not isinstance(table, dict):
        return Limits(), []  # reported with the top
    try:
        given = LimitsSection.model_validate(table)
        return Limits(**given.model_dump()), []
    except ValidationError as error:
        return Limits(), problems_of(error, LimitsSection, place)
    except ValueError as error:
        # Raised by Limits itself; its sentence says what was expected and received.
        expected = str(error).removeprefix("expected ")
        return Limits(), [place.problem((), "limits that contradict one another", expected)]
