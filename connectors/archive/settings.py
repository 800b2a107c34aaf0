"""``ArchiveSettings``: the ``[[sources]]`` table of an archive, and how a worker opens it."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path

from pydantic import Field

from stemwatch.connectors.connector import ArchiveAddress
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.settings import Name, NotNegative, SourceSettings, Zone


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
    before_s: NotNegative | None = Field(
        default=None,
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
