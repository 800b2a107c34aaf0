"""``HistorianFile``: the connector for one text export of a historian."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import WHOLE, Connector, TagInfo, TagMapping, ValveTags, Window
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.inspection import Inspection
    from stemwatch.connectors.historian.opened_file import OpenedFile

_DEFAULTS = ReadOptions()


class HistorianFile:
    """One CSV or text export, read as it was written.

    The file is read once, when it is first asked for anything, and never written. Whatever is not
    said in ``options`` is decided from the whole file; each decision is a sentence in the
    recording's provenance. Implements ``stemwatch.connectors.connector.Connector``.
    """

    def __init__(self, path: str | os.PathLike[str], options: ReadOptions = _DEFAULTS) -> None:
        self.path = Path(path)
        self.options = options

    @cached_property
    def _opened(self) -> OpenedFile:
        # Late: reading needs numpy and the layouts, `stemwatch --help` does not.
        from stemwatch.connectors.historian.opened_file import open_file

        return open_file(self.path, self.options)

    def tags(self) -> Sequence[TagInfo]:
        """Every tag with unit, description and, where there is no doubt, role and valve."""
        import numpy as np

        opened = self._opened
        infos = []
        for one in opened.roles():
            column = opened.column(one.tag)
            facts = {} if one.own_interval_s is None else {"own_interval_s": one.own_interval_s}
            infos.append(
                TagInfo(
                    tag=one.tag,
                    unit=one.unit,
                    description=one.description,
                    samples=int(np.isfinite(column.values).sum()),
                    proposed_role=one.role,
                    proposed_valve=one.valve,
                    remark=one.remark,
                    facts=facts,
                )
            )
        return infos

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve.

        Raises ``UnknownTag`` for a tag that is not there, ``ConnectorError`` for one tag given as
        both OP and MV, a window without samples or without a known zone, and a time span that
        needs more than 50 million samples.
        """
        from stemwatch.connectors.historian.recordings import assemble

        return assemble(self._opened, valve, window)

    def inspect(self) -> Inspection:
        """What the reader understood and how good the data is, without reading any valve."""
        from stemwatch.connectors.historian.inspection import inspect_file

        return inspect_file(self._opened)


def propose_valves(source: Connector) -> list[ValveTags]:
    """The valves of a source whose OP leaves no doubt, with every other role that leaves none.

    Sorted by name. A valve without a position tag is proposed without MV: which tag is the
    position is never guessed.
    """
    valves: dict[str, dict[Role, TagMapping]] = {}
    for info in source.tags():
        if info.proposed_role is not None and info.proposed_valve:
            mapping = TagMapping(tag=info.tag, unit=info.unit)
            valves.setdefault(info.proposed_valve, {})[info.proposed_role] = mapping
    return [
        ValveTags(valve=name, tags=tags) for name, tags in sorted(valves.items()) if Role.OP in tags
    ]
