"""``PiArchive``: a PI Data Archive behind its PI Web API as a source of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from stemwatch.connectors.archive.settings import HttpArchiveSettings
from stemwatch.connectors.connector import (
    RANGE_HIGH,
    RANGE_LOW,
    WHOLE,
    ArchiveAddress,
    TagInfo,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.pi.web_api import WEB_ID, PiServer, SignIn
from stemwatch.connectors.settings import Name, Text, contradiction
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.columns import Column
    from stemwatch.connectors.pi.web_api import PiPoint, PiWebApi

LAYOUT = "PI Web API, recorded values of a point for each tag"
_FIRST = datetime(1970, 1, 2, tzinfo=UTC)
_URL = "the address of a PI Web API such as https://host/piwebapi"


@dataclass(frozen=True, kw_only=True)
class PiAddress(PiServer):
    """A server, as it is sent to the worker that reads it; an ``ArchiveAddress``.

    ``before_s`` seconds before each window are read too, because PI keeps values when they change.
    ``pattern`` limits which points are listed; ``good`` are the marks that are taken as good.
    """

    before_s: float = 3600.0
    pattern: str = "*"
    good: tuple[str, ...] = ()

    def open(self) -> PiArchive:
        """The archive; no connection is made yet."""
        return PiArchive(self)


class PiSettings(HttpArchiveSettings):
    """``kind = "pi"``: points of a PI Data Archive, through the PI Web API."""

    url: Name = Field(description=_URL)
    server: Name = Field(description="the name of the PI Data Archive whose points the tags are")
    sign_in: SignIn = Field(description='"kerberos", "basic", "bearer" or "anonymous"')
    user: Text | None = Field(default=None, description="the name to sign in with, as text")
    page: Annotated[int, Field(ge=100, le=1_000_000)] = Field(
        default=10_000, description="values of a tag asked for at a time, 100 to 1000000"
    )
    pattern: Name = Field(
        default="*", description="names of the points that are listed, such as FIC*"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        self.check_url(_URL)
        if self.sign_in in ("basic", "bearer"):
            if self.secrets_named != 1:
                found_text = f'sign_in = "{self.sign_in}" without one place for the secret'
                raise contradiction(
                    ("sign_in",), found_text, "secret_variable or secret_file as well"
                )
            self.check_encrypted("secret")
        elif self.secrets_named or self.user:
            found_text = f'sign_in = "{self.sign_in}" with a user or a secret'
            raise contradiction(
                ("sign_in",), found_text, '"basic" or "bearer", or no user and secret'
            )
        if self.sign_in == "basic" and not self.user:
            raise contradiction(("user",), "nothing", 'a name, for sign_in = "basic"')
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the server; files count from ``folder``. Times are UTC, so that no zone is needed."""
        return PiAddress(
            url=self.url,
            server=self.server,
            sign_in=self.sign_in,
            user=self.user or "",
            secret=self.secret(folder),
            authority=self.authority_file(folder),
            timeout_s=self.timeout_s,
            page=self.page,
            before_s=3600.0 if self.before_s is None else self.before_s,
            pattern=self.pattern,
            good=tuple(self.good_quality or ()),
        )


class PiArchive:
    """A PI Data Archive; implements ``stemwatch.connectors.connector.Connector``.

    A tag is the name of a point, or ``webid:`` and a WebId. Nothing but GET is ever sent.
    """

    settings = PiSettings

    def __init__(self, address: PiAddress) -> None:
        self.address = address

    def tags(self) -> Sequence[TagInfo]:
        """Every point that fits the address's pattern, with role and valve proposed from its name;
        samples are not counted."""
        from stemwatch.connectors.historian.tags.roles import propose_roles
        from stemwatch.connectors.pi.web_api import connected

        with connected(self.address) as api:
            points = {point.name: point for point in api.points(self.address.pattern)}
        tags = [(p.name, p.unit, p.description, None) for p in points.values()]
        return [
            proposed.info(facts=_range_facts(points[proposed.tag]))
            for proposed in propose_roles(tags, stem="", mv_is_output=False)
        ]

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles beside OP and MV whose point the archive does not have."""
        from stemwatch.connectors.archive.valve_columns import with_existing
        from stemwatch.connectors.pi.web_api import connected

        def existing(optional: frozenset[str]) -> set[str]:
            with connected(self.address) as api:
                return {tag for tag in optional if _exists(api, tag)}

        return with_existing(valve, existing)

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve, from recorded values: all its tags in one request.

        Raises ``UnknownTag`` for a point that is not there, and ``ConnectorError`` for a window
        without values of OP, and a server that does not answer.
        """
        from stemwatch.connectors.archive.valve_columns import recording_of_columns
        from stemwatch.connectors.historian.recordings import need_op
        from stemwatch.connectors.pi.values import ZONE
        from stemwatch.connectors.pi.web_api import connected

        server = str(self.address)
        need_op(server, valve)
        with connected(self.address) as api:
            points = {mapping.tag: self._point(api, mapping.tag) for mapping in valve.tags.values()}
            web_ids = sorted({point.web_id for point in points.values()})
            values = api.recorded(web_ids, *self._bounds(window))
        columns = {
            mapping.tag: self._column(
                mapping.tag, role, points[mapping.tag], values[points[mapping.tag].web_id], window
            )
            for role, mapping in valve.tags.items()
        }
        return recording_of_columns(server, LAYOUT, ZONE, columns, valve, window)

    def _bounds(self, window: Window) -> tuple[str, str]:
        """The window as the server reads times; it also gives what lies at the end itself."""
        start = _FIRST
        if window.start is not None:
            start = window.start - timedelta(seconds=self.address.before_s)
        return _written(start), "*" if window.stop is None else _written(window.stop)

    def _column(
        self, tag: str, role: Role, point: PiPoint, values: list[dict[str, object]], window: Window
    ) -> Column:
        from stemwatch.connectors.archive.valve_columns import (
            bounds_of,
            empty_column,
            within_bounds,
        )
        from stemwatch.connectors.pi.values import column_of

        if not values:
            return empty_column(tag)
        column = column_of(
            tag,
            values,
            unit=point.unit,
            source_name=str(self.address),
            good=self.address.good,
            as_mode=role is Role.MODE,
        )
        return within_bounds(column, bounds_of(window, self.address.before_s))

    def _point(self, api: PiWebApi, tag: str) -> PiPoint:
        """The point of ``tag``. Raises ``UnknownTag`` with the names that come nearest."""
        try:
            return api.point(tag)
        except UnknownTag as error:
            if tag.startswith(WEB_ID):
                raise
            pattern = f"{tag[: max(len(tag) // 2, 1)]}*"
            names = [point.name for point in api.points(pattern)]
            near_names = nearest_names(tag, names) or f"none: no point is called {pattern}"
            raise UnknownTag(f"{error}; the nearest are {near_names}") from None


def _range_facts(point: PiPoint) -> dict[str, float]:
    if point.measuring_range is None:
        return {}
    return dict(zip((RANGE_LOW, RANGE_HIGH), point.measuring_range, strict=True))


def _exists(api: PiWebApi, tag: str) -> bool:
    try:
        api.point(tag)
    except UnknownTag:
        return False
    return True


def _written(instant: datetime) -> str:
    return instant.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
