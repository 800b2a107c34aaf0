"""``ArchiveAddress``: where an archive is, small enough to travel to the worker that opens it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from stemwatch.connectors.connector import Connector, ValveTags


class Archive(Connector, Protocol):
    """A connector that may hold thousands of tags."""

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles whose tag the archive does not have.

        OP and MV stay asked for: that the position is missing is worth saying.
        """
        ...


@runtime_checkable
class ArchiveAddress(Protocol):
    """What is needed to open an archive: hashable, picklable, and shown without secrets.

    Work is sent to where the data is: a task carries an address, never samples.
    """

    def open(self) -> Archive: ...

    def __hash__(self) -> int: ...
