"""Where the store is: a database URL whose password is never printed."""

from __future__ import annotations

from stemwatch.connectors.secret import masked


class DatabaseUrl:
    """A database URL that shows itself with its password masked.

    ``str``, ``repr`` and every format give the masked form; ``reveal()`` gives the URL itself, for
    the one call that connects.
    """

    __slots__ = ("_url",)

    def __init__(self, url: str) -> None:
        self._url = url

    def reveal(self) -> str:
        """The URL with its password. Not to be printed, logged or stored."""
        return self._url

    def __str__(self) -> str:
        return masked(self._url)

    def __repr__(self) -> str:
        return f"DatabaseUrl({masked(self._url)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DatabaseUrl) and self._url == other._url

    def __hash__(self) -> int:
        return hash(self._url)
