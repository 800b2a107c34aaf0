"""``OpcUaAddress``: a server as it travels to the worker that asks it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from stemwatch.connectors.archive.secret import Secret, without_password

if TYPE_CHECKING:
    from stemwatch.connectors.opcua.connector import OpcUaArchive

PAGE = 50_000


@dataclass(frozen=True, kw_only=True)
class Security:
    """How a connection is secured: policy and mode by their OPC UA names, certificates as paths.

    Without ``server_certificate`` the server's own word for its certificate is taken.
    """

    policy: str = "None"
    mode: str = "SignAndEncrypt"
    certificate: str = ""
    private_key: str = ""
    server_certificate: str = ""
    user: str = ""
    password: Secret = field(default_factory=Secret)


@dataclass(frozen=True, kw_only=True)
class OpcUaAddress:
    """Where a server is. Implements ``archive.ArchiveAddress``.

    ``page`` is how many samples are asked for at a time; ``before_s`` seconds before each window
    are read too, because servers keep values when they change.
    """

    url: str
    security: Security = field(default_factory=Security)
    timeout_s: float = 30.0
    page: int = PAGE
    before_s: float = 3600.0

    def open(self) -> OpcUaArchive:
        """The archive; no connection is made yet."""
        from stemwatch.connectors.opcua.connector import OpcUaArchive

        return OpcUaArchive(self)

    def __str__(self) -> str:
        return without_password(self.url)
