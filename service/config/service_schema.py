"""The tables of ``plant.toml`` for the service: schedules, alerts, notifiers, ``[service]``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from importlib.metadata import entry_points
from ipaddress import ip_network
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from stemwatch.connectors.settings import (
    LONGEST_S,
    Duration,
    Name,
    Positive,
    TomlTable,
    contradiction,
)
from stemwatch.service.config.cron import CronTimes
from stemwatch.service.store.runs.schedule import ScreeningSchedule

NOTIFIERS = "stemwatch.notifiers"
Severity = Literal["high", "medium", "low"]
SHORTEST_S = 10.0
# Headers with another meaning, or that clients and browsers set by themselves.
_NEVER_A_USER = frozenset(
    ("authorization", "cookie", "host", "origin", "referer", "user-agent", "x-forwarded-for")
)
_ANY_DAY = datetime(2026, 1, 1, tzinfo=UTC)
MOST_PROXIES = 256  # addresses from which a request may name its user
_HOST_AND_PORT = re.compile(r"[^/\s]+:\d+")


def _readable_cron(expression: str) -> str:
    try:
        times = CronTimes(expression, "UTC")
    except ValueError as error:
        raise ValueError(f'five cron fields, such as "30 5 * * 1" ({error})') from None
    if times.after(_ANY_DAY) is None:
        raise ValueError(f"a day that comes; no month has the days of {expression!r}")
    return expression


def _readable_network(text: str) -> str:
    try:
        ip_network(text)
    except ValueError as error:
        raise ValueError('an address or network, such as "127.0.0.1" or "10.0.0.0/24"') from error
    return text


class ScheduleTable(TomlTable):
    """``[[schedules]]``: when which valves are screened."""

    name: Name = Field(description="a name of its own for the schedule, as text")
    cron: Annotated[str, AfterValidator(_readable_cron)] | None = Field(
        default=None, description='five cron fields as text, such as "30 5 * * 1"'
    )
    every_s: Annotated[float, Field(ge=SHORTEST_S, le=LONGEST_S)] | None = Field(
        default=None,
        description=f"seconds from one run to the next, {SHORTEST_S:g} or more, at most ten years",
    )
    jitter_s: Annotated[float, Field(ge=0, le=86400)] = Field(
        default=0.0, description="seconds over which beginnings are spread, 0 to 86400"
    )
    window_s: Duration | None = Field(
        default=None,
        description="seconds of recording that a run looks at, above 0, at most ten years",
    )
    areas: list[Name] = Field(
        default=[], description='a list of areas, such as ["Crude", "Utilities"]'
    )
    units: list[Name] = Field(default=[], description='a list of units, such as ["100", "200"]')
    valves: list[Name] = Field(default=[], description='a list of ids, such as ["FIC-101"]')
    enabled: bool = Field(default=True, description="true or false")

    @model_validator(mode="after")
    def _either_cron_or_interval(self) -> Self:
        if (self.cron is None) == (self.every_s is None):
            found_text = (
                "neither cron nor every_s" if self.cron is None else "both cron and every_s"
            )
            raise contradiction(("cron",), found_text, "one of the two")
        return self

    def schedule(self) -> ScreeningSchedule:
        """The schedule as it is stored."""
        values = self.model_dump()
        lists = {key: tuple(value) for key, value in values.items() if isinstance(value, list)}
        return ScreeningSchedule(**values | lists)


class AlertRules(TomlTable):
    """``[alerts]``: when alerts are raised and closed.

    A finding is raised when it occurred in ``raise_after_runs`` of the last ``of_runs`` runs, and
    closed when it did not occur in ``clear_after_runs`` runs in a row.
    """

    raise_after_runs: Annotated[int, Field(ge=1, le=20)] = Field(
        default=2, description="a whole number of runs, 1 to 20"
    )
    of_runs: Annotated[int, Field(ge=1, le=20)] = Field(
        default=3, description="a whole number of runs, 1 to 20"
    )
    clear_after_runs: Annotated[int, Field(ge=1, le=20)] = Field(
        default=3, description="a whole number of runs, 1 to 20"
    )
    grown_S_percent: Positive = Field(
        default=0.5, description="percent of OP span by which S grows at least, above 0"
    )
    foreseen_within_weeks: Annotated[float, Field(ge=0, le=52)] = Field(
        default=8.0, description="weeks, 0 to 52; 0 for no alert of this kind"
    )
    sticking_suspected: bool = Field(default=False, description="true or false")
    silent_after_s: Duration = Field(
        default=900.0, description="seconds without a good sample, above 0"
    )
    common_valves: Annotated[int, Field(ge=2)] = Field(
        default=5, description="a whole number of valves, 2 or more"
    )
    common_share: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.3,
        description="a share of the valves of an area, unit or source, above 0 and up to 1",
    )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.raise_after_runs > self.of_runs:
            found_text = f"raise_after_runs = {self.raise_after_runs} of of_runs = {self.of_runs}"
            raise contradiction(("raise_after_runs",), found_text, "at most of_runs")
        return self


_NEEDED = {"mail": ("host", "sender", "to"), "webhook": ("url",), "file": ("path",)}


def notifier_kinds() -> tuple[str, ...]:
    """The kinds of notifier that are installed: the entry points ``stemwatch.notifiers``."""
    return tuple(sorted(point.name for point in entry_points(group=NOTIFIERS)))


class NotifierTable(TomlTable):
    """``[[notifiers]]``: who gets messages about alerts, and how; ``kind`` decides which keys are
    needed."""

    name: Name = Field(description="a name of its own for the notifier, as text")
    kind: Name = Field(
        description='"mail", "webhook", "file", or a kind from a package of your own'
    )
    least_severity: Severity = Field(default="low", description='"high", "medium" or "low"')
    host: Name | None = Field(default=None, description="the mail server's name, as text")
    port: Annotated[int, Field(ge=1, le=65535)] | None = Field(
        default=None, description="a port, 1 to 65535"
    )
    security: Literal["starttls", "tls", "none"] = Field(
        default="starttls", description='"starttls", "tls" or "none"'
    )
    user: Name | None = Field(default=None, description="the name to log in with, as text")
    secret_variable: Name | None = Field(
        default=None, description="the name of the environment variable that holds the secret"
    )
    secret_file: Name | None = Field(
        default=None, description="the name of a file that holds nothing but the secret"
    )
    sender: Name | None = Field(default=None, description="the sender's address, as text")
    to: list[Name] = Field(default=[], description='a list of addresses, such as ["a@plant.org"]')
    url: Name | None = Field(default=None, description="an address with http:// or https://")
    allow_private: bool = Field(default=False, description="true or false")
    path: Name | None = Field(default=None, description="a file, relative to the plant file")
    options: dict[str, Any] = Field(
        default={}, description="a table with the keys of a kind from a package of your own"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        kinds = notifier_kinds()
        if self.kind not in kinds:
            expected = (
                f"one of {', '.join(map(repr, kinds))}" if kinds else "an installed stemwatch"
            )
            raise contradiction(("kind",), repr(self.kind), expected)
        needed = _NEEDED.get(self.kind, ())
        for key in needed:
            if not getattr(self, key):
                expected = f"{', '.join(needed)} for {self.kind}"
                raise contradiction((key,), "nothing", expected)
        if self.options and self.kind in _NEEDED:
            raise contradiction(("options",), "a table", f"no options for {self.kind}")
        if self.url is not None and not self.url.startswith(("http://", "https://")):
            raise contradiction(("url",), repr(self.url), "an address with http:// or https://")
        if self.secret_variable is not None and self.secret_file is not None:
            both_given = "both secret_variable and secret_file"
            raise contradiction(("secret_file",), both_given, "one of the two")
        if self.user is not None and not (self.secret_variable or self.secret_file):
            found_text = "a user without a password"
            raise contradiction(("user",), found_text, "secret_variable or secret_file as well")
        return self


class ServiceSection(TomlTable):
    """``[service]``: folders, limits and executor of the service."""

    address: Annotated[str, Field(pattern=r"^(|https?://[^\s?#]+)$")] = Field(
        default="", description="where people reach the pages, such as https://valves.example/"
    )
    trusted_proxies: list[Annotated[str, AfterValidator(_readable_network)]] = Field(
        default=[],
        description='a list of addresses or networks of proxies, such as ["127.0.0.1"]',
    )
    user_header: Annotated[str, Field(pattern=r"^(|[A-Za-z][A-Za-z0-9-]*)$")] = Field(
        default="",
        description="the header in which trusted_proxies name who is signed in, such as "
        '"X-Remote-User"',
    )
    user_header_role: Literal["", "viewer", "engineer"] = Field(
        default="",
        description='the role of those who are no users yet: "viewer", "engineer", or "" to '
        "refuse them",
    )
    spool: Name = Field(
        default="stemwatch-spool", description="a folder, relative to the plant file"
    )
    reports: Name = Field(
        default="stemwatch-reports", description="a folder, relative to the plant file"
    )
    keep_reports: Annotated[int, Field(ge=1)] = Field(
        default=30, description="a whole number of reports, 1 or more"
    )
    report_valves: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=100, description="a whole number of valves, 1 to 1000"
    )
    networks: bool = Field(default=True, description="true or false")
    keep_samples_days: Annotated[float, Field(gt=0, le=36_600)] = Field(
        default=90.0, description="days, above 0, at most 36600"
    )
    window_s: Duration = Field(
        default=86400.0, description="seconds of recording that a run looks at, above 0"
    )
    workers: Annotated[int, Field(ge=1, le=256)] | None = Field(
        default=None, description="a whole number of processes, 1 to 256"
    )
    executor: Name = Field(default="local", description='"local" or "dask://HOST:PORT"')
    valve_timeout_s: Annotated[float, Field(ge=1)] = Field(
        default=120.0, description="seconds, 1 or more"
    )

    @model_validator(mode="after")
    def _explicit_proxies(self) -> Self:
        """Each proxy that may name the user of a request must be listed by its own address."""
        if not self.user_header:
            if self.user_header_role:
                raise contradiction(("user_header_role",), "no user_header", "user_header as well")
            return self
        if self.user_header.lower() in _NEVER_A_USER:
            expected = "a header of its own, such as X-Remote-User"
            raise contradiction(("user_header",), repr(self.user_header), expected)
        if not self.trusted_proxies:
            expected = "trusted_proxies as well: who else could say who is signed in"
            raise contradiction(("user_header",), "no trusted_proxies", expected)
        for text in self.trusted_proxies:
            if ip_network(text).num_addresses > MOST_PROXIES:
                expected = f"the proxy's own address, or a network of at most {MOST_PROXIES}"
                raise contradiction(("trusted_proxies",), repr(text), expected)
        return self

    @model_validator(mode="after")
    def _known_executor(self) -> Self:
        """``local``, a cluster, or what the entry point group ``stemwatch.executors`` has."""
        name, separator, address_part = self.executor.partition("://")
        if self.executor == "local" or (name == "dask" and _HOST_AND_PORT.fullmatch(address_part)):
            return self
        others = {entry.name for entry in entry_points(group="stemwatch.executors")} - {"dask"}
        if separator and name in others:
            return self
        other_forms = "".join(f', or "{other}://..."' for other in sorted(others))
        expected = f'"local" or "dask://HOST:PORT"{other_forms}'
        raise contradiction(("executor",), repr(self.executor), expected)
