"""Rows of a query, chunk by chunk, to the samples of one tag."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np

from stemwatch.connectors.archive.number_column import Codes, number_column
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.columns import Column, convert
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawColumn, RawTable, RawTimes
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.epoch import ns_of
from stemwatch.connectors.historian.times.instants import Instants, local_instants
from stemwatch.connectors.historian.times.time_column import read_instants

PARAMETERS = ("tag", "start", "end")
_QUOTED = re.compile(r"'(?:[^']|'')*'|\"(?:[^\"]|\"\")*\"|`[^`]*`|\[[^\]\n]*\]")
_COMMENT = re.compile(r"--[^\n]*|/\*.*?\*/", re.S)
_DOLLAR = re.compile(r"\$(\w*)\$")
_PARAMETER = re.compile(r"(?<![:\w\\]):([A-Za-z_]\w*)(?!:)")
# Words that change data, its structure, the session or files, in any engine that SQLAlchemy knows.
_WRITING = frozenset(
    ("insert", "update", "delete", "merge", "upsert", "drop", "alter", "create", "truncate",
     "grant", "revoke", "call", "exec", "execute", "into", "copy", "vacuum", "attach", "detach",
     "pragma", "lock", "reindex", "analyze", "do", "load", "import", "export", "rename", "begin",
     "commit", "rollback", "savepoint", "declare", "kill", "shutdown", "nextval", "setval")
)  # fmt: skip


class QueryMistake(NamedTuple):
    """A mistake in a query template: what was found and what was expected."""

    found: str
    expected: str


def mistake_in(text: str, *, with_tag: bool = True) -> QueryMistake | None:
    """Why ``text`` cannot be used as a template, or ``None``.

    It must be one SELECT, which may begin with WITH, without any word that writes; ``with_tag``:
    it must have the parameters ``:tag``, ``:start`` and ``:end``, else none at all. Besides, the
    transaction is read only where the engine can, and is never committed.
    """
    expected_statement = "one statement that begins with SELECT or WITH and only reads"
    if _DOLLAR.search(_QUOTED.sub(" ", text)):
        return QueryMistake("a dollar-quoted text", "texts between single quotes")
    without_comments = _without_comments(text)
    if ";" in without_comments:
        return QueryMistake("several statements", expected_statement)
    words = re.findall(r"[a-z_]\w*", without_comments.lower())
    if not words or words[0] not in ("select", "with"):
        return QueryMistake(
            f"a statement that begins with {repr(words[0]) if words else 'nothing'}",
            expected_statement,
        )
    writing = [word for word in words if word in _WRITING]
    if writing:
        hint = "; put a column of that name in double quotes"
        return QueryMistake(f"the word {writing[0]!r}", expected_statement + hint)
    if re.search(r"\bfor\s+(?:no\s+key\s+)?(?:update|share|key)", without_comments, re.I):
        return QueryMistake("a lock (FOR UPDATE)", expected_statement)
    named = set(_PARAMETER.findall(without_comments))
    needed = set(PARAMETERS) if with_tag else set()
    if named != needed:
        parameter_list = ", ".join(f":{name}" for name in sorted(named)) or "none"
        expected = ", ".join(f":{name}" for name in PARAMETERS) if with_tag else "none"
        return QueryMistake(
            f"the parameters {parameter_list}", f"the parameters {expected}, not in quotes"
        )
    return None


def _without_comments(text: str) -> str:
    """The statement without quoted texts, comments and the semicolon at its end."""
    return _COMMENT.sub(" ", _QUOTED.sub(" '' ", text)).strip().rstrip(";").strip()


@dataclass
class Samples:
    """The rows of one tag, as the driver gave them.

    Numbers are kept in one array for each chunk; text values are rare and kept as they are.
    """

    times: list[Any] = field(default_factory=list)
    values: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = field(default_factory=list)
    texts: list[str] | None = None  # texts of every row, once one value was a text
    index: list[int] = field(default_factory=list)
    words: dict[str, int] = field(default_factory=dict)
    has_quality: bool = False

    def add(self, rows: Sequence[Sequence[Any]], at: tuple[int, int, int | None]) -> None:
        """Take a chunk; ``at`` are the places of time, value and quality. Raises ``TypeError`` for
        a value that is neither a number nor a text."""
        time, value, quality = at
        self.times += [row[time] for row in rows]
        cells = [row[value] for row in rows]
        if self.texts is None and any(isinstance(value, str) for value in cells):
            self.texts = [_text(value) for part in self.values for value in part.tolist()]
        if self.texts is not None:
            self.texts += [_text(value) for value in cells]
        else:
            self.values.append(np.array([_number(value) for value in cells], dtype=np.float64))
        if quality is not None:
            self.has_quality = True
            codes = ("" if row[quality] is None else str(row[quality]).strip() for row in rows)
            self.index += [self.words.setdefault(code, len(self.words)) for code in codes]


def places(names: Sequence[str], name: str) -> tuple[int, int, int | None]:
    """The columns of time, value and quality: by name, else the first, second and third.

    Raises ``ConnectorError`` for fewer than two.
    """
    lower = [name.lower() for name in names]
    if "time" in lower and "value" in lower:
        quality = lower.index("quality") if "quality" in lower else None
        return lower.index("time"), lower.index("value"), quality
    if len(names) < 2:
        raise ConnectorError(
            f"{name}: the query gives {', '.join(names) or 'no column'}; expected time, value and "
            "perhaps quality"
        )
    return 0, 1, 2 if len(names) > 2 else None


def _number(value: Any) -> float:
    """Raises ``TypeError`` for what is no number."""
    return float("nan") if value is None else float(value)


def _text(value: Any) -> str:
    return "" if value is None or value != value else str(value)


def instants_of(samples: Samples, options: ReadOptions, name: str, notes: ReadingNotes) -> Instants:
    """The times of all rows. Datetimes with an offset are instants; those without are local times
    of the given zone; texts and numbers are read as in a text export."""
    times = samples.times
    if not all(isinstance(time, datetime) for time in times):
        table = RawTable(
            layout="",
            times=RawTimes(texts=[_written(time) for time in times], name="time"),
            columns=(),
            numbers=range(1, len(times) + 1),
            separator=",",
        )
        return read_instants(table, options, name, notes)
    ns = np.fromiter((_ns(time) for time in times), dtype=np.int64, count=len(times))
    ok = np.ones(ns.size, dtype=bool)
    if all(time.tzinfo is not None for time in times):
        return Instants(ns=ns, ok=ok, in_utc=True, zone="The database gives instants.")
    return local_instants(ns, ok, options, notes)


def _ns(instant: datetime) -> int:
    aware = instant if instant.tzinfo is not None else instant.replace(tzinfo=UTC)
    ns = ns_of(aware)
    assert ns is not None
    return ns


def _written(time: Any) -> str:
    return "" if time is None else str(time)


def column_of(
    tag: str,
    samples: Samples,
    instants: Instants,
    options: ReadOptions,
    name: str,
    unit: str,
    *,
    as_mode: bool,
) -> Column:
    """The column of a tag. Raises ``UnreadableSource`` for quality codes of unknown meaning."""
    if samples.texts is not None:
        words = list(samples.words)
        raw = RawColumn(
            tag=tag,
            cells=samples.texts,
            unit=unit,
            quality_codes=[words[i] for i in samples.index] if samples.has_quality else None,
        )
        decimal, good = options.decimal or ".", options.good_quality
        return convert(raw, instants, decimal=decimal, good=good, name=name, as_mode=as_mode)
    codes = None
    if samples.has_quality:
        index = np.array(samples.index, dtype=np.int64)
        codes = Codes(words=list(samples.words), index=index, good=options.good_quality)
    values = np.concatenate([*samples.values, np.zeros(0)])
    return number_column(
        tag,
        instants.ns,
        instants.ok,
        values,
        source_name=name,
        unit=unit,
        codes=codes,
        as_mode=as_mode,
    )


def gathered(parts: Iterator[Sequence[Sequence[Any]]], names: Sequence[str], name: str) -> Samples:
    """All chunks of one query. Raises ``ConnectorError`` for columns that are no samples."""
    samples, at = Samples(), places(names, name)
    for rows in parts:
        try:
            samples.add(rows, at)
        except (TypeError, ValueError):
            examples = ", ".join(
                f"{word} = {cell!r:.40}" for word, cell in zip(names, rows[0], strict=False)
            )
            raise ConnectorError(
                f"{name}: found a value that is neither a number nor a text (the first row: "
                f"{examples}); expected time, value and perhaps quality, in this order or under "
                "these names"
            ) from None
    return samples
