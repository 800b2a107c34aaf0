"""A group of oscillating loops as pictures: spectra as a heat map, strength within a window and
from window to window as bars."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import tzinfo

from markupsafe import Markup, escape

from stemwatch.models.oscillation_groups.over_windows import OscillationWindow
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.service.presenter.wording import duration, instant, printable, share

MOST_ROWS = 20  # loops of a heat map
LEFT, CELL, ROW, TOP, BOTTOM = 150, 9, 18, 4, 20
LONGEST_NAME = 22
BAR, HEIGHT = 14, 46
FEWEST_BARS = 24  # bars that a picture has room for, so that a few are not drawn as wide blocks


def spectra_map(group: OscillationGroup) -> Markup:
    """Powers of each member over the period, each loop's largest the darkest, the likeliest source
    first."""
    row_count = min(len(group.members), MOST_ROWS)
    bands = len(group.periods_s)
    width, foot = LEFT + CELL * bands + 24, TOP + ROW * row_count
    name = (
        f"Spectra of {row_count} loops; what they have in common is near {duration(group.period_s)}"
    )
    parts = [
        f'<svg class="map" viewBox="0 0 {width} {foot + BOTTOM}" width="{width}" '
        f'height="{foot + BOTTOM}" role="img" aria-label="{escape(name)}">'
    ]
    for row in range(row_count):
        y = TOP + ROW * row
        loop = printable(group.members[row].loop)
        short = loop if len(loop) <= LONGEST_NAME else loop[: LONGEST_NAME - 1] + "…"
        parts.append(f'<text x="{LEFT - 6}" y="{y + 13}" text-anchor="end">{escape(short)}</text>')
        parts += [
            f'<rect class="heat" x="{LEFT + CELL * k}" y="{y}" width="{CELL}" '
            f'height="{ROW - 2}" fill-opacity="{power:.2f}"/>'
            for k, power in enumerate(group.spectra[row])
            if power >= 0.02
        ]
    for k in (0, bands // 3, 2 * bands // 3, bands - 1):
        period_text = escape(duration(float(f"{group.periods_s[k]:.2g}")))
        x = LEFT + CELL * k + CELL // 2
        parts.append(
            f'<text class="axis" x="{x}" y="{foot + 14}" text-anchor="middle">{period_text}</text>'
        )
    return Markup("".join([*parts, "</svg>"]))


def strength_bars(group: OscillationGroup) -> Markup:
    """The group's strength over the record, the strongest window the highest bar."""
    return _bars(group.strength, f"Strength over {duration(group.duration_s)}", [])


def windows_bars(windows: Sequence[OscillationWindow], zone: tzinfo) -> Markup:
    """The mean share of the variance of its loops in each window, the oldest first; the first and
    the last window are dated, each says its share to a reader who points at it."""
    titles_of_windows = [
        f"until {instant(window.at, zone)}: {share(window.variance_share)}, period "
        f"{duration(window.period_s)}, {window.source or 'none of the loops'} first"
        for window in windows
    ]
    name = (
        f"Share of the variance in {len(windows)} windows, {titles_of_windows[0]} to "
        f"{titles_of_windows[-1]}"
    )
    return _bars([one.variance_share for one in windows], name, titles_of_windows)


def _bars(levels: Sequence[float], name: str, bar_titles: Sequence[str]) -> Markup:
    top = max(max(levels), 1e-9)
    width = BAR * max(len(levels), FEWEST_BARS)
    titles = [f"<title>{escape(printable(sentence))}</title>" for sentence in bar_titles]
    bars = "".join(
        f'<rect class="heat" x="{BAR * index}" y="{HEIGHT * (1.0 - level / top):.1f}" '
        f'width="{BAR - 2}" height="{max(HEIGHT * level / top, 0.5):.1f}">{title}</rect>'
        for index, (level, title) in enumerate(
            zip(levels, titles or [""] * len(levels), strict=True)
        )
    )
    return Markup(
        f'<svg class="map" viewBox="0 0 {width} {HEIGHT}" width="{width}" height="{HEIGHT}" '
        f'role="img" aria-label="{escape(printable(name))}">{bars}</svg>'
    )
