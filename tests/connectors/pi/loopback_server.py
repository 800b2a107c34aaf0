"""A PI Web API on loopback, in the shapes of its reference, with faults on demand."""

from __future__ import annotations

import base64
import fnmatch
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from tests.connectors.loopback_http import ReadOnlyJson, on_loopback

ARCHIVE = "PISRV1"
Value = dict[str, Any]


def value(timestamp: str, number: Any, **marks: Any) -> Value:
    """A recorded value as the server writes it."""
    plain = {"Good": True, "Questionable": False, "Substituted": False, "UnitsAbbreviation": ""}
    return {"Timestamp": timestamp, "Value": number, **plain, **marks}


def system_state(timestamp: str, name: str) -> Value:
    """What stands where a collector could not read: a digital state in place of a number."""
    state = {"Name": name, "Value": 246, "IsSystem": True}
    return value(timestamp, state, Good=False)


@dataclass
class Served:
    """What the server has, what it does wrong, and what it was asked."""

    points: dict[str, list[Value]]
    units: dict[str, str] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)  # zero and span
    most: int = 150_000  # values for one stream at a time
    user: str = ""  # and password, where the server wants them: name:password
    token: str = ""
    # Of the next requests, in turn: (status, headers, body); None answers as always.
    faults: list[tuple[int, dict[str, str], Any] | None] = field(default_factory=list)
    errors_of: dict[str, list[str]] = field(default_factory=dict)  # inside a success, by tag
    same_page: bool = False  # whatever is asked for next, the first page comes again
    late_s: list[float] = field(default_factory=list)  # before the next answers, in turn
    asked: list[str] = field(default_factory=list)
    methods: set[str] = field(default_factory=set)
    url: str = ""


def web_id(tag: str) -> str:
    """The WebId of a point: opaque, as the real ones are."""
    return "F1Dp" + base64.urlsafe_b64encode(tag.encode()).decode().rstrip("=")


class Refused(Exception):
    """An answer other than 200."""

    def __init__(self, status: int, *errors: str) -> None:
        self.status, self.body = status, {"Errors": list(errors)}


class Handler(ReadOnlyJson):
    """Points, dataservers, streams and streamsets; everything else is refused and remembered."""

    served: Served
    refusal: ClassVar = {"Errors": ["not allowed"]}

    def do_GET(self) -> None:
        """The only method that a reader may use."""
        served = self.served
        served.methods.add("GET")
        served.asked.append(self.path)
        if served.late_s:
            threading.Event().wait(served.late_s.pop(0))  # tests replace time.sleep
        if served.faults and (fault := served.faults.pop(0)) is not None:
            status, headers, body = fault
            self.answer(status, body, headers)
            return
        try:
            self.answer(200, self._answer())
        except Refused as refused:
            self.answer(refused.status, refused.body)

    def _answer(self) -> Any:
        self._check_sign_in()
        parts = urlsplit(self.path)
        requested = parse_qs(parts.query)
        steps = parts.path.removeprefix("/piwebapi/").split("/")
        match steps:
            case ["points"]:
                return self._point(requested["path"][0].removeprefix(rf"\\{ARCHIVE}" + "\\"))
            case ["points", one]:
                return self._point(self._tag(one))
            case ["dataservers"]:
                if requested["name"][0] != ARCHIVE:
                    raise Refused(404, "The specified data server was not found.")
                return {"WebId": "F1DS"}
            case ["dataservers", "F1DS", "points"]:
                return self._points(requested)
            case ["streams", one, "recorded"]:
                return {"Links": {}, **self._recorded(self._tag(one), requested)}
            case ["streamsets", "recorded"]:
                tags = [self._tag(item) for item in requested["webId"]]
                streams = [
                    {"WebId": web_id(tag), "Name": tag, **self._recorded(tag, requested)}
                    for tag in tags
                ]
                return {"Links": {}, "Items": streams}
        raise Refused(404, "No HTTP resource was found.")

    def _check_sign_in(self) -> None:
        given, served = self.headers.get("Authorization", ""), self.served
        if served.user:
            expected = "Basic " + base64.b64encode(served.user.encode()).decode()
        elif served.token:
            expected = f"Bearer {served.token}"
        else:
            return
        if given != expected:
            raise Refused(401, "Authorization has been denied for this request.")

    def _tag(self, wanted: str) -> str:
        for tag in self.served.points:
            if web_id(tag) == wanted:
                return tag
        raise Refused(404, "The specified stream was not found.")

    def _point(self, tag: str) -> Value:
        known = {name.lower(): name for name in self.served.points}  # PI compares without case
        if tag.lower() not in known:
            raise Refused(404, f"PI Point not found '\\\\{ARCHIVE}\\{tag}'.")
        name = known[tag.lower()]
        return {
            "WebId": web_id(name),
            "Name": name,
            "Descriptor": "",
            "EngineeringUnits": self.served.units.get(name, ""),
            "PointType": "Float32",
            "Zero": self.served.ranges.get(name, (0.0, 0.0))[0],
            "Span": self.served.ranges.get(name, (0.0, 0.0))[1],
        }

    def _points(self, asked: dict[str, list[str]]) -> Value:
        names = sorted(fnmatch.filter(self.served.points, asked["nameFilter"][0]))
        first, most = int(asked["startIndex"][0]), int(asked["maxCount"][0])
        first = 0 if self.served.same_page else first
        return {"Items": [self._point(name) for name in names[first : first + most]]}

    def _recorded(self, tag: str, asked: dict[str, list[str]]) -> Value:
        assert asked["boundaryType"] == ["Inside"]
        most = int(asked["maxCount"][0])
        if most > self.served.most:
            raise Refused(400, f"Parameter 'maxCount' is larger than {self.served.most}.")
        if errors := self.served.errors_of.get(tag):
            return {"Errors": errors, "Items": []}
        start, end = asked["startTime"][0], asked["endTime"][0]
        start = "" if self.served.same_page else start
        inside = [
            point
            for point in self.served.points[tag]
            if _key(point["Timestamp"]) >= _key(start)
            and (end == "*" or _key(point["Timestamp"]) <= _key(end))
        ]
        return {"Items": inside[:most]}


def _key(timestamp: str) -> str:
    """A time as it compares: seconds, then seven decimals."""
    seconds, _, decimals = timestamp.removesuffix("Z").partition(".")
    return f"{seconds}.{decimals:0<7}"


def serving(served: Served) -> AbstractContextManager[Served]:
    """The server on a free port, until the block ends."""
    return on_loopback(served, Handler, "/piwebapi")
