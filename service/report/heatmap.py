"""A residual map as a picture: travel (rows) against phase of the motion (columns), as SVG.

The colour of a cell is the rms of the residual there on a scale that maps of one valve share; the
number in it is the same, in percent of span, so that no meaning hangs on colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from markupsafe import Markup, escape

from stemwatch.models.mismatch.findings import ResidualMap
from stemwatch.service.presenter.wording import figure, finite, printable
from stemwatch.service.report.svg_text import svg_text

LEFT, TOP, CELL_WIDTH, CELL_HEIGHT, LINE = 78, 34, 60, 28, 13
BOTTOM = 6
# Ink on a cell of this opacity keeps a contrast of 4.5 in both themes.
DARKEST = 0.5
LONGEST_LABEL = 24

# A file that stands alone brings its colours; in a page the page's own styles do.
ALONE = Markup(
    "<style>text{font:11px system-ui,sans-serif;fill:#17202c}.axis{fill:#566273}"
    ".heat{fill:#c2500a}.none{fill:none;stroke:#d9dde4}"
    "@media (prefers-color-scheme:dark){text{fill:#e4e9f0}.axis{fill:#9fabba}"
    ".heat{fill:#f2914d}.none{stroke:#333e4c}}</style>"
)


def largest(*maps: ResidualMap) -> float:
    """The largest rms of several maps in percent of span: the end of their common scale."""
    numbers = [number for residuals in maps for row in residuals.grid for number in _finite(row)]
    return max(numbers, default=0.0)


def heat_map(
    residuals: ResidualMap, top: float, name: str, *, alone: bool = False
) -> Markup | None:
    """``residuals`` as SVG, ``None`` where it has no cells.

    ``top`` is the rms in percent of span that has the full colour, ``name`` what a screen reader
    says first. ``alone``: a file of its own, with its name space and colours.
    """
    if not residuals.grid or not residuals.columns:
        return None
    width = LEFT + CELL_WIDTH * len(residuals.columns)
    height = TOP + CELL_HEIGHT * len(residuals.grid) + BOTTOM
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    space = ' xmlns="http://www.w3.org/2000/svg"' if alone else ""
    parts = [
        Markup(f'<svg class="map"{space} {size} role="img" aria-label="')
        + escape(printable(_description(residuals, name)))
        + Markup('">'),
        ALONE if alone else Markup(""),
        *[_column(column, label) for column, label in enumerate(residuals.columns)],
        *[_row(residuals, row, top) for row in range(len(residuals.grid))],
        Markup("</svg>"),
    ]
    return Markup("\n").join(part for part in parts if part)


def _finite(row: Sequence[float | None]) -> list[float]:
    return [number for value in row if (number := finite(value)) is not None]


def _description(residuals: ResidualMap, name: str) -> str:
    cells = [
        (number, column, row)
        for row, cells in enumerate(residuals.grid)
        for column, cell in zip(residuals.columns, cells, strict=False)
        if (number := finite(cell)) is not None
    ]
    if not cells:
        return f"{name}: no samples."
    worst, column, row = max(cells)
    cell_place = f"{column}, {_travel(residuals.travel_edges, row)}".rstrip(", ")
    return f"{name}: the largest rms, {figure(worst, 2)} % of span, is at {cell_place}."


def _travel(edges: Sequence[float], row: int) -> str:
    if row + 1 >= len(edges):
        return ""
    narrowest = min(high - low for low, high in pairwise(edges))
    digits = 0 if narrowest >= 2.0 else 1 if narrowest >= 0.2 else 2
    return f"{edges[row]:.{digits}f}–{edges[row + 1]:.{digits}f} %"


def _column(column: int, label: str) -> Markup:
    """The heading of a column, on two lines where it has two words."""
    middle = LEFT + CELL_WIDTH * (column + 0.5)
    short = label if len(label) <= LONGEST_LABEL else label[: LONGEST_LABEL - 1] + "…"
    first, _, second = short.partition(" ")
    lines = [first, second] if second else ["", first]
    return Markup("").join(
        svg_text(middle, TOP - 6 - LINE * (1 - index), line, "axis", "middle")
        for index, line in enumerate(lines)
        if line
    )


def _row(residuals: ResidualMap, row: int, top: float) -> Markup:
    """One row of cells; the highest travel is drawn uppermost."""
    y = TOP + CELL_HEIGHT * (len(residuals.grid) - 1 - row)
    middle = y + CELL_HEIGHT / 2 + 4
    parts = [svg_text(LEFT - 6, middle, _travel(residuals.travel_edges, row), "axis", "end")]
    for column, cell in enumerate(residuals.grid[row][: len(residuals.columns)]):
        x, number = LEFT + CELL_WIDTH * column, finite(cell)
        box = f'x="{x + 1}" y="{y + 1}" width="{CELL_WIDTH - 2}" height="{CELL_HEIGHT - 2}" rx="3"'
        if number is None:
            parts.append(Markup(f'<rect {box} class="none"/>'))
            continue
        share = min(max(number / top, 0.0), 1.0) if top > 0 else 0.0
        parts.append(Markup(f'<rect {box} class="heat" fill-opacity="{DARKEST * share:.3f}"/>'))
        parts.append(svg_text(x + CELL_WIDTH / 2, middle, figure(number, 2), "cell", "middle"))
    return Markup("").join(parts)
