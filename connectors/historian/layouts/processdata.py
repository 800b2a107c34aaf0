"""The refinery ``PROCESSDATA`` export: five header lines, tab separated, four hold flags.

Line 1: signature, title, time format. Line 2: columns, interval in seconds, first time, rows.
Line 3: tags. Line 4: descriptions, whose ``_OP`` says that ``.MV`` is the controller output.
Line 5: settings of the plant's own method, of no use here and with a broken tab in it.
"""

from __future__ import annotations

from collections.abc import Sequence

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.raw_table import RawColumn, RawTable, RawTimes
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_FIRST = 5
# Flag column of each role's suffix: the archive repeated the value before.
_FLAGS = {"MV": "bOpOFL", "PV": "bPvOFL", "SV": "bSpOFL", "MODE": "bAutOFL"}


class ProcessData:
    """Recognised by the word in its first cell."""

    name = "PROCESSDATA"
    order = 10

    def matches(self, head: list[str]) -> bool:
        return bool(head) and head[0].startswith("PROCESSDATA\t")

    def parse(self, source: LayoutInput) -> RawTable:
        lines = source.document.lines
        if len(lines) <= _FIRST or not lines[2].startswith("tagname\t"):
            raise UnreadableSource(
                f"{source.name}: line 3: expected 'tagname' and the tags of a PROCESSDATA export; "
                f"found {(lines[2] if len(lines) > 2 else '')[:40]!r}"
            )
        tags = [cell.strip() for cell in lines[2].split("\t")]
        descriptions = [cell.strip() for cell in lines[3].split("\t")]
        descriptions += [""] * (len(tags) - len(descriptions))
        rows = source.rows("\t", _FIRST)
        body = source.body(rows, 0, len(tags), "\t")
        cells = dict(enumerate(body.columns)) if body.numbers else {}
        columns = [
            self._column(i, tags, descriptions, cells)
            for i in range(1, len(tags))
            if tags[i] not in _FLAGS.values() and i in cells
        ]
        promised = lines[1].split("\t")
        source.compare_with_promised(2, "".join(promised[3:4]), len(body.numbers))
        return RawTable(
            layout="PROCESSDATA export (.MV is the controller output, flagged values are held)",
            times=RawTimes(texts=cells.get(0, []), name="time"),
            columns=columns,
            numbers=body.numbers,
            separator="\t",
            decimal=".",
            mv_is_output=True,
        )

    def _column(
        self, i: int, tags: list[str], descriptions: list[str], cells: dict[int, Sequence[str]]
    ) -> RawColumn:
        flag = _FLAGS.get(tags[i].rpartition(".")[2])
        repeat_flags = cells.get(tags.index(flag)) if flag in tags else None
        return RawColumn(
            tag=tags[i], description=descriptions[i], cells=cells[i], held=repeat_flags
        )


LAYOUT = ProcessData()
