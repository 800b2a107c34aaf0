"""``PiWebApi``: requests to a PI Web API, one at a time, GET and nothing else.

Addresses, parameters and shapes are those of AVEVA's PI Web API reference (controllers Point,
DataServer, StreamSet and Stream).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, Literal

from stemwatch.connectors.archive.http_reader import (
    HttpAnswer,
    HttpReader,
    Parameter,
    after_colon,
    http_client,
    one_line,
    token_of,
)
from stemwatch.connectors.connector import ConnectorError, UnknownTag
from stemwatch.connectors.secret import Secret, masked

if TYPE_CHECKING:
    import httpx

SignIn = Literal["basic", "bearer", "kerberos", "anonymous"]

LEAST_PAGE = 100
WEB_ID = "webid:"  # prefix of a tag that is a WebId and not a name
_IS_WEB_ID = re.compile(r"[A-Za-z0-9_-]+")
_MISSING = (
    "reading PI needs the package httpx, which is not installed; expected the extra: "
    "pip install 'stemwatch[pi]'"
)
_NO_KERBEROS = (
    "signing in with Kerberos needs the package httpx-gssapi (Linux) or httpx-negotiate-sspi "
    "(Windows), and neither is installed; install it, or let the administrator give a user "
    'for sign_in = "basic"'
)
_POINT = "WebId;Name;Path;Descriptor;EngineeringUnits;PointType;Zero;Span"
_VALUES = "Timestamp;Value;Good;Questionable;Substituted;UnitsAbbreviation;Errors"


@dataclass(frozen=True, kw_only=True)
class PiServer:
    """A PI Web API at ``url``, how to sign in, and the data archive ``server`` whose points tags
    are names of. ``page`` is how many values of a tag are asked for at a time."""

    url: str
    server: str
    sign_in: SignIn = "anonymous"
    user: str = ""
    secret: Secret = field(default_factory=Secret)
    authority: str = ""  # file with the certificates of the site's own authority
    timeout_s: float = 60.0
    page: int = 10_000

    def __str__(self) -> str:
        return f"PI {masked(self.url)}"


@dataclass(frozen=True, kw_only=True)
class PiPoint:
    """A point of the data archive: what a tag names."""

    web_id: str
    name: str
    description: str = ""
    unit: str = ""
    measuring_range: tuple[float, float] | None = None


class PiWebApi:
    """An open connection to ``server``."""

    def __init__(self, server: PiServer, client: httpx.Client) -> None:
        self.server = server
        self._reader = HttpReader(str(server), client, server.timeout_s)
        self._page = server.page

    def point(self, tag: str) -> PiPoint:
        """The point that ``tag`` names, or whose WebId it is.

        Raises ``UnknownTag`` with the points whose names begin alike.
        """
        if tag.startswith(WEB_ID):
            web_id = tag.removeprefix(WEB_ID)
            if not _IS_WEB_ID.fullmatch(web_id):
                raise UnknownTag(
                    f"{self.server}: {tag!r} is no WebId; expected letters, digits, - and _ "
                    f"after {WEB_ID}"
                )
            answer = self._get(f"points/{web_id}", {"selectedFields": _POINT}, missing=tag)
        else:
            path = rf"\\{self.server.server}\{tag}"
            answer = self._get("points", {"path": path, "selectedFields": _POINT}, missing=tag)
        return _point(answer)

    def points(self, pattern: str) -> Iterator[PiPoint]:
        """The points whose name fits ``pattern`` (with ``*`` and ``?``), page by page."""
        query = {"name": self.server.server, "selectedFields": "WebId"}
        archive = self._get("dataservers", query, missing=f"data server {self.server.server}")
        web_id = self._given(_point(archive).web_id)
        first = 0
        known: set[str] = set()
        while True:
            parameters = {
                "nameFilter": pattern,
                "startIndex": str(first),
                "maxCount": "1000",
                "selectedFields": ";".join(f"Items.{name}" for name in _POINT.split(";")),
            }
            points = [
                _point(item)
                for item in self._items(self._get(f"dataservers/{web_id}/points", parameters))
            ]
            if points and known.issuperset(point.web_id for point in points):
                raise self._same_page()
            yield from points
            known.update(point.web_id for point in points)
            first += len(points)
            if len(points) < 1000:
                return

    def recorded(self, web_ids: Sequence[str], start: str, end: str) -> dict[str, list[Any]]:
        """The recorded values of each stream from ``start`` to ``end``, both included.

        All streams are asked for together; those with more than a page are read on by themselves.
        """
        values_of_point: dict[str, list[Any]] = {web_id: [] for web_id in web_ids}
        while True:
            try:
                answer = self._get(
                    "streamsets/recorded", self._query_parameters(start, end, web_ids, "Items.")
                )
                break
            except _PageTooLarge:
                self._smaller_page()
        for stream in self._items(answer):
            self._check(stream)
            if (web_id := stream.get("WebId")) in values_of_point:
                values_of_point[web_id] = list(self._items(stream))
        for web_id, values in values_of_point.items():
            if len(values) >= self._page:
                self._read_on(web_id, values, end)
        return values_of_point

    def _read_on(self, web_id: str, values: list[Any], end: str) -> None:
        """Add the values after a full page; values at the instant where the page ended are sent
        again."""
        while True:
            last = str(values[-1].get("Timestamp"))
            already_read = sum(value.get("Timestamp") == last for value in values)
            try:
                parameters = self._query_parameters(last, end, (), "")
                page = self._items(self._get(f"streams/{self._given(web_id)}/recorded", parameters))
            except _PageTooLarge:
                self._smaller_page()
                continue
            repeated = sum(value.get("Timestamp") == last for value in page)
            if page and _sortable(page[0]) < _sortable(values[-1]):
                raise self._same_page()
            new = page[min(already_read, repeated) :]
            if not new and len(page) >= self._page:
                raise ConnectorError(
                    f"{self.server}: more than {self._page} values stand at {last}, so that the "
                    "page never ends; set a larger page for this source"
                )
            values += new
            if len(page) < self._page:
                return

    def _given(self, web_id: str) -> str:
        """A WebId that the server gave: it becomes a part of addresses."""
        if not _IS_WEB_ID.fullmatch(web_id):
            raise ConnectorError(
                f"{self.server}: the server gave {one_line(web_id)!r} where a WebId is expected; "
                "check url, which ends in /piwebapi as a rule"
            )
        return web_id

    def _same_page(self) -> ConnectorError:
        return ConnectorError(
            f"{self.server}: the server gave the same page again when it was asked for the next "
            "one; expected it to heed startIndex and startTime. Something between us may keep old "
            "answers; nothing of it is used"
        )

    def _query_parameters(
        self, start: str, end: str, web_ids: Sequence[str], prefix: str
    ) -> list[Parameter]:
        fields = [f"{prefix}Items.{name}" for name in _VALUES.split(";")]
        if prefix:
            fields += [f"{prefix}WebId", f"{prefix}Errors"]
        return [
            *(("webId", web_id) for web_id in web_ids),
            ("startTime", start),
            ("endTime", end),
            ("boundaryType", "Inside"),
            ("maxCount", str(self._page)),
            ("selectedFields", ";".join([*fields, "Errors"])),
        ]

    def _smaller_page(self) -> None:
        if self._page <= LEAST_PAGE:
            raise ConnectorError(
                f"{self.server}: the server refuses even {self._page} values at a time; ask its "
                "administrator for a larger MaxReturnedItemsPerCall"
            )
        self._page = max(self._page // 2, LEAST_PAGE)

    def _get(
        self,
        path: str,
        parameters: Mapping[str, str] | list[Parameter],
        missing: str = "",
    ) -> dict[str, Any]:
        """The JSON object at ``path``; ``missing`` is what a 404 says is not there."""
        streams = sum(name == "webId" for name, _ in parameters) if type(parameters) is list else 0
        too_large = f"{self._page} values for each tag"
        answer = self._reader.get(path, parameters, self._page * (streams + 1), too_large)
        return self._object(answer, missing)

    def _object(self, answer: HttpAnswer, missing: str) -> dict[str, Any]:
        status = answer.status
        try:
            body = json.loads(answer.body)
        except (ValueError, RecursionError):  # not JSON, or with endless numbers or nesting
            body = None
        errors = _errors(body)
        if status == 404 and missing:
            raise UnknownTag(f"{self.server}: there is no {missing!r}{after_colon(errors)}")
        if status == 400 and "maxcount" in errors.lower().replace(" ", ""):
            raise _PageTooLarge
        if status in (401, 403):
            raise ConnectorError(
                f"{self.server}: the server refuses this account ({status}{after_colon(errors)}); "
                "check sign_in, the user and the secret, and that the account may read these points"
            )
        if answer.is_redirect:
            raise ConnectorError(
                f"{self.server}: the server sends on to another address; expected the PI Web API "
                f"itself. Set url to where it is, {one_line(answer.headers.get('Location', ''))}"
            )
        if status != 200:
            raise ConnectorError(
                f"{self.server}: the server answered {status}{after_colon(errors)}"
            )
        if not isinstance(body, dict):
            raise ConnectorError(
                f"{self.server}: the answer is no JSON object; expected a PI Web API. Check url, "
                "which ends in /piwebapi as a rule"
            )
        self._check(body)
        return body

    def _check(self, body: Mapping[str, Any]) -> None:
        """Raise ``ConnectorError`` for errors inside an answer with status 200."""
        if errors := _errors(body):
            raise ConnectorError(f"{self.server}: the server answered with an error: {errors}")

    def _items(self, body: Mapping[str, Any]) -> list[Any]:
        items = body.get("Items", [])
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            raise ConnectorError(f"{self.server}: Items is no list of objects in the answer")
        return items


class _PageTooLarge(Exception):
    """The server gives fewer values at a time than were asked for."""


@contextmanager
def connected(server: PiServer) -> Iterator[PiWebApi]:
    """A connection to ``server``.

    Raises ``ConnectorError`` where a package, the secret or the authority's file is missing.
    """
    try:
        import httpx  # noqa: F401
    except ImportError:
        raise ConnectorError(f"{server}: {_MISSING}") from None
    auth, headers = _auth(server), _headers(server)
    with http_client(
        str(server), server.url, server.authority, server.timeout_s, headers, auth
    ) as client:
        yield PiWebApi(server, client)


def _auth(server: PiServer) -> Any:
    import httpx

    if server.sign_in == "basic":
        return httpx.BasicAuth(server.user, server.secret.reveal())
    if server.sign_in != "kerberos":
        return None
    try:
        from httpx_gssapi import HTTPSPNEGOAuth

        return HTTPSPNEGOAuth()
    except ImportError:
        pass
    try:
        from httpx_negotiate_sspi import HttpSspiAuth

        return HttpSspiAuth()
    except ImportError:
        raise ConnectorError(f"{server}: {_NO_KERBEROS}") from None


def _headers(server: PiServer) -> dict[str, str]:
    headers = {"Accept": "application/json", "X-Requested-With": "stemwatch"}
    if server.sign_in == "bearer":
        headers["Authorization"] = f"Bearer {token_of(str(server), server.secret)}"
    return headers


def _point(point: Mapping[str, Any]) -> PiPoint:
    return PiPoint(
        web_id=str(point.get("WebId", "")),
        name=str(point.get("Name", "")),
        description=str(point.get("Descriptor") or ""),
        unit=str(point.get("EngineeringUnits") or ""),
        measuring_range=_range(point),
    )


def _range(point: Mapping[str, Any]) -> tuple[float, float] | None:
    """From zero to zero and span of a point that holds numbers; else ``None``."""
    zero, span = point.get("Zero"), point.get("Span")
    is_number = str(point.get("PointType", "")).startswith(("Float", "Int"))
    if not is_number or not isinstance(zero, int | float) or not isinstance(span, int | float):
        return None
    low, high = float(zero), float(zero) + float(span)
    return (low, high) if isfinite(low) and isfinite(high) and low < high else None


def _sortable(value: Mapping[str, Any]) -> str:
    """The time of a value as texts compare: seconds, then nine decimals."""
    seconds, _, decimals = str(value.get("Timestamp")).removesuffix("Z").partition(".")
    return f"{seconds}.{decimals:0<9}"


def _errors(body: Any) -> str:
    """What an answer says went wrong, on one line; empty where nothing did."""
    if not isinstance(body, dict):
        return ""
    said = body.get("Errors") or body.get("Message") or ""
    words = said if isinstance(said, list) else [said]
    return one_line("; ".join(str(word) for word in words if word))
