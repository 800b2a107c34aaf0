"""Mail servers that hang, answer too slowly, refuse or disconnect, at each step of the protocol."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers import NotSent
from stemwatch.service.alerts.notifiers import mail as mail_module
from stemwatch.service.alerts.notifiers.mail import MailNotifier
from stemwatch.service.alerts.sender import Sender
from stemwatch.service.store.store import open_store
from tests.service.alerts.test_sender import Mailbox

MESSAGE = {"subject": "V1 sticks", "text": "V1 sticks", "alerts": []}
ANN, BEN = "ann@plant.example", "ben@plant.example"
Answer = Callable[[str], str | None]  # to a command; None hangs, "" closes


class Server:
    """Speaks as a mail server does, but where ``answer`` says otherwise; ``mails`` are the
    receivers of each mail that it took."""

    def __init__(self, answer: Answer) -> None:
        self.mails: list[list[str]] = []
        self.commands: list[str] = []
        self._answer = answer
        self.over = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def end(self) -> None:
        """Answer nobody any more."""
        self.over.set()
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join()

    def _serve(self) -> None:
        while True:
            try:
                link, _ = self._listening.accept()
            except OSError:
                return
            with link, suppress(OSError):
                self._talk(link)

    def _talk(self, link: socket.socket) -> None:
        receivers: list[str] = []
        if not self._say(link, "connect", "220 ready"):
            return
        lines = link.makefile("rb")
        while line := lines.readline().decode().strip():
            verb = line.split()[0].lower()
            self.commands.append(verb)
            if verb == "data":
                if not self._say(link, "data", "354 go on"):
                    return
                while lines.readline() not in (b".\r\n", b""):
                    pass
                self.mails.append(receivers)
                receivers, verb, line = [], "taken", "taken"
            known = "221 bye" if verb == "quit" else "250 fine"
            text = self._say(link, line if verb == "rcpt" else verb, known)
            if not text or verb == "quit":
                return
            if verb == "rcpt" and text.startswith("250"):
                receivers.append(line.partition("<")[2].rstrip(">"))

    def _say(self, link: socket.socket, to: str, usual: str) -> str:
        text = self._answer(to)
        text = usual if text == "as usual" else text
        if text is None:
            self.over.wait(60)
            return ""
        for byte in text.encode() if text.startswith("drop by drop") else b"":
            link.sendall(bytes([byte]))
            if self.over.wait(0.1):
                return ""
        if text:
            link.sendall(text.encode() + b"\r\n")
        return text


@contextmanager
def serving(answer: Answer) -> Iterator[Server]:
    server = Server(answer)
    try:
        yield server
    finally:
        server.end()


def at(step: str, text: str | None) -> Answer:
    """As usual, but at one step."""
    return lambda to: text if to.startswith(step) else "as usual"


def notifier(server: Server, *to: str, security: str = "none") -> MailNotifier:
    """Mail to ``to``."""
    return MailNotifier(
        host="127.0.0.1",
        port=server.port,
        security=security,
        user=None,
        secret=Secret(),
        sender="stemwatch@plant.example",
        to=to or (ANN,),
    )


@pytest.fixture
def in_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """A message has a second, an answer a minute."""
    monkeypatch.setattr(mail_module, "MESSAGE_S", 1.0)
    monkeypatch.setattr(mail_module, "TIMEOUT_S", 60.0)


@pytest.mark.parametrize("step", ["connect", "ehlo", "mail", "rcpt", "data", "taken"])
@pytest.mark.parametrize("text", [None, "drop by drop" * 60], ids=["silent", "drop by drop"])
def test_a_server_that_hangs_is_left_in_time(
    in_a_second: None, step: str, text: str | None
) -> None:
    """Silent with the connection open, or with a byte now and then: the message has its time, and
    is tried again."""
    started = time.monotonic()
    with serving(at(step, text)) as server:
        with pytest.raises(NotSent, match=r"127\.0\.0\.1") as caught:
            notifier(server).send("k", MESSAGE)
        assert not caught.value.final
    assert time.monotonic() - started < 40.0, "each answer may take a minute"


def test_a_server_that_hangs_before_it_is_encrypted_is_left_in_time(in_a_second: None) -> None:
    """One that takes the connection on the port for TLS, and says nothing."""
    started = time.monotonic()
    with serving(at("connect", None)) as server, pytest.raises(NotSent):
        notifier(server, security="tls").send("k", MESSAGE)
    assert time.monotonic() - started < 40.0


@pytest.mark.parametrize(
    ("step", "text"),
    [
        ("connect", "421 too busy"), ("connect", "554 not you"), ("connect", ""),
        ("mail", "451 later"), ("mail", ""), ("rcpt", "550 nobody"), ("rcpt", "421 closing"),
        ("data", "452 full"), ("data", ""), ("taken", "554 no spam"), ("taken", ""),
    ],
)  # fmt: skip
def test_what_a_server_refuses_is_tried_again(step: str, text: str) -> None:
    """At each step, in words or by breaking off; nothing hangs and nothing is taken for sent."""
    with serving(at(step, text)) as server, pytest.raises(NotSent, match=r"127\.0\.0\.1") as caught:
        notifier(server).send("k", MESSAGE)
    assert not caught.value.final


@pytest.mark.parametrize("text", ["421 closing", "500 what", "", None, "drop by drop" * 60])
def test_a_mail_that_was_taken_is_not_sent_again(
    monkeypatch: pytest.MonkeyPatch, text: str | None
) -> None:
    """Whatever the server answers to QUIT, the mail was accepted."""
    monkeypatch.setattr(mail_module, "MESSAGE_S", 4.0)
    with serving(at("quit", text)) as server:
        notifier(server).send("k", MESSAGE)
        assert server.mails == [[ANN]]


def test_only_who_was_refused_gets_the_mail_again() -> None:
    """A mailbox that is full for a while costs the other receivers no mail an hour."""
    full = True

    def answer(to: str) -> str:
        return "452 full" if full and to.startswith("rcpt") and BEN in to.lower() else "as usual"

    with serving(answer) as server:
        both = notifier(server, ANN, BEN)
        for _ in range(2):
            with pytest.raises(NotSent, match=rf"took no mail for {BEN} \(452 full\)"):
                both.send("k1", MESSAGE)
        full = False
        both.send("k1", MESSAGE)
        both.send("k2", MESSAGE)
    assert server.mails == [[ANN], [BEN], [ANN, BEN]]


def test_a_server_that_hangs_keeps_back_no_message_to_others(
    in_a_second: None, tmp_path: Path
) -> None:
    """Twenty messages wait for it: the others' are sent all the same, not twenty times its time
    later, and each of its own has its turn."""
    box = Mailbox()
    with (
        serving(at("connect", None)) as server,
        open_store(f"sqlite:///{tmp_path / 's.db'}") as store,
    ):
        sender = Sender(store, {"hung": notifier(server), "box": box})
        for number in range(20):
            store.deliveries.put({"hung": MESSAGE}, f"k{number}", [])
        store.deliveries.put({"box": MESSAGE}, "k", [])
        assert sender.send_due() == 1
        tried = [delivery for delivery in store.deliveries.recent() if delivery.attempts]
        assert sorted(item.notifier for item in tried) == ["box", "hung"]
        sender.send_due()
        assert sum(delivery.attempts for delivery in store.deliveries.recent()) == 3
