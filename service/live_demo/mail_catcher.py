"""``MailCatcher``: a local mail server that stores mails in files and forwards none."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from email import message_from_bytes, policy
from email.message import EmailMessage
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aiosmtpd.smtp import SMTP

LIST = "index.html"
TEMPLATE = "mails.html"
EXTRA = (
    "the live demo catches mails with the package aiosmtpd, which is not installed; "
    "install it with `pip install 'stemwatch[live-demo]'`"
)
LARGEST = 1 << 20
_SHOWN = 100  # the newest mails that the list shows


@dataclass(frozen=True, kw_only=True)
class CaughtMail:
    """A mail that arrived, and the file it is stored in."""

    at: datetime
    file: str
    sender: str
    to: str
    subject: str
    text: str


class MailCatcherMissing(OSError):
    """The package aiosmtpd is not installed; the text says how to install it."""


class MailCatcher:
    """Receives mails by SMTP on loopback, stores each as ``0001.eml`` and so on in ``folder``, and
    lists them in ``index.html`` there, newest first.

    Use it with ``async with``; with ``port`` 0 it takes a free one and sets ``port``. ``on_mail``
    is called with each mail. Mails of more than 1 MiB are refused. Raises ``MailCatcherMissing``
    where the extra ``live-demo`` is not installed.
    """

    def __init__(
        self,
        folder: Path,
        port: int = 0,
        on_mail: Callable[[CaughtMail], object] = lambda mail: None,
    ) -> None:
        self.folder, self.port = folder, port
        self.caught: list[CaughtMail] = []
        self._told = on_mail
        self._server: asyncio.Server | None = None

    @property
    def list_file(self) -> Path:
        """The page that lists the mails."""
        return self.folder / LIST

    async def __aenter__(self) -> MailCatcher:
        if find_spec("aiosmtpd") is None:
            raise MailCatcherMissing(EXTRA)
        self.folder.mkdir(parents=True, exist_ok=True)
        self._write_list()
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._session, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()

    def _session(self) -> SMTP:
        from aiosmtpd.smtp import SMTP

        return SMTP(_Handler(self._keep), hostname="localhost", data_size_limit=LARGEST)

    def _keep(self, content: bytes) -> None:
        name = f"{len(self.caught) + 1:04d}.eml"
        (self.folder / name).write_bytes(content)
        mail = message_from_bytes(content, policy=policy.default)
        caught = CaughtMail(
            at=datetime.now().astimezone(),
            file=name,
            sender=str(mail.get("From", "")),
            to=str(mail.get("To", "")),
            subject=str(mail.get("Subject", "")),
            text=_text_of(mail),
        )
        self.caught.append(caught)
        self._write_list()
        self._told(caught)

    def _write_list(self) -> None:
        from jinja2 import Environment, FileSystemLoader

        # Mails contain text from the plant, which must be escaped.
        pages = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True)
        text = pages.get_template(TEMPLATE).render(
            mails=self.caught[::-1][:_SHOWN], count=len(self.caught)
        )
        new_file = self.list_file.with_suffix(".new")
        new_file.write_text(text, encoding="utf-8", newline="\n")
        new_file.replace(self.list_file)


class _Handler:
    """The handler of received mails for aiosmtpd."""

    def __init__(self, keep: Callable[[bytes], None]) -> None:
        self._keep = keep

    async def handle_DATA(self, server: object, session: object, envelope: Any) -> str:
        """Store the mail; aiosmtpd prescribes the name of this method."""
        content = envelope.original_content or b""
        self._keep(content)
        return "250 kept"


def _text_of(mail: EmailMessage) -> str:
    body = mail.get_body(("plain",))
    return "" if body is None else str(body.get_content())
