"""A group of oscillating loops as pictures: spectra as a heat map, strength within a window and
from window to window as bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import timedelta, tzinfo

from markupsafe import Markup, escape

from stemwatch.models.oscillation_groups.over_windows import OscillationWindow
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.service.presenter.oscillation_words import period_in_words
from stemwatch.service.presenter.wording import duration, instant, printable, share

SHADES = 20
FAINTEST = 0.02  # of a row's largest power: what is fainter is not drawn
MOST_ROWS = 20  # loops of a heat map
LEFT, CELL, ROW, TOP, BOTTOM = 150, 9, 18, 18, 36
RIGHT = 40  # room for half of the last label
LONGEST_NAME = 22
BAR, HEIGHT = 14, 46
FOOT, HEAD = 18, 14  # room for the instants below bars, and for the largest share above them
FEWEST_BARS = 24  # bars that a picture has room for, so that a few are not drawn as wide blocks


def spectra_map(group: OscillationGroup) -> Markup:
    """Powers of each member over the period, each loop's largest the darkest, the likeliest source
    first; a mark over the period that they have in common."""
    row_count = min(len(group.members), MOST_ROWS)
    bands = len(group.periods_s)
    width, foot = LEFT + CELL * bands + RIGHT, TOP + ROW * row_count
    common = period_in_words(group.period_s)
    name = f"Spectra of {row_count} loops; what they have in common is near {common}"
    parts = [
        f'<svg class="map" viewBox="0 0 {width} {foot + BOTTOM}" width="{width}" '
        f'height="{foot + BOTTOM}" role="img" aria-label="{escape(name)}">'
    ]
    nearest = min(range(bands), key=lambda k: abs(math.log(group.periods_s[k] / group.period_s)))
    parts.append(
        f'<text class="axis" x="{_middle(nearest)}" y="{TOP - 5}" text-anchor="middle">'
        f"{escape(common)} ▾</text>"
    )
    for row in range(row_count):
        y = TOP + ROW * row
        loop = printable(group.members[row].loop)
        short = loop if len(loop) <= LONGEST_NAME else loop[: LONGEST_NAME - 1] + "…"
        parts.append(f'<text x="{LEFT - 6}" y="{y + 13}" text-anchor="end">{escape(short)}</text>')
        parts += _cells(group.spectra[row], y)
    for k in (0, bands // 3, 2 * bands // 3, bands - 1):
        period_text = escape(period_in_words(group.periods_s[k]))
        parts.append(
            f'<text class="axis" x="{_middle(k)}" y="{foot + 14}" text-anchor="middle">'
            f"{period_text}</text>"
        )
    parts.append(
        f'<text class="axis" x="{_middle(bands // 2)}" y="{foot + 30}" text-anchor="middle">'
        "period</text>"
    )
    return Markup("".join([*parts, "</svg>"]))


def _cells(powers: Sequence[float], y: int) -> list[str]:
    """The cells of one row, those of one shade together."""
    shades: dict[str, str] = {}
    for k, power in enumerate(powers):
        if power >= FAINTEST:
            cell = f"M{LEFT + CELL * k} {y}h{CELL}v{ROW - 2}h-{CELL}z"
            shade = f"{round(SHADES * power) / SHADES or FAINTEST:g}"
            shades[shade] = shades.get(shade, "") + cell
    return [
        f'<path class="heat" d="{cells}" fill-opacity="{shade}"/>'
        for shade, cells in shades.items()
    ]


def _middle(band: int) -> int:
    return LEFT + CELL * band + CELL // 2


def strength_bars(group: OscillationGroup, zone: tzinfo) -> Markup:
    """The group's strength over the record, the strongest part of it the highest bar; dated where
    the record is."""
    ends = (
        ()
        if group.start is None
        else (group.start, group.start + timedelta(seconds=group.duration_s))
    )
    name = f"Strength over {duration(group.duration_s)}"
    return _bars(group.strength, name, [], [instant(end, zone) for end in ends])


def windows_bars(windows: Sequence[OscillationWindow], zone: tzinfo) -> Markup:
    """The mean share of the variance of its loops in each window, the oldest first; the first and
    the last window are dated, each says its share to a reader who points at it."""
    titles_of_windows = [
        f"until {instant(window.at, zone)}: {share(window.variance_share)}, period "
        f"{period_in_words(window.period_s)}, {window.source or 'none of the loops'} first"
        for window in windows
    ]
    name = (
        f"Share of the variance in {len(windows)} windows, {titles_of_windows[0]} to "
        f"{titles_of_windows[-1]}"
    )
    shares = [one.variance_share for one in windows]
    ends = [f"until {instant(window.at, zone)}" for window in (windows[0], windows[-1])]
    return _bars(shares, name, titles_of_windows, ends, above=[share(one) for one in shares])


def _bars(
    levels: Sequence[float],
    name: str,
    bar_titles: Sequence[str],
    ends: Sequence[str],
    above: Sequence[str] = (),
) -> Markup:
    """Bars with ``ends``, what stands below the first and the last, and the highest one's entry of
    ``above`` over it."""
    top = max(max(levels), 1e-9)
    room = BAR * FEWEST_BARS
    step = max(room // len(levels), BAR) if above else BAR
    width, foot = max(step * len(levels), room), HEAD + HEIGHT
    titles = [f"<title>{escape(printable(sentence))}</title>" for sentence in bar_titles]
    bars = "".join(
        f'<rect class="heat" x="{step * index}" y="{HEAD + HEIGHT * (1.0 - level / top):.1f}" '
        f'width="{BAR - 2}" height="{max(HEIGHT * level / top, 0.5):.1f}">{title}</rect>'
        for index, (level, title) in enumerate(
            zip(levels, titles or [""] * len(levels), strict=True)
        )
    )
    texts = [
        f'<text class="axis" x="{x}" y="{foot + 13}" text-anchor="{anchor}">{escape(text)}</text>'
        for text, x, anchor in zip(ends, (0, width), ("start", "end"), strict=False)
    ]
    if above:
        highest = max(range(len(levels)), key=lambda index: levels[index])
        x, text = step * highest, escape(above[highest])
        texts.append(f'<text class="axis" x="{x}" y="{HEAD - 3}">{text}</text>')
    return Markup(
        f'<svg class="map" viewBox="0 0 {width} {foot + FOOT}" width="{width}" '
        f'height="{foot + FOOT}" role="img" aria-label="{escape(printable(name))}">{bars}'
        f"{''.join(texts)}</svg>"
    )
