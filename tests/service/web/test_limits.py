"""Limits on memory, time and log lines that unknown clients can cause."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from stemwatch.service.logs import OnceAMinute
from stemwatch.service.serve import http_server
from stemwatch.service.serve.http_server import connection_limit
from stemwatch.service.web.middleware import LARGEST_BODY, SecurityMiddleware, _unsafe_refusal
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import serving, serving_app

PATIENCE_S = 30.0
FORM = "Host: 127.0.0.1\r\nContent-Type: application/x-www-form-urlencoded\r\n"
CHUNK = b"10000\r\n" + b"a" * 0x10000 + b"\r\n"


@pytest.fixture
def address(live: Site) -> Iterator[tuple[str, int]]:
    """Where the pages of the small plant are served."""
    with serving(live, fresh=True) as base:
        yield place_of(base)


def place_of(base: str) -> tuple[str, int]:
    parts = urlsplit(base)
    return str(parts.hostname), int(parts.port or 0)


@contextmanager
def talking(address: tuple[str, int], text: str) -> Iterator[socket.socket]:
    """A connection on which ``text`` was sent."""
    with socket.create_connection(address, timeout=PATIENCE_S) as link:
        link.sendall(text.encode())
        yield link


def status_of(link: socket.socket) -> int:
    """The status that is answered; 0 where the connection is closed without one."""
    try:
        with link.makefile("rb") as answer:
            return int((answer.readline().split() or [b"", b"0"])[1])
    except ConnectionError:
        return 0


def closed(link: socket.socket) -> bool:
    """Whether the other side closes the connection, whatever it says before."""
    try:
        while link.recv(65536):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


def test_a_body_whose_length_is_given_twice_is_refused_before_it_is_read(address) -> None:
    """Content-Length and Transfer-Encoding together are what hides a long body from a limit."""
    head = f"POST /login HTTP/1.1\r\n{FORM}Content-Length: 10\r\nTransfer-Encoding: chunked\r\n\r\n"
    with talking(address, head) as link:
        link.sendall(CHUNK)
        text = ""
        while "twice" not in text and (result := link.recv(4096)):
            text += result.decode()
    assert text.startswith("HTTP/1.1 400 ")
    assert "gives the length of its body twice" in text


@pytest.mark.parametrize("method", ["GET", "HEAD", "POST"])
def test_a_body_of_unknown_length_is_refused_by_every_method(address, method) -> None:
    """Also where no body is expected: nothing is read of it."""
    head = f"{method} /login HTTP/1.1\r\n{FORM}Transfer-Encoding: chunked\r\n\r\n"
    with talking(address, head) as link:
        assert status_of(link) == 411


def test_bytes_are_counted_as_they_come_whatever_the_headers_say() -> None:
    """Behind a server that lets a body through that is longer than announced, reading ends at the
    limit."""
    taken = 0

    class LetsAllIn:
        async def admit(self, scope: Any) -> None:
            return None

        async def note(self, scope: Any, status: int) -> None:
            return None

    async def receive() -> dict[str, Any]:
        nonlocal taken
        taken += 1000
        return {"type": "http.request", "body": b"a" * 1000, "more_body": True}

    sent: list[dict[str, Any]] = []

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    async def read_all(request: Request) -> Response:
        return Response(await request.body())

    authentication: Any = LetsAllIn()
    inner = Starlette(routes=[Route("/login", read_all, methods=["POST"])])
    app = SecurityMiddleware(
        inner, hosts=("*",), authentication=authentication, failed=lambda _: Response("failed", 500)
    )
    headers = [(b"host", b"x"), (b"content-length", b"10")]
    scope = {"type": "http", "method": "POST", "path": "/login", "headers": headers}
    asyncio.run(app({**scope, "query_string": b""}, receive, send))
    assert sent[0]["status"] == 413
    assert LARGEST_BODY < taken <= LARGEST_BODY + 1000


@pytest.mark.parametrize(
    ("length", "status"), [("²", 411), ("", 411), ("-1", 411), ("9" * 5000, 413), ("70000", 413)]
)
def test_a_length_that_is_no_number_of_bytes_is_refused_and_no_fault_of_the_service(
    length: str, status: int
) -> None:
    """A superscript is a digit to Python and no number; thousands of digits are not read at all."""
    refusal = _unsafe_refusal(Headers({"host": "x", "content-length": length}))
    assert refusal is not None
    assert refusal.status_code == status


def test_half_a_header_is_waited_for_only_so_long(address, monkeypatch) -> None:
    """A letter now and then sets no new deadline; the answer says why the connection ends."""
    monkeypatch.setattr(http_server, "HEADER_S", 0.5)
    with talking(address, "GET / HTTP/1.1\r\nHost: 127") as link:
        started = time.monotonic()
        link.settimeout(0.1)
        result = b""
        while not result and time.monotonic() - started < PATIENCE_S:
            try:
                result = link.recv(100)
            except TimeoutError:
                link.sendall(b".")
        assert result.startswith(b"HTTP/1.1 408 ")


def test_nothing_at_all_is_waited_for_only_so_long(address, monkeypatch) -> None:
    """So is a second request on a connection that has had its answer."""
    monkeypatch.setattr(http_server, "HEADER_S", 0.3)
    with talking(address, "") as link:
        assert status_of(link) == 408
    with talking(address, "GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET /") as link:
        assert closed(link)


def test_half_a_body_is_waited_for_only_so_long(address, monkeypatch, caplog) -> None:
    """Also where nobody is signed in; it leaves no trace of an error in the log."""
    monkeypatch.setattr(http_server, "BODY_S", 0.3)
    head = f"POST /login HTTP/1.1\r\n{FORM}Content-Length: 1000\r\n\r\nmark="
    with caplog.at_level(logging.INFO), talking(address, head) as link:
        assert closed(link)
    assert "Traceback" not in caplog.text
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


async def _long_answer(scope: Any, receive: Any, send: Any) -> None:
    """64 MiB in pieces."""
    await send({"type": "http.response.start", "status": 200, "headers": []})
    for _ in range(64):
        await send({"type": "http.response.body", "body": b"a" * 2**20, "more_body": True})
    await send({"type": "http.response.body", "body": b""})


def test_an_answer_waits_only_so_long_for_its_reader(monkeypatch) -> None:
    """A client that reads nothing of an answer is disconnected."""
    monkeypatch.setattr(http_server, "ANSWER_S", 0.3)
    with (
        serving_app(_long_answer, fresh=True) as base,
        talking(place_of(base), "GET / HTTP/1.1\r\nHost: x\r\n\r\n") as link,
    ):
        time.sleep(2.0)
        got = 0
        try:
            while result := link.recv(2**20):
                got += len(result)
        except ConnectionError:
            pass
        assert got < 64 * 2**20


def test_a_slow_reader_gets_all_of_an_answer(monkeypatch) -> None:
    """A client that keeps reading gets all of an answer, however long it takes."""
    monkeypatch.setattr(http_server, "ANSWER_S", 1.5)
    with (
        serving_app(_long_answer, fresh=True) as base,
        httpx.stream("GET", base, trust_env=False, timeout=PATIENCE_S) as answer,
    ):
        started, got = time.monotonic(), 0
        for piece in answer.iter_raw(2**20):
            got += len(piece)
            time.sleep(0.04)
        assert time.monotonic() - started > 2.0
        assert got == 64 * 2**20


def test_pages_are_answered_however_many_wait_with_half_a_header(live, monkeypatch, caplog) -> None:
    """Whoever asks something takes the place of whoever has waited longest with nothing; the log
    gets one line of it."""
    monkeypatch.setattr(http_server, "MOST_CONNECTIONS", 16)
    with caplog.at_level(logging.INFO), serving(live, fresh=True) as base, ExitStack() as stack:
        address = place_of(base)
        idle = []
        for _ in range(100):
            idle.append(stack.enter_context(talking(address, "GET / HTTP/1.1\r\nX:")))
            time.sleep(0.002)  # the server's turn: what overruns it the kernel tries again later
        for _ in range(20):
            with talking(address, "GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n") as asking:
                assert status_of(asking) == 200
        for link in idle[:80]:
            assert status_of(link) in (503, 0)
        sentences = [
            message for message in caplog.messages if "the most that pages may have" in message
        ]
        assert len(sentences) <= 2  # the filter belongs to the process, and a minute may end here


def test_where_all_connections_are_worked_on_one_more_is_refused(monkeypatch) -> None:
    """What is being answered is never cut off for somebody new."""
    monkeypatch.setattr(http_server, "MOST_CONNECTIONS", 8)
    answer_now = asyncio.Event()

    async def slow(scope: Any, receive: Any, send: Any) -> None:
        if scope["path"] != "/now":
            await answer_now.wait()
        answer_now.set()
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    asks = "GET {} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
    with serving_app(slow, fresh=True) as base, ExitStack() as stack:
        address = place_of(base)
        links = [stack.enter_context(talking(address, asks.format("/"))) for _ in range(7)]
        time.sleep(0.5)
        eighth = stack.enter_context(talking(address, ""))
        ninth = stack.enter_context(talking(address, asks.format("/now")))
        assert status_of(eighth) == 503
        assert status_of(ninth) == 204
        assert [status_of(link) for link in links] == [204] * 7


def test_connections_take_a_quarter_of_the_descriptors(monkeypatch) -> None:
    """As many again may be on their way; the other half is for collection and runs."""
    resource = pytest.importorskip("resource")
    for soft, expected in ((1024, 256), (256, 64), (65536, 256), (resource.RLIM_INFINITY, 256)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, soft=soft: (soft, soft))
        assert connection_limit() == expected


def test_a_line_that_strangers_can_cause_is_said_rarely_and_counted() -> None:
    """Once in a while, with how often it came; other lines are not held back by it."""
    now = [0.0]
    filter_ = OnceAMinute(clock=lambda: now[0])

    def record(text: str, *values: object) -> logging.LogRecord:
        return logging.LogRecord("x", logging.WARNING, "x.py", 1, text, values, None)

    assert filter_.filter(record("%d open", 1))
    assert not any(filter_.filter(record("%d open", item)) for item in range(5))
    assert filter_.filter(record("something else"))
    now[0] = 61.0
    last = record("%d open", 9)
    assert filter_.filter(last)
    assert last.getMessage() == "9 open (5 times more since it was last said)"
