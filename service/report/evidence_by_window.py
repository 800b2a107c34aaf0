"""The evidence by window as a picture: effects (rows) over windows (columns), as SVG.

A window that names the effect has a full square with a tick, one that gains by it without naming it
a paler one, one that could not have shown it a dot: no meaning hangs on colour alone.
"""

from __future__ import annotations

from datetime import tzinfo

from markupsafe import Markup, escape

from stemwatch.models.history.evidence_over_windows import LastingFinding, WindowEvidence
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.physics_words import effect_name
from stemwatch.service.presenter.wording import printable
from stemwatch.service.report.svg_text import svg_text

LEFT, TOP, CELL, BOTTOM, RIGHT = 190, 8, 24, 26, 92
PALEST, DARKEST = 0.08, 0.55  # of a window that gains by an effect without naming it
MOST_DAYS = 6  # dates below the columns


def evidence_picture(evidence: EvidenceOfWeeks, zone: tzinfo) -> Markup:
    """``evidence`` as SVG; dates in ``zone``."""
    windows = evidence.shown
    width = LEFT + CELL * max(len(windows), 3) + RIGHT
    height = TOP + CELL * len(evidence.findings) + BOTTOM
    description = escape(printable(" ".join(evidence.sentences(zone))))
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    parts = [
        Markup(f'<svg class="by-window" {size} role="img" aria-label="')
        + description
        + Markup('">'),
        *[
            _row(finding, windows, TOP + CELL * index)
            for index, finding in enumerate(evidence.findings)
        ],
        *_times(evidence, TOP + CELL * len(evidence.findings) + 16, zone),
        Markup("</svg>"),
    ]
    return Markup("\n").join(parts)


def _row(finding: LastingFinding, windows: tuple[WindowEvidence, ...], y: int) -> Markup:
    middle = y + CELL / 2 + 4
    cells = [
        _cell(window, finding.slug, LEFT + CELL * index, y) for index, window in enumerate(windows)
    ]
    end = LEFT + CELL * len(windows) + 6
    return Markup("").join(
        [
            svg_text(LEFT - 8, middle, effect_name(finding.slug), "effect-of", "end"),
            *cells,
            svg_text(end, middle, finding.state.value, "state-of", "start"),
        ]
    )


def _cell(window: WindowEvidence, slug: str, x: int, y: int) -> Markup:
    box = f'x="{x + 1}" y="{y + 1}" width="{CELL - 2}" height="{CELL - 2}" rx="3"'
    if window.names(slug):
        tick = f"M{x + 6} {y + 12}l4 4 8 -9"
        return Markup(f'<rect {box} class="named"/><path d="{tick}" class="tick"/>')
    score = window.score(slug)
    if score is None:
        return Markup(f'<circle cx="{x + CELL / 2}" cy="{y + CELL / 2}" r="2" class="blind"/>')
    share = min(max(score.strength, 0.0), 1.0)
    if share <= PALEST:
        return Markup(f'<rect {box} class="without"/>')
    return Markup(f'<rect {box} class="gains" fill-opacity="{DARKEST * share:.2f}"/>')


def _times(evidence: EvidenceOfWeeks, y: int, zone: tzinfo) -> list[Markup]:
    """Dates below some of the columns, the first among them; hours into one recording."""
    windows = evidence.shown
    if not windows:
        return []
    step = max(-(-len(windows) // MOST_DAYS), 1)
    step = max(step, 2) if len(windows) > 2 else max(len(windows) - 1, 1)
    labelled = [index for index in range(0, len(windows), step) if index + step <= len(windows)]
    return [
        svg_text(LEFT + CELL * (index + 0.5), y, _time(evidence, index, zone), "axis", "middle")
        for index in labelled
    ]


def _time(evidence: EvidenceOfWeeks, index: int, zone: tzinfo) -> str:
    window, recording_began = evidence.shown[index], evidence.recording_began
    if recording_began is None:
        return window.at.astimezone(zone).strftime("%m-%d")
    return f"{((window.start or window.at) - recording_began).total_seconds() / 3600.0:.3g} h"
