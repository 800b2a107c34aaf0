"""The letters of the PDF: an embedded font, one of the reader's own for Chinese, Japanese and
Korean, and a box for what neither has."""

from __future__ import annotations

import unicodedata
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

REGULAR, BOLD = "DejaVuSansCondensed", "DejaVuSansCondensed-Bold"
# Adobe's names for fonts that readers of PDF supply; embedding them would take megabytes.
HAN, HANGUL = "STSong-Light", "HYSMyeongJo-Medium"
BOX = "□"
_INVISIBLE = frozenset({"Cc", "Cf", "Mn", "Me"})


@cache
def fonts() -> dict[str, Any]:
    """The embedded fonts by name, registered with reportlab."""
    from reportlab import rl_config
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.cidfonts import UnicodeCIDFont
    from reportlab.pdfbase.ttfonts import TTFont

    rl_config.useA85 = 0  # no channel is of seven bits any more, and the text form takes long
    folder = files("stemwatch.service.maintenance").joinpath("fonts")
    found = {name: TTFont(name, str(folder.joinpath(f"{name}.ttf"))) for name in (REGULAR, BOLD)}
    for font in (*found.values(), UnicodeCIDFont(HAN), UnicodeCIDFont(HANGUL)):
        pdfmetrics.registerFont(font)
    return found


@lru_cache(maxsize=20_000)
def font_of(letter: str, bold: bool = False) -> str:
    """The name of the font that has ``letter``; empty where none has it."""
    name = BOLD if bold else REGULAR
    if ord(letter) in fonts()[name].face.charToGlyph:
        return name
    if "HANGUL" in unicodedata.name(letter, ""):
        return HANGUL
    kinds = ("CJK", "HIRAGANA", "KATAKANA", "FULLWIDTH", "IDEOGRAPHIC")
    return HAN if unicodedata.name(letter, "").startswith(kinds) else ""


@lru_cache(maxsize=50_000)
def runs(text: str, bold: bool = False) -> tuple[tuple[str, str], ...]:
    """``text`` as pieces of (font, letters). What no font has is a box; what has no width, such as
    a mark that turns the direction of writing, is left out."""
    pieces: list[tuple[str, str]] = []
    for letter in text:
        font = font_of(letter, bold)
        if not font:
            if unicodedata.category(letter) in _INVISIBLE:
                continue
            font, letter = font_of(BOX, bold), BOX
        if pieces and pieces[-1][0] == font:
            pieces[-1] = (font, pieces[-1][1] + letter)
        else:
            pieces.append((font, letter))
    return tuple(pieces)


@lru_cache(maxsize=50_000)
def width_of(text: str, bold: bool = False) -> float:
    """The width of ``text`` in a size of 1 point."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    fonts()
    return float(sum(stringWidth(letters, font, 1.0) for font, letters in runs(text, bold)))


def is_whole(text: str) -> bool:
    """Whether every visible letter of ``text`` can be drawn."""
    return all(
        font_of(letter) or unicodedata.category(letter) in _INVISIBLE for letter in set(text)
    )
