"""What ``stemwatch db`` shows: tables of rows, sizes and what was removed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.table import Table

from stemwatch.service.cli import views

if TYPE_CHECKING:
    from stemwatch.service.store.administration.backup_file import TableDigest
    from stemwatch.service.store.administration.check import DatabaseHealth
    from stemwatch.service.store.administration.prune import Pruned


def say(sentence: str) -> None:
    """One plain sentence on standard output."""
    views.out.print(views.escape(sentence), highlight=False)


def health_table(address: str, health: DatabaseHealth) -> Table:
    """Rows and sizes of each table, under what the database is."""
    layout = f"samples in a {health.layout.value}".replace("a partitions", "partitions")
    title = f"{address}: {health.engine}, schema {health.schema or 'none'}, {layout}"
    table = Table(title=views.escape(title), title_justify="left")
    table.add_column("table")
    for name in ("rows", "size"):
        table.add_column(name, justify="right")
    for one in health.tables:
        size = "" if one.size_bytes is None else _size(one.size_bytes)
        table.add_row(one.name, f"{one.rows}", size)
    table.add_row("all", "", _size(health.size_bytes))
    return table


def told_table(title: str, told: Mapping[str, TableDigest]) -> Table:
    """What was carried: rows of each table and the beginning of their digest."""
    table = Table(title=views.escape(title), title_justify="left")
    table.add_column("table")
    table.add_column("rows", justify="right")
    table.add_column("digest")
    for name, one in told.items():
        table.add_row(name, str(one.rows), one.digest[:16])
    return table


def pruned_table(address: str, pruned: Pruned, *, done: bool) -> Table:
    """What went, or would go."""
    verb = "removed from" if done else "would be removed from"
    table = Table(title=views.escape(f"{verb} {address}"), title_justify="left")
    table.add_column("what")
    table.add_column("rows", justify="right")
    for name in ("samples", "screenings", "runs", "alerts", "messages"):
        table.add_row(name, str(getattr(pruned, name)))
    return table


def _size(size_bytes: int) -> str:
    """Bytes as a person reads them."""
    size, unit = float(size_bytes), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if size < 1000 or unit == "TB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
