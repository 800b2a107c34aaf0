"""The layouts of text exports, one file each. A new one is a new file with a ``LAYOUT`` in it."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Protocol

from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput


class Layout(Protocol):
    """One layout of samples in a text file.

    ``matches`` looks for the layout's signature in the first lines and must not match another
    layout; ``parse`` may then read the whole file. The lowest ``order`` is tried first.
    ``parse`` raises ``UnreadableSource`` with file, line, what was found and what was expected.
    """

    name: str
    order: int

    def matches(self, head: list[str]) -> bool: ...

    def parse(self, source: LayoutInput) -> RawTable: ...


@cache
def layouts() -> tuple[Layout, ...]:
    """Every layout in this package, the most particular first."""
    names = sorted(module.name for module in iter_modules(__path__))
    layouts: list[Layout] = [import_module(f"{__name__}.{name}").LAYOUT for name in names]
    return tuple(sorted(layouts, key=lambda layout: (layout.order, layout.name)))


def parse_source(source: LayoutInput) -> RawTable:
    """The table of ``source`` by the first layout that matches; the generic one always does."""
    return layout_of(source).parse(source)


def layout_of(source: LayoutInput) -> Layout:
    """The first layout that matches the first lines of ``source``."""
    return next(layout for layout in layouts() if layout.matches(source.head))
