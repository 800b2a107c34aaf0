"""``Notifier``: the interface of every way to send a message."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.secret import Secret

if TYPE_CHECKING:
    from stemwatch.service.config.service_schema import NotifierTable


class NotSent(Exception):
    """The message did not arrive; the text says why, without secrets.

    ``final``: it never will, however often it is tried.
    """

    def __init__(self, reason: str, *, final: bool = False) -> None:
        super().__init__(reason)
        self.final = final


class Notifier(Protocol):
    """Sends messages.

    ``send`` returns when the receiver has taken the message and raises otherwise, at the latest
    after half a minute. The same ``key`` may come twice, after a crash between sending and
    recording it: it must reach the receiver in a form by which the second message can be
    recognised. ``message`` has ``subject``, ``text`` and ``alerts`` (see ``digest.message_of``),
    all of which comes from the plant and must be treated as plain text.
    """

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Bring ``message`` to its receiver; raises ``NotSent`` where it did not arrive."""
        ...


class NotifierKind(Protocol):
    """What an entry point of ``stemwatch.notifiers`` leads to: usually the notifier's class."""

    def from_table(self, table: NotifierTable, secret: Secret, folder: Path) -> Notifier:
        """The notifier that a ``[[notifiers]]`` of a plant file in ``folder`` describes. A kind of
        another package finds its own keys in ``table.options``."""
        ...


def revealed(secret: Secret) -> str | None:
    """The secret, or ``None`` where none is configured. It is read each time, so that a changed
    secret needs no restart. Raises ``NotSent`` where it cannot be read."""
    try:
        return secret.reveal() if secret else None
    except ConnectorError as error:
        raise NotSent(str(error)) from None


def why_not_connected(error: Exception) -> str:
    """What hindered a connection, and what to do where the encryption did."""
    if isinstance(error, ssl.SSLCertVerificationError):
        reason = error.verify_message.rstrip(".")
        return (
            f"its certificate is not trusted: certificate verify failed, {reason}. "
            "Give the server one for this name by an authority that this machine trusts, or name "
            "the file of trusted ones in SSL_CERT_FILE"
        )
    if isinstance(error, ssl.SSLError):
        return f"no encrypted connection came about on this port ({error.reason})"
    return f"{type(error).__name__}: {error}"
