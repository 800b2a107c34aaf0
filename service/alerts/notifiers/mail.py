"""Mail by SMTP, with STARTTLS or TLS."""

from __future__ import annotations

import smtplib
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from email.message import EmailMessage
from email.utils import formatdate
from pathlib import Path
from typing import Any, Self

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers.notifier import NotSent, revealed
from stemwatch.service.config.service_schema import NotifierTable

TIMEOUT_S = 20.0
_PORTS = {"starttls": 587, "tls": 465, "none": 25}


@dataclass(frozen=True, kw_only=True)
class MailNotifier:
    """Sends one mail for each message. ``security`` is ``starttls``, ``tls`` or ``none``.

    Certificates are checked against those that the system trusts (``SSL_CERT_FILE`` names others).
    A password never goes over a connection that is not encrypted.
    """

    host: str
    port: int | None
    security: str
    user: str | None
    secret: Secret
    sender: str
    to: tuple[str, ...]

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
        try:
            with self._connect() as server:
                if self.user is not None and password is not None:
                    server.login(self.user, password)
                refused = server.send_message(mail)
        except smtplib.SMTPAuthenticationError:
            raise NotSent(f"{self.host} refused the login of {self.user}") from None
        except (smtplib.SMTPException, OSError) as error:
            raise NotSent(f"{self.host}: {type(error).__name__}: {error}") from None
        if refused:
            raise NotSent(f"{self.host} took no mail for {', '.join(sorted(refused))}")

    def _connect(self) -> smtplib.SMTP:
        port = self.port or _PORTS[self.security]
        if self.security == "tls":
            context = ssl.create_default_context()
            return smtplib.SMTP_SSL(self.host, port, timeout=TIMEOUT_S, context=context)
        server = smtplib.SMTP(self.host, port, timeout=TIMEOUT_S)
        if self.security == "starttls":
            try:
                server.starttls(context=ssl.create_default_context())
            except BaseException:
                server.close()
                raise
        return server

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
