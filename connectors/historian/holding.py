"""``Holding``: what a source must tell of itself for a recording to be laid on its clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from stemwatch.connectors.historian.columns import Column


class Holding(Protocol):
    """Tags with their samples, from a file or from an archive.

    ``where`` names the source in messages. ``known`` says whether times are instants in UTC; else
    durations are right and dates are not.
    """

    @property
    def where(self) -> str: ...

    @property
    def names(self) -> Sequence[str]: ...

    @property
    def known(self) -> bool: ...

    @property
    def zone(self) -> str: ...

    @property
    def digest(self) -> str: ...

    @property
    def layout(self) -> str: ...

    @property
    def decisions(self) -> Sequence[str]: ...

    @property
    def problems(self) -> Sequence[str]: ...

    def column(self, tag: str, *, as_mode: bool = False) -> Column: ...
