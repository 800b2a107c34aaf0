"""``InfluxQuery``: InfluxQL over ``GET /query``, which InfluxDB 1, 2 and 3 understand alike.

A GET of ``/query`` permits SELECT and SHOW only. Shapes: InfluxData's reference of the 1.x
compatible query API; times are asked for as whole nanoseconds (``epoch=ns``).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stemwatch.connectors.archive.http_reader import (
    HttpReader,
    after_colon,
    http_client,
    one_line,
    token_of,
)
from stemwatch.connectors.archive.number_column import number_of
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.secret import Secret, masked
from stemwatch.models.recording import Floats

_MISSING = (
    "reading InfluxDB needs the package httpx, which is not installed; expected the extra: "
    "pip install 'stemwatch[influx]'"
)


@dataclass(frozen=True, kw_only=True)
class InfluxServer:
    """An InfluxDB at ``url``, and where in ``database`` the value of a tag stands.

    With ``measurement`` and ``tag_key``: in ``value_field`` of the points whose ``tag_key`` is the
    tag. With ``measurement`` alone: in its field of that name. With neither: in ``value_field`` of
    the measurement of that name.
    """

    url: str
    database: str
    measurement: str = ""
    tag_key: str = ""
    value_field: str = "value"
    quality_field: str = ""
    secret: Secret = field(default_factory=Secret)
    authority: str = ""
    timeout_s: float = 60.0
    page: int = 50_000

    def __str__(self) -> str:
        return f"InfluxDB {masked(self.url)}, {self.database}"


@dataclass(frozen=True, kw_only=True)
class Points:
    """Points of one tag: (n,) nanoseconds and values, NaN where there is no number; the quality
    codes, or none where the source has none."""

    ns: Ints
    values: Floats
    codes: Sequence[str]


class InfluxQuery:
    """An open connection to ``server``."""

    def __init__(self, server: InfluxServer, reader: HttpReader) -> None:
        self.server = server
        self._reader = reader

    def tags(self) -> list[str]:
        """The names of all tags, sorted."""
        server = self.server
        if server.tag_key:
            words = (
                f"TAG VALUES FROM {_name(server.measurement)} WITH KEY = {_name(server.tag_key)}"
            )
            column = "value"
        elif server.measurement:
            words, column = f"FIELD KEYS FROM {_name(server.measurement)}", "fieldKey"
        else:
            words, column = "MEASUREMENTS", "name"
        rows = self._rows(f"SHOW {words}")
        return sorted({str(row[column]) for row in rows if row.get(column) is not None})

    def points(self, tag: str, first: int | None, last: int | None) -> Points:
        """The points of ``tag`` from nanosecond ``first`` to before ``last``, page by page."""
        wanted, where = self._place(tag)
        if last is not None:
            where = [*where, f"time < {last}"]
        ns: list[int] = []
        values: list[float] = []
        codes: list[str] = []
        start, already_read = first, 0
        while True:
            conditions = where if start is None else [*where, f"time >= {start}"]
            text = f"SELECT {wanted}"
            text += f" WHERE {' AND '.join(conditions)}" if conditions else ""
            text += f" ORDER BY time LIMIT {self.server.page} OFFSET {already_read}"
            page = self._rows(text)
            if page and start is not None:
                self._check_next(page, start)
            if last is not None and any(self._time(row) >= last for row in page):
                raise self._not_heeded()
            for row in page:
                ns.append(self._time(row))
                values.append(number_of(row.get("v")))
                if self.server.quality_field:
                    codes.append("" if row.get("q") is None else str(row["q"]))
            if len(page) < self.server.page:
                return Points(ns=np.array(ns, dtype=np.int64), values=np.array(values), codes=codes)
            # Several points may have one time: continue after those already read.
            start = ns[-1]
            already_read = sum(1 for at in ns if at == start)

    def _check_next(self, page: Sequence[Mapping[str, Any]], start: int) -> None:
        """Raise ``ConnectorError`` for a page that makes no progress, since reading would never
        end."""
        if self._time(page[0]) < start:
            raise self._not_heeded()
        if len(page) >= self.server.page and self._time(page[-1]) == start:
            raise ConnectorError(
                f"{self.server}: more than {self.server.page} points of a tag stand at one "
                "instant; set a larger page for this source, or check tag_key"
            )

    def _not_heeded(self) -> ConnectorError:
        return ConnectorError(
            f"{self.server}: the server gave points from outside those that were asked for; "
            "expected it to heed time and OFFSET. Something between us may keep old answers; "
            "nothing of it is used"
        )

    def _place(self, tag: str) -> tuple[str, list[str]]:
        """What is selected of where, and the conditions."""
        server = self.server
        if server.tag_key:
            value, measurement = server.value_field, server.measurement
            where = [f"{_name(server.tag_key)} = {_text(tag)}"]
        elif server.measurement:
            value, measurement, where = tag, server.measurement, []
        else:
            value, measurement, where = server.value_field, tag, []
        quality = f", {_name(server.quality_field)} AS q" if server.quality_field else ""
        return f"{_name(value)} AS v{quality} FROM {_name(measurement)}", where

    def _time(self, row: Mapping[str, Any]) -> int:
        time = row.get("time")
        if not isinstance(time, int) or isinstance(time, bool) or abs(time) >= 2**63:
            raise ConnectorError(
                f"{self.server}: found the time {one_line(str(time))!r}; expected whole "
                "nanoseconds, as epoch=ns asks for"
            )
        return time

    def _rows(self, text: str) -> list[dict[str, Any]]:
        """The rows of all series, each by the names of its columns."""
        server = self.server
        parameters = {"db": server.database, "epoch": "ns", "q": text}
        too_large = f"{server.page} values"
        answer = self._reader.get("query", parameters, server.page, too_large)
        try:
            body = json.loads(answer.body)
        except (ValueError, RecursionError):
            body = None
        said = (
            one_line(str(body.get("error") or body.get("message") or ""))
            if _is_object(body)
            else ""
        )
        if answer.status in (401, 403):
            raise ConnectorError(
                f"{server}: the server refuses this token ({answer.status}{after_colon(said)}); "
                "check the secret, and that the token may read this database"
            )
        if answer.is_redirect or answer.status != 200:
            raise ConnectorError(
                f"{server}: the server answered {answer.status}{after_colon(said)}; check url and "
                "database (of InfluxDB 2 a bucket, which a DBRP mapping gives the name)"
            )
        results = body.get("results") if _is_object(body) else None
        if not isinstance(results, list) or not all(map(_is_object, results)):
            raise ConnectorError(
                f"{server}: the answer is none of an InfluxDB; check url{after_colon(said)}"
            )
        for result in results:
            if error := result.get("error"):
                raise ConnectorError(
                    f"{server}: the server answered with an error: {one_line(str(error))}"
                )
        try:
            return [
                dict(zip(series["columns"], row, strict=False))
                for result in results
                for series in result.get("series", [])
                for row in series.get("values", [])
            ]
        except (TypeError, KeyError, AttributeError):
            raise ConnectorError(
                f"{server}: the answer is none of an InfluxDB: expected series with columns and "
                "values; check url"
            ) from None


@contextmanager
def connected(server: InfluxServer) -> Iterator[InfluxQuery]:
    """A connection to ``server``.

    Raises ``ConnectorError`` where a package, the secret or the authority's file is missing.
    """
    try:
        import httpx  # noqa: F401
    except ImportError:
        raise ConnectorError(f"{server}: {_MISSING}") from None
    headers = {"Accept": "application/json"}
    if server.secret:
        headers["Authorization"] = f"Token {token_of(str(server), server.secret)}"
    name = str(server)
    with http_client(name, server.url, server.authority, server.timeout_s, headers) as client:
        yield InfluxQuery(server, HttpReader(name, client, server.timeout_s))


def _name(word: str) -> str:
    """An identifier of InfluxQL."""
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _text(word: str) -> str:
    """A string of InfluxQL."""
    return "'" + word.replace("\\", "\\\\").replace("'", "\\'") + "'"


def _is_object(body: Any) -> bool:
    return isinstance(body, dict)
