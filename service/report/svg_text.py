"""``svg_text``: a text in a drawing of the report."""

from __future__ import annotations

from markupsafe import Markup, escape

from stemwatch.service.presenter.wording import printable


def svg_text(x: float, y: float, text: str, kind: str, anchor: str) -> Markup:
    """``text`` at (x, y) pixels in the style ``kind``; ``anchor`` is start, middle or end."""
    words = escape(printable(text))
    return Markup(
        f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}" text-anchor="{anchor}">{words}</text>'
    )
