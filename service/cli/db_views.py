"""The tables of ``stemwatch db``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.table import Table

from stemwatch.service.cli.views import escape

if TYPE_CHECKING:
    from stemwatch.service.store.administration.backup_file import TableDigest
    from stemwatch.service.store.administration.check import DatabaseHealth
    from stemwatch.service.store.administration.prune import Pruned


def health_table(address: str, health: DatabaseHealth) -> Table:
    """Rows and size of each table; the title names the database."""
    layout = f"samples in a {health.layout.value}".replace("a partitions", "partitions")
    title = f"{address}: {health.engine}, schema {health.schema or 'none'}, {layout}"
    table = Table(title=escape(title), title_justify="left")
    table.add_column("table")
    for name in ("rows", "size"):
        table.add_column(name, justify="right")
    for table_size in health.tables:
        size = "" if table_size.size_bytes is None else _size(table_size.size_bytes)
        table.add_row(table_size.name, f"{table_size.rows}", size)
    table.add_row("all", "", _size(health.size_bytes))
    return table


def copied_table(title: str, digests: Mapping[str, TableDigest]) -> Table:
    """The copied rows of each table and the beginning of their digest."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("table")
    table.add_column("rows", justify="right")
    table.add_column("digest")
    for name, digest in digests.items():
        table.add_row(name, str(digest.rows), digest.digest[:16])
    return table


def pruned_table(address: str, pruned: Pruned, *, done: bool) -> Table:
    """The rows that were removed or would be."""
    verb = "removed from" if done else "would be removed from"
    table = Table(title=escape(f"{verb} {address}"), title_justify="left")
    table.add_column("what")
    table.add_column("rows", justify="right")
    for name in ("samples", "screenings", "runs", "alerts", "messages"):
        table.add_row(name, str(getattr(pruned, name)))
    return table


def _size(size_bytes: int) -> str:
    """A number of bytes with a unit."""
    size, unit = float(size_bytes), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if size < 1000 or unit == "TB":
            break
        size /= 1000
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
