"""Tag grammar: which loop a tag belongs to and what its last word says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from stemwatch.connectors.historian.values.units import split_unit
from stemwatch.models.recording import Role

OUTPUT_WORDS = frozenset(("op", "out", "co", "lmn", "output", "stellgröße", "stellgroesse"))
SETPOINT_WORDS = frozenset(("sp", "sv", "setpoint", "set_point", "sollwert"))
MEASURED_WORDS = frozenset(("pv", "pv_in", "istwert"))
MODE_WORDS = frozenset(("mode",))
POSITION_WORDS = frozenset(
    ("zt", "pos", "position", "readback", "rbk", "vp", "stem", "travel", "gt", "x", "zi", "lmnr",
     "lmnr_in", "stellungsrückmeldung", "stellungsrueckmeldung", "ventilstellung")
)  # fmt: skip
ASK_WORDS = frozenset(("mv", "cv"))
_WORDS = (
    dict.fromkeys(OUTPUT_WORDS, Role.OP)
    | dict.fromkeys(SETPOINT_WORDS, Role.SP)
    | dict.fromkeys(MEASURED_WORDS, Role.PV)
    | dict.fromkeys(MODE_WORDS, Role.MODE)
    | dict.fromkeys(POSITION_WORDS, Role.MV)
)
# Words of two parts, as Siemens' blocks have them, before the last part alone.
_TWO_PARTS = re.compile(r"^(?P<loop>.+)[./_\-: |](?P<word>(?:PV|LMNR)_IN)$", re.I)
_SPLIT = re.compile(r"^(?P<loop>.+)[./_\-: |](?P<word>[A-Za-zÄÖÜäöüß]+)$")
_GLUED = re.compile(r"^(?P<loop>.*[0-9])(?P<word>OP|CO|CV|PV|SP|SV|MV|ZT|X)$")
_PATH = re.compile(r"^(?P<loop>[^/]+)/(?P<block>[^/]+)/(?P<word>[A-Z_0-9]+)\.(?P<field>[A-Z]+)$")
_POSITION_BLOCK = re.compile(
    r"(?:^|[^A-Z])(?:ZT|ZI|ZIT|POS|POSN|POSITION|STEM|TRAVEL|READBACK|RBK)(?:$|[^A-Z])"
)
_POSITION_LOOP = re.compile(r"^(?P<area>.*?)(?P<letters>ZT|ZI|GT|ZIT)(?P<number>[-_ ]?[0-9]+\w*)$")
_LOOP = re.compile(r"^(?P<area>.*?)(?P<letters>[A-Z]{2,4})(?P<number>[-_ ]?[0-9]+[\w\-]*)$")


@dataclass(frozen=True)
class TagName:
    """``loop`` is empty where the tag is nothing but a role's word."""

    loop: str
    word: str  # lower case; empty where the tag ends in no word known here
    block: str = ""  # PID1, AI1, ... of a path

    @property
    def role(self) -> Role | None:
        """The role that the word alone would mean; never for MV and CV."""
        if self.block:
            return _block_role(self.block, self.word)
        return _WORDS.get(self.word)


def parse_tag(tag: str) -> TagName:
    """Loop and last word of a tag: ``FIC-101.OP``, ``FIC101/PV``, ``LC74_20X_pct``, ``OP``."""
    without_unit = split_unit(tag)[0].strip()
    path = _PATH.match(without_unit)
    if path:
        word = "mode" if path["word"] == "MODE" else path["word"].lower()
        return TagName(path["loop"], word, path["block"].upper())
    if _is_known_word(without_unit):
        return TagName("", without_unit.lower())
    for pattern in (_TWO_PARTS, _SPLIT, _GLUED):
        match = pattern.match(without_unit)
        if match and _is_known_word(match["word"]):
            return TagName(match["loop"], match["word"].lower())
    position = _POSITION_LOOP.match(without_unit)
    if position:
        return TagName(without_unit, "zt")
    return TagName("", "")


def _is_known_word(word: str) -> bool:
    return word.lower() in _WORDS or word.lower() in ASK_WORDS


def _block_role(block: str, word: str) -> Role | None:
    if word in ("out", "pv") and not block.startswith("PID") and _POSITION_BLOCK.search(block):
        return Role.MV
    if word == "out":
        if block.startswith("AI"):
            return Role.PV
        return Role.OP if block.startswith(("PID", "BLOCK", "AO", "OUT")) else None
    if block.startswith(("PID", "AI", "AO", "BLOCK")):
        return {"pv": Role.PV, "sp": Role.SP, "mode": Role.MODE, "readback": Role.MV}.get(word)
    return None


def is_position_transmitter(loop: str) -> bool:
    """Whether the letters of ``ZT-101`` say that its measured value is a position."""
    return _POSITION_LOOP.match(loop) is not None


def instrument(loop: str) -> str:
    """What the tags of one loop share whatever their function: ``FIC-400B`` and ``FIT-400B`` are
    both ``F-400B``. Empty where the name has no such form."""
    match = _LOOP.match(loop)
    if not match:
        return ""
    return f"{match['area']}{match['letters'][0]}{match['number']}"


def number(loop: str) -> str:
    """The number of a loop without its letters, to pair ``ZT-101`` with ``FIC-101``."""
    match = _LOOP.match(loop)
    return match["area"] + re.sub(r"^[-_ ]", "", match["number"]) if match else ""
