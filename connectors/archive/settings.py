"""``ArchiveSettings``: the ``[[sources]]`` table of an archive, and how a worker opens it; and
``HttpArchiveSettings`` of one behind HTTP."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from urllib.parse import urlsplit

from pydantic import Field

from stemwatch.connectors.archive.http_reader import LOOPBACK
from stemwatch.connectors.connector import ArchiveAddress
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.secret import Secret
from stemwatch.connectors.settings import (
    LONGEST_S,
    Duration,
    Name,
    SourceSettings,
    Zone,
    contradiction,
)


class ArchiveSettings(SourceSettings):
    """Keys of every kind of archive. A connector adds its own and makes an address of them all.

    A key that ends in ``_variable`` names an environment variable that holds a secret, and
    ``secret_file`` a file that does: both are kept out of logs.
    """

    kind: Name = Field(description="the kind of the source, as text")
    zone: Zone | None = Field(default=None, description="an IANA time zone such as Europe/Berlin")
    good_quality: list[Name] | None = Field(
        default=None, description='a list of the codes that mean good, such as ["192", "Good"]'
    )
    before_s: float | None = Field(
        default=None,
        ge=0,
        le=LONGEST_S,
        description="seconds before a window that are read too, for tags that are archived when "
        "they change; 0 or more",
    )

    @abstractmethod
    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Where the archive is, for the worker that opens it; paths count from ``folder``, the
        plant file's, and ``zone`` is the plant's."""

    def read_options(self, zone: str | None) -> ReadOptions:
        """The ``ReadOptions`` among these settings; ``zone`` where they name none."""
        settings = self.model_dump(include=set(ReadOptions.__dataclass_fields__), exclude_none=True)
        if "good_quality" in settings:
            settings["good_quality"] = tuple(settings["good_quality"])
        return ReadOptions(**({"zone": zone} | settings))


class HttpArchiveSettings(ArchiveSettings):
    """Keys of an archive behind an HTTP interface: where it is, and where its secret is kept."""

    url: Name = Field(description="the address of the server, with https://")
    secret_variable: Name | None = Field(
        default=None,
        description="the name of the environment variable that holds the password or token",
    )
    secret_file: Name | None = Field(
        default=None, description="the name of a file that holds nothing but the password or token"
    )
    authority: Name | None = Field(
        default=None,
        description="a file with the certificates of the site's own authority, relative to the "
        "plant file",
    )
    timeout_s: Duration = Field(default=60.0, description="seconds, above 0")

    @property
    def secrets_named(self) -> int:
        """In how many places the secret is said to be."""
        return sum(secret is not None for secret in (self.secret_variable, self.secret_file))

    def check_url(self, expected: str) -> None:
        """Raise where ``url`` is no address by HTTP, or holds a password; ``expected`` says what it
        should be."""
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname or "@" in parts.netloc:
            expected_url = f"{expected}, without a password in it"
            raise contradiction(("url",), "something else", expected_url)

    def check_encrypted(self, secret: str) -> None:
        """Raise where ``secret`` would leave this host without encryption."""
        parts = urlsplit(self.url)
        if parts.scheme == "http" and parts.hostname not in LOOPBACK:
            found_url = f"an address that sends the {secret} unencrypted"
            raise contradiction(("url",), found_url, "an address with https://")

    def secret(self, folder: Path) -> Secret:
        """Where the secret is kept; a file counts from ``folder``."""
        file = _inside(folder, self.secret_file)
        return Secret(variable=self.secret_variable or "", file=file)

    def authority_file(self, folder: Path) -> str:
        """The file of the site's own authority, empty for none."""
        return _inside(folder, self.authority)


def _inside(folder: Path, name: str | None) -> str:
    return "" if name is None else str(folder / name)
