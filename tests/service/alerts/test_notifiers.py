"""Mail, webhook and file, each against a real receiver on this machine, and what is never said."""

from __future__ import annotations

import hashlib
import hmac
import json
import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from email import message_from_bytes
from email.policy import default
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import AuthResult

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers import Notifier, NotSent, notifiers_of
from stemwatch.service.config import load_plant

SECRET = "hoechst-geheim"
HOSTILE = {
    "subject": "V1: sticks\r\nBcc: everybody@example.org",
    "text": "Äußerst <script>alert(1)</script> & more\n.\nend",
    "alerts": [{"id": 1, "valve": "V1\n"}],
}


class Receiver:
    """Takes whatever comes and remembers it; ``refusing`` answers with a failure."""

    def __init__(self) -> None:
        self.got: list[tuple[dict[str, str], bytes]] = []
        self.refusing = False

    async def handle_DATA(self, server, session, envelope) -> str:
        if self.refusing:
            return "451 come again later"
        self.got.append(({}, envelope.content))
        return "250 taken"


class PatientController(Controller):
    """A controller that tries its own port without the encryption, whose certificate nobody trusts
    yet."""

    def _trigger_server(self) -> None:
        socket.create_connection((self.hostname, self.port), 5.0).close()


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture
def mailbox() -> Iterator[tuple[Receiver, int]]:
    """A mail server and its port."""
    receiver = Receiver()
    server = Controller(receiver, hostname="127.0.0.1", port=free_port())
    server.start()
    try:
        yield receiver, server.port
    finally:
        server.stop()


@pytest.fixture
def hook() -> Iterator[tuple[Receiver, int]]:
    """A web server that takes POSTs, and its port."""
    receiver = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            receiver.got.append((dict(self.headers), body))
            self.send_response(503 if receiver.refusing else 204)
            self.send_header("Location", "http://127.0.0.1:1/")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield receiver, server.server_port
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


Make = Callable[[str], Notifier]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """The notifier of a plant file with these keys."""

    def make(keys: str) -> Notifier:
        file = tmp_path / "plant.toml"
        file.write_text(f'[[notifiers]]\nname = "n"\n{keys}\n', encoding="utf-8")
        plant = load_plant(file, environment={})
        assert plant.problems == ()
        return notifiers_of(plant)["n"]

    return make


def mail(port: int, more: str = 'security = "none"') -> str:
    return (
        f'kind = "mail"\nhost = "127.0.0.1"\nport = {port}\nsender = "stemwatch@plant.example"\n'
        f'to = ["shift@plant.example", "ann@plant.example"]\n{more}'
    )


def test_a_mail_arrives_as_text(make: Make, mailbox) -> None:
    """Subject and text arrive whole; a line break in a tag makes no header; the id is the key's."""
    receiver, port = mailbox
    make(mail(port)).send("alerts-1-3", HOSTILE)
    message = message_from_bytes(receiver.got[0][1], policy=default)
    assert message["Subject"] == "V1: sticks Bcc: everybody@example.org"
    assert message["Bcc"] is None
    assert message["To"] == "shift@plant.example, ann@plant.example"
    assert message["Message-ID"] == "<alerts-1-3@plant.example>"
    assert "<script>" in message.get_content()
    assert "end" in message.get_content()


def test_a_webhook_is_signed(make: Make, hook, monkeypatch) -> None:
    """The body is JSON; its signature is that of the secret, which itself is not sent."""
    receiver, port = hook
    monkeypatch.setenv("HOOK", SECRET)
    url = f'kind = "webhook"\nurl = "http://127.0.0.1:{port}/in?x=1"\nallow_private = true\n'
    make(url + 'secret_variable = "HOOK"').send("k1", HOSTILE)
    ((headers, body),) = receiver.got
    assert json.loads(body) == {"key": "k1", **HOSTILE}
    expected = hmac.new(SECRET.encode(), body, hashlib.sha256).hexdigest()
    assert headers["X-Stemwatch-Signature"] == f"sha256={expected}"
    assert headers["Idempotency-Key"] == "k1"
    assert SECRET not in f"{headers}{body!r}"


def test_a_file_gets_a_line(make: Make, tmp_path: Path) -> None:
    """Each message is one line of JSON, whatever is in it."""
    notifier = make('kind = "file"\npath = "out/alerts.jsonl"')
    notifier.send("a", HOSTILE)
    notifier.send("b", HOSTILE)
    lines = (tmp_path / "out" / "alerts.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["key"] for line in lines] == ["a", "b"]


def test_a_line_that_was_cut_costs_no_other_message(make: Make, tmp_path: Path) -> None:
    """A kill or a full disk may leave half a line; the message after it stands on its own."""
    notifier = make('kind = "file"\npath = "alerts.jsonl"')
    file = tmp_path / "alerts.jsonl"
    file.write_text('{"key": "k0"}\n{"key": "k1", "subj', encoding="utf-8")
    notifier.send("k1", HOSTILE)
    whole, cut, again = file.read_text(encoding="utf-8").splitlines()
    assert json.loads(whole)["key"] == "k0"
    assert cut.endswith("subj")
    assert json.loads(again)["key"] == "k1"


def test_what_is_refused_was_not_sent(make: Make, mailbox, hook, tmp_path: Path) -> None:
    """The contract of every notifier: a receiver that does not take the message is an error that
    says who, so that it is tried again."""
    for receiver, _ in (mailbox, hook):
        receiver.refusing = True
    url = f'kind = "webhook"\nurl = "http://127.0.0.1:{hook[1]}/"\nallow_private = true'
    (tmp_path / "folder").mkdir()
    for keys in (mail(mailbox[1]), url, 'kind = "file"\npath = "folder"'):
        with pytest.raises(NotSent, match=r"127\.0\.0\.1|folder") as caught:
            make(keys).send("k", HOSTILE)
        assert not caught.value.final


def test_a_password_needs_encryption_and_is_never_said(make: Make, monkeypatch) -> None:
    """The login goes over an encrypted connection or not at all, and no error shows the secret."""

    def check(server, session, envelope, mechanism, data) -> AuthResult:
        return AuthResult(success=False)

    port = free_port()
    server = Controller(
        Receiver(), hostname="127.0.0.1", port=port, authenticator=check, auth_require_tls=False
    )
    server.start()
    try:
        monkeypatch.setenv("MAIL", SECRET)
        login = 'user = "u"\nsecret_variable = "MAIL"\n'
        for security, text in (("none", "without encryption"), ("starttls", "127.0.0.1")):
            notifier = make(mail(port, f'{login}security = "{security}"'))
            with pytest.raises(NotSent, match=text) as caught:
                notifier.send("k", HOSTILE)
            assert SECRET not in f"{caught.value}{notifier!r}"
    finally:
        server.stop()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl to make a certificate")
@pytest.mark.parametrize("security", ["starttls", "tls"])
def test_it_logs_in_encrypted_and_checks_the_certificate(
    make: Make, monkeypatch, tmp_path: Path, security: str
) -> None:
    """With a certificate that the system trusts the mail arrives after a login; without it, no
    password leaves this machine. A wrong password is said without being told."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    certificate = made_certificate(tmp_path, context)
    seen: list[bytes] = []

    def check(server, session, envelope, mechanism, data) -> AuthResult:
        seen.append(data.password)
        return AuthResult(success=data.password == SECRET.encode(), handled=False)

    receiver, port = Receiver(), free_port()
    server = PatientController(
        receiver,
        hostname="127.0.0.1",
        port=port,
        authenticator=check,
        # The server itself knows of encryption only where it began inside the conversation.
        auth_require_tls=security == "starttls",
        **{"tls_context" if security == "starttls" else "ssl_context": context},
    )
    monkeypatch.setenv("MAIL", SECRET)
    login = f'user = "u"\nsecret_variable = "MAIL"\nsecurity = "{security}"'
    notifier = make(mail(port, login))
    server.start()
    try:
        with pytest.raises(NotSent, match=r"certificate verify failed.*SSL_CERT_FILE"):
            notifier.send("k", HOSTILE)
        assert seen == []
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        notifier.send("k", HOSTILE)
        monkeypatch.setenv("MAIL", "a-wrong-one")
        with pytest.raises(NotSent, match="refused the login of u") as caught:
            notifier.send("k", HOSTILE)
        assert "a-wrong-one" not in str(caught.value)
    finally:
        server.stop()
    ((_, content),) = receiver.got
    assert message_from_bytes(content, policy=default)["Message-ID"] == "<k@plant.example>"


def made_certificate(folder: Path, context: ssl.SSLContext) -> Path:
    """A certificate of its own making for 127.0.0.1, which ``context`` then shows."""
    certificate, key = folder / "cert.pem", folder / "key.pem"
    names = ["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"]
    files = ["-keyout", str(key), "-out", str(certificate)]
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    subprocess.run([*command, *files, *names], check=True, capture_output=True)
    context.load_cert_chain(certificate, key)
    return certificate


def test_a_server_without_encryption_gets_neither_mail_nor_password(make: Make, mailbox) -> None:
    """Somebody who takes STARTTLS out of the conversation gains nothing."""
    receiver, port = mailbox
    with pytest.raises(NotSent, match=r"STARTTLS extension not supported.*security and port"):
        make(mail(port, 'security = "starttls"')).send("k", HOSTILE)
    assert receiver.got == []


def test_a_secret_that_is_not_there_is_named(make: Make, monkeypatch, tmp_path: Path) -> None:
    """Which variable or file is meant is said; a file's line end is no part of the secret."""
    monkeypatch.delenv("NOWHERE", raising=False)
    url = 'kind = "webhook"\nurl = "https://example.org/"\n'
    with pytest.raises(NotSent, match="variable NOWHERE is not set"):
        make(url + 'secret_variable = "NOWHERE"').send("k", HOSTILE)
    with pytest.raises(NotSent, match=r"no-such-file cannot be read"):
        make(url + 'secret_file = "no-such-file"').send("k", HOSTILE)

    file = tmp_path / "secret"
    file.write_text(SECRET + "\n", encoding="utf-8")
    assert Secret(file=str(file)).reveal() == SECRET
