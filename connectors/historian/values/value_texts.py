"""Words and error texts in value cells: what each says about its sample."""

from __future__ import annotations

from stemwatch.models.recording import Quality

# No value was delivered for this instant.
_ABSENT = frozenset(
    ("", "nan", "null", "na", "n/a", "#n/a", "<null>", "none", "nil", "-", "--", "---", "?",
     "1.#qnan", "-1.#ind", "1,#qnan")
)  # fmt: skip
TRUNCATED = "resize to show all values"


def text_quality(text: str) -> Quality:
    """Quality of a value cell that holds no number: MISSING where it says nothing, else BAD."""
    return Quality.MISSING if text.strip().lower() in _ABSENT else Quality.BAD


def says_truncated(text: str) -> bool:
    """The sheet's array was too small: rows after this one are missing from the file."""
    return text.strip().lower().startswith(TRUNCATED)


_AUTO = frozenset(
    ("auto", "aut", "a", "automatic", "automatik", "automatisch", "cas", "cascade", "kaskade",
     "rcas", "rout", "on")
)  # fmt: skip
_MANUAL = frozenset(
    ("man", "manual", "m", "hand", "manuell", "manuel", "manuale", "iman", "lo", "oos", "off")
)


def mode_value(text: str) -> float | None:
    """1 for a controller mode in which the controller moves OP, 0 for manual, ``None`` unknown."""
    word = text.strip().lower()
    if word in _AUTO:
        return 1.0
    return 0.0 if word in _MANUAL else None
