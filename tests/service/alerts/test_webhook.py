"""Webhooks: where they may go, by whatever name, and what a hostile receiver can do to them."""

from __future__ import annotations

import hashlib
import hmac
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers import NotSent, webhook
from stemwatch.service.alerts.notifiers import webhook as outside
from stemwatch.service.alerts.notifiers.webhook import WebhookNotifier, is_public
from stemwatch.service.alerts.sender import Sender
from stemwatch.service.store.store import Store, open_store

SECRET = "hoechst-geheim"
MESSAGE = {"subject": "V1 sticks", "text": "V1 sticks", "alerts": []}
TAKEN = b"HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n"


def to(url: str, *, allow_private: bool = False) -> WebhookNotifier:
    """A webhook to ``url`` with a secret."""
    return WebhookNotifier(url=url, secret=Secret(variable="HOOK"), allow_private=allow_private)


@pytest.fixture(autouse=True)
def _secret(monkeypatch) -> None:
    monkeypatch.setenv("HOOK", SECRET)


@contextmanager
def receiver(
    answer: Callable[[socket.socket], None],
    wrap: Callable[[socket.socket], socket.socket] | None = None,
) -> Iterator[tuple[int, list[bytes]]]:
    """A server on loopback that reads one request and gives it to ``answer``; its port and what
    came."""
    got: list[bytes] = []
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                link, _ = listening.accept()
            except OSError:
                return
            try:
                link.settimeout(10)
                link = wrap(link) if wrap else link
                got.append(whole(link))
                answer(link)
            except OSError:
                pass
            finally:
                link.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield listening.getsockname()[1], got
    finally:
        listening.shutdown(socket.SHUT_RDWR)
        listening.close()
        thread.join()


def whole(link: socket.socket) -> bytes:
    """A request with all of its body, which may come in several pieces."""
    data = link.recv(65536)
    while True:
        head, _, body = data.partition(b"\r\n\r\n")
        length = [line.split(b":")[1] for line in head.split(b"\r\n") if b"Content-Length" in line]
        if length and len(body) >= int(length[0]):
            return data
        more = link.recv(65536)
        if not more:
            return data
        data += more


def named(monkeypatch, *answers: list[str]) -> list[str]:
    """Makes the name ``hook.example`` lead to each of ``answers`` in turn; the names asked for."""
    real, requested, left = socket.getaddrinfo, [], list(answers)

    def look_up(host, port, *rest, **more):
        if host != "hook.example":
            return real(host, port, *rest, **more)
        requested.append(host)
        results = left.pop(0) if len(left) > 1 else left[0]
        return [item for address in results for item in real(address, port, *rest, **more)]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    return requested


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1", "localhost", "2130706433", "0x7f.1", "0.0.0.0", "10.0.0.1", "172.16.0.1",
        "192.168.1.1", "169.254.169.254", "100.64.0.1", "224.0.0.1", "255.255.255.255",
        "[::1]", "[::]", "[fe80::1]", "[fc00::1]", "[ff02::1]", "[::ffff:127.0.0.1]",
        "[::ffff:a00:1]", "[::127.0.0.1]", "[64:ff9b::7f00:1]", "[64:ff9b::10.0.0.1]",
        "[fec0::1]", "[2002:7f00:1::]", "[2002:a00:1::]", "[2001:0:7f00:1::]",
    ],
)  # fmt: skip
def test_addresses_that_are_not_public_are_refused(host: str) -> None:
    """However they are written, and where an IPv6 address leads to one of them."""
    with pytest.raises(NotSent, match="allow_private = true") as caught:
        to(f"http://{host}:9/").send("k", MESSAGE)
    assert caught.value.final


@pytest.mark.parametrize(
    "address", ["8.8.8.8", "2606:4700::1111", "64:ff9b::808:808", "2002:808:808::"]
)
def test_public_addresses_are_not_refused(address: str) -> None:
    """What the internet reaches, also by way of a translator."""
    assert is_public(address)


@pytest.mark.parametrize(
    "answers", [["10.0.0.1"], ["8.8.8.8", "127.0.0.1"], ["2606:4700::1111", "fe80::1"]]
)
def test_a_name_that_leads_inside_is_refused(monkeypatch, answers: list[str]) -> None:
    """One address among several is enough: it could be the one that is taken next."""
    named(monkeypatch, answers)
    with pytest.raises(NotSent, match="allow_private = true"):
        to("http://hook.example/").send("k", MESSAGE)


def test_the_connection_goes_to_what_was_looked_at(monkeypatch) -> None:
    """A name that is public when it is checked and private when it is used is asked for once: the
    connection goes to the address of the first answer, here one that this test calls public."""
    with receiver(lambda link: link.sendall(TAKEN)) as (port, got):
        selection = named(monkeypatch, ["127.0.0.1"], ["10.255.255.1"])
        monkeypatch.setattr(outside, "is_public", lambda address: address == "127.0.0.1")
        to(f"http://hook.example:{port}/").send("k", MESSAGE)
    assert selection == ["hook.example"]
    assert f"Host: hook.example:{port}".encode() in got[0]


def test_an_address_that_does_not_answer_is_passed_over(monkeypatch) -> None:
    """Of several addresses the first that takes a connection gets the message."""
    with receiver(lambda link: link.sendall(TAKEN)) as (port, got):
        named(monkeypatch, ["::1", "127.0.0.1"])
        to(f"http://hook.example:{port}/", allow_private=True).send("k", MESSAGE)
    assert len(got) == 1


@pytest.mark.parametrize("status", [301, 302, 307, 308])
def test_a_redirection_is_not_followed(status: int) -> None:
    """Neither to this machine nor anywhere: the message counts as not taken and is tried again."""

    def answer(link: socket.socket) -> None:
        where = f"Location: http://127.0.0.1:{link.getsockname()[1]}/inside"
        link.sendall(f"HTTP/1.1 {status} Elsewhere\r\n{where}\r\n\r\n".encode())

    with receiver(answer) as (port, got):
        with pytest.raises(NotSent, match=f"status {status}") as caught:
            to(f"http://127.0.0.1:{port}/", allow_private=True).send("k", MESSAGE)
        assert not caught.value.final
    assert len(got) == 1


def test_a_receiver_that_dribbles_is_left(monkeypatch) -> None:
    """An answer that comes byte by byte ends with the time for one message, not with the line."""
    monkeypatch.setattr(webhook, "TIMEOUT_S", 1.0)
    stop = threading.Event()

    def answer(link: socket.socket) -> None:
        for byte in b"HTTP/1.1 " + b"2" * 600:
            link.sendall(bytes([byte]))
            if stop.wait(0.1):
                return

    with receiver(answer) as (port, _):
        started = time.monotonic()
        with pytest.raises(NotSent):
            to(f"http://127.0.0.1:{port}/", allow_private=True).send("k", MESSAGE)
        stop.set()
    assert time.monotonic() - started < 30.0, "the dribble lasts for a minute"


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for 127.0.0.1 that nobody trusts yet, and its key."""
    created, key = folder / "cert.pem", folder / "key.pem"
    names = ["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"]
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    files = ["-keyout", str(key), "-out", str(created)]
    subprocess.run([*command, *files, *names], check=True, capture_output=True)
    return created, key


def test_over_tls_the_certificate_is_checked(monkeypatch, tmp_path: Path) -> None:
    """Nothing is said to a receiver that cannot prove who it is; the body's signature is right."""
    created, key = certificate(tmp_path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(created, key)

    def wrap(link: socket.socket) -> socket.socket:
        return context.wrap_socket(link, server_side=True)

    with receiver(lambda link: link.sendall(TAKEN), wrap) as (port, got):
        notifier = to(f"https://127.0.0.1:{port}/in", allow_private=True)
        with pytest.raises(NotSent, match="certificate verify failed"):
            notifier.send("k", MESSAGE)
        assert got == []
        monkeypatch.setenv("SSL_CERT_FILE", str(created))
        notifier.send("k", MESSAGE)
    head, _, body = got[0].partition(b"\r\n\r\n")
    signed = hmac.new(SECRET.encode(), body, hashlib.sha256).hexdigest()
    assert f"X-Stemwatch-Signature: sha256={signed}".encode() in head
    assert SECRET.encode() not in got[0]


def test_it_is_tried_again_and_no_log_has_a_secret(tmp_path: Path, caplog) -> None:
    """Refused once it waits; taken the second time, under the same key; neither the secret nor
    what stands in the address is written down."""
    answers = [b"HTTP/1.1 503 Busy\r\nConnection: close\r\n\r\n", TAKEN]
    caplog.set_level("INFO")
    url = f"sqlite:///{tmp_path / 's.db'}"
    with (
        receiver(lambda link: link.sendall(answers.pop(0))) as (port, got),
        open_store(url) as store,
    ):
        address = f"http://u:in-the-user@127.0.0.1:{port}/in-the-path?token=in-the-query"
        sender = Sender(store, {"hook": to(address, allow_private=True)})
        store.deliveries.put({"hook": MESSAGE}, "alerts-1", [])
        assert sender.send_due() == 0
        (waiting,) = store.deliveries.recent()
        assert waiting.sent is None
        assert waiting.next_try > datetime.now(UTC) + timedelta(seconds=30)
        make_due(store, waiting.id)
        assert sender.send_due() == 1
        assert sender.send_due() == 0
        text = caplog.text + waiting.error + store.deliveries.recent()[0].error
    assert len(got) == 2
    assert all(b"Idempotency-Key: alerts-1" in item for item in got)
    for secret in (SECRET, "in-the-user", "in-the-path", "in-the-query"):
        assert secret not in text


def make_due(store: Store, delivery: int) -> None:
    """As if the wait were over."""
    store.deliveries.failed(delivery, "later", datetime.now(UTC) - timedelta(seconds=1))
