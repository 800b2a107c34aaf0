"""Mail by SMTP, with STARTTLS or TLS."""

from __future__ import annotations

import contextlib
import smtplib
import socket
import ssl
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from email.message import EmailMessage
from email.utils import formatdate
from pathlib import Path
from typing import Any, Self

from stemwatch.connectors.connection_deadline import close_after
from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers.notifier import NotSent, revealed, why_not_connected
from stemwatch.service.config.service_schema import NotifierTable

TIMEOUT_S = 20.0  # for each answer
MESSAGE_S = 28.0  # for all of a message
_Refused = Mapping[str, tuple[int, bytes]]  # receivers, and what the server answered to each
_PORTS = {"starttls": 587, "tls": 465, "none": 25}


class _Server(smtplib.SMTP):
    """An SMTP connection that can be closed from the first moment on, through ``link``: a second
    handle of its socket, which TLS leaves unchanged."""

    def __init__(self, *, encrypted: bool) -> None:
        super().__init__(timeout=TIMEOUT_S)
        self.link: socket.socket | None = None
        self._encrypted = encrypted

    def call(self, host: str, port: int) -> None:
        """Connect. Raises ``SMTPConnectError`` where the server refuses the connection."""
        self._host = host  # whose name the certificate must have
        code, reply = self.connect(host, port)
        if code != 220:
            raise smtplib.SMTPConnectError(code, reply)

    def _get_socket(self, host: str, port: int, timeout: float) -> socket.socket:
        plain_socket = socket.create_connection((host, port), timeout)
        self.link = plain_socket.dup()
        if not self._encrypted:
            return plain_socket
        return ssl.create_default_context().wrap_socket(plain_socket, server_hostname=host)

    def close(self) -> None:
        """Close the connection without QUIT."""
        super().close()
        if self.link is not None:
            self.link.close()


@dataclass(frozen=True, kw_only=True)
class MailNotifier:
    """Sends one mail for each message. ``security`` is ``starttls``, ``tls`` or ``none``.

    Certificates are checked against those that the system trusts (``SSL_CERT_FILE`` names others).
    A password never goes over a connection that is not encrypted. Where the server refuses some of
    the receivers, only these are tried again.
    """

    host: str
    port: int | None
    security: str
    user: str | None
    secret: Secret
    sender: str
    to: tuple[str, ...]
    _taken: dict[str, set[str]] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def from_table(cls, table: NotifierTable, secret: Secret, folder: Path) -> Self:
        """Host, sender and receivers of the table."""
        return cls(
            host=table.host or "",
            port=table.port,
            security=table.security,
            user=table.user,
            secret=secret,
            sender=table.sender or "",
            to=tuple(table.to),
        )

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Send the mail. Its ``Message-ID`` is made of ``key``, the same for each attempt."""
        password = revealed(self.secret)
        if password is not None and self.security == "none":
            raise NotSent("a password is not sent without encryption; use starttls or tls")
        mail = self._mail(key, message)
        accepted_by = self._taken.setdefault(key, set())
        receivers = [receiver for receiver in self.to if receiver not in accepted_by]
        server = _Server(encrypted=self.security == "tls")
        try:
            with close_after(MESSAGE_S, lambda: server.link):
                refused = self._say_to(server, password, mail, receivers)
        except smtplib.SMTPAuthenticationError:
            raise NotSent(f"{self.host} refused the login of {self.user}") from None
        except smtplib.SMTPRecipientsRefused as error:  # it took the mail for nobody
            refused = error.recipients
        except smtplib.SMTPNotSupportedError as error:
            raise NotSent(
                f"{self.host}: {error} The keys security and port of the plant file must suit the "
                'server: "starttls" mostly port 587, "tls" 465'
            ) from None
        except (smtplib.SMTPException, OSError) as error:
            raise NotSent(f"{self.host}: {why_not_connected(error)}") from None
        if refused:
            accepted_by.update(set(receivers) - refused.keys())
            raise NotSent(f"{self.host} took no mail for {_with_answers(refused)}")
        del self._taken[key]

    def _say_to(
        self, server: _Server, password: str | None, mail: EmailMessage, receivers: Sequence[str]
    ) -> _Refused:
        """Connect, log in and hand over the mail; returns the receivers that the server refused."""
        try:
            server.call(self.host, self.port or _PORTS[self.security])
            if self.security == "starttls":
                server.starttls(context=ssl.create_default_context())
            if self.user is not None and password is not None:
                server.login(self.user, password)
            refused: _Refused = server.send_message(mail, to_addrs=receivers)
            with contextlib.suppress(smtplib.SMTPException, OSError):
                server.quit()  # the mail was accepted, whatever the answer to QUIT
            return refused
        finally:
            server.close()

    def _mail(self, key: str, message: Mapping[str, Any]) -> EmailMessage:
        mail = EmailMessage()
        # A line break in a header would begin another header.
        mail["Subject"] = " ".join(str(message["subject"]).split())
        mail["From"], mail["To"] = self.sender, ", ".join(self.to)
        mail["Date"] = formatdate(localtime=False)
        domain = self.sender.rpartition("@")[2] or "stemwatch"
        mail["Message-ID"] = f"<{key}@{domain}>"
        mail["Auto-Submitted"] = "auto-generated"
        mail.set_content(str(message["text"]))
        return mail


def _with_answers(refused: _Refused) -> str:
    """Each receiver with the server's answer, which tells a wrong address from a full mailbox."""
    return ", ".join(
        f"{receiver} ({code} {answer.decode(errors='replace')})"
        for receiver, (code, answer) in sorted(refused.items())
    )
