"""An InfluxDB on loopback that answers InfluxQL at /query, with faults on demand."""

from __future__ import annotations

import re
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from tests.connectors.loopback_http import ReadOnlyJson, on_loopback

SELECT = re.compile(
    r'SELECT "(?P<value>[^"]+)" AS v(?:, "(?P<quality>[^"]+)" AS q)? FROM "(?P<measurement>[^"]+)"'
    r"(?: WHERE (?P<where>.*))? ORDER BY time LIMIT (?P<limit>\d+) OFFSET (?P<offset>\d+)"
)
Row = tuple[int, Any, str]  # nanoseconds, value, quality


@dataclass
class Served:
    """Points by tag, how they are laid out, what goes wrong, and what was asked."""

    points: dict[str, list[Row]]
    layout: str = "tag_key"  # or "field", "measurement"
    token: str = ""
    same_page: bool = False  # whatever is asked for next, the first page comes again
    faults: list[tuple[int, Any]] = field(default_factory=list)  # of the next requests, in turn
    asked: list[dict[str, str]] = field(default_factory=list)
    methods: set[str] = field(default_factory=set)
    url: str = ""


class Handler(ReadOnlyJson):
    """GET /query; everything else is refused and remembered."""

    served: Served
    refusal: ClassVar = {"error": "not allowed"}

    def do_GET(self) -> None:
        """The only method that a reader may use."""
        served, parts = self.served, urlsplit(self.path)
        served.methods.add("GET")
        asked = {name: words[0] for name, words in parse_qs(parts.query).items()}
        served.asked.append(asked)
        if served.faults:
            self.answer(*served.faults.pop(0))
        elif served.token and self.headers.get("Authorization") != f"Token {served.token}":
            self.answer(401, {"code": "unauthorized", "message": "unauthorized access"})
        elif parts.path != "/query" or asked.get("db") != "plant" or asked.get("epoch") != "ns":
            self.answer(404, {"error": "database not found: " + asked.get("db", "")})
        else:
            self.answer(200, {"results": [{"statement_id": 0, **self._answer(asked["q"])}]})

    def _answer(self, q: str) -> dict[str, Any]:
        served = self.served
        shown = {
            "tag_key": ('SHOW TAG VALUES FROM "opc" WITH KEY = "tag"', ["key", "value"]),
            "field": ('SHOW FIELD KEYS FROM "opc"', ["fieldKey", "fieldType"]),
            "measurement": ("SHOW MEASUREMENTS", ["name"]),
        }
        words, columns = shown[served.layout]
        if q == words:
            rows: list[list[Any]] = [
                {2: ["tag", tag] if served.layout == "tag_key" else [tag, "float"], 1: [tag]}[
                    len(columns)
                ]
                for tag in served.points
            ]
            return {"series": [{"name": "opc", "columns": columns, "values": rows}]}
        match = SELECT.fullmatch(q)
        if match is None:
            return {"error": f"error parsing query: {q}"}
        conditions = (match["where"] or "").split(" AND ")
        if served.layout == "tag_key":
            assert (match["value"], match["measurement"]) == ("value", "opc")
            tag = conditions.pop(0).removeprefix('"tag" = \'').removesuffix("'")
        else:
            tag = match["value"] if served.layout == "field" else match["measurement"]
        low, high = -(2**62), 2**62
        for condition in filter(None, conditions):
            _, sign, number = condition.split(" ")
            low, high = (int(number), high) if sign == ">=" else (low, int(number))
        if served.same_page and served.points.get(tag):
            low, match = -(2**62), SELECT.fullmatch(re.sub(r"OFFSET \d+", "OFFSET 0", q)) or match
        inside = [row for row in served.points.get(tag, []) if low <= row[0] < high]
        page = inside[int(match["offset"]) :][: int(match["limit"])]
        if not page:
            return {}
        width = 3 if match["quality"] else 2
        columns = ["time", "v", "q"][:width]
        values = [list(row[:width]) for row in page]
        return {"series": [{"name": match["measurement"], "columns": columns, "values": values}]}


def serving(served: Served) -> AbstractContextManager[Served]:
    """The server on a free port, until the block ends."""
    return on_loopback(served, Handler)
