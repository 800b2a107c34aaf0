"""How numbers, times and verdicts are written for a reader."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta, tzinfo
from typing import TYPE_CHECKING

from stemwatch.models.estimate import Estimate
from stemwatch.models.verdict import Verdict

if TYPE_CHECKING:
    from stemwatch.models.recording import Role  # loads NumPy

NOTHING = "–"

# A symbol beside each word, so that no meaning depends on colour alone.
VERDICT_SYMBOL = {
    Verdict.STICKY: "■",
    Verdict.DEFECTIVE: "◆",
    Verdict.WATCH: "▲",
    Verdict.UNDETERMINED: "?",
    Verdict.HEALTHY: "✓",
}
VERDICT_MEANING = {
    Verdict.STICKY: "the stem sticks; plan the work",
    Verdict.DEFECTIVE: "the stem does not stick, but something else is wrong; plan the work",
    Verdict.WATCH: "some sticking; look again soon",
    Verdict.UNDETERMINED: "the recording does not allow a verdict; the reason is given",
    Verdict.HEALTHY: "the stem follows the controller",
}

# What follows once work on a valve is recorded; a baseline is a model of how MV follows OP.
AFTER_WORK = (
    "From then on the old baseline counts as one from before the work. The first window that "
    "begins after it becomes the new baseline and shows whether the work helped."
)
AFTER_WORK_WITHOUT_POSITION = (
    "The first window that begins after the work shows whether OP and PV still look like a valve "
    "that sticks. There is no baseline without a measured position."
)

COMMAND = re.compile("`(stemwatch [^`]*)`")  # as sentences mark it

_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def printable(text: str) -> str:
    """``text`` with control characters and lone surrogates (undecodable file names) as U+FFFD.

    HTML, XLSX and UTF-8 each refuse some of them; a report must not fail on a tag's spelling.
    """
    return _UNPRINTABLE.sub("�", str(text))


def after_work(has_position: bool) -> str:
    """What follows once work on a valve is recorded."""
    return AFTER_WORK if has_position else AFTER_WORK_WITHOUT_POSITION


def finite(value: float | None) -> float | None:
    """``value`` as a plain float, or ``None`` where it is missing, NaN or infinite."""
    if value is None or not math.isfinite(value):
        return None
    return float(value)


def sortable(value: float | None) -> str:
    """A number as a script compares it; empty, and so last, where there is none."""
    number = finite(value)
    return "" if number is None else repr(number)


def figure(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits and no exponent in the everyday range."""
    number = finite(value)
    if number is None:
        return NOTHING
    if number == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(number)))
    if magnitude < -5 or magnitude > 9:
        return f"{number:.{digits - 1}e}".replace("-", "−")
    return f"{number:.{max(0, digits - 1 - magnitude)}f}".replace("-", "−")


def span_percent(value: float | None) -> str:
    """S and J: two decimals below ten, one above, so that a column of them lines up."""
    number = finite(value)
    if number is None:
        return NOTHING
    return f"{number:.2f}" if abs(number) < 10 else f"{number:.1f}"


def share(value: float | None) -> str:
    """A share of one as whole percent."""
    number = finite(value)
    # A rounded 0.0 has a sign of its own; adding zero takes it away.
    return NOTHING if number is None else f"{round(100 * number) + 0:d} %".replace("-", "−")


def interval(estimate: Estimate) -> str:
    """The 95 % interval in words, empty where there is none."""
    low, high = finite(estimate.low), finite(estimate.high)
    if low is None or high is None:
        return ""
    return f"{span_percent(low)} to {span_percent(high)}"


def instant(moment: datetime | None, zone: tzinfo) -> str:
    """A time to the minute in ``zone``, which the caller names; with its offset where clocks show
    that minute twice, when summer time ends."""
    if moment is None:
        return NOTHING
    local = moment.astimezone(zone)
    is_twice = local.replace(fold=0).utcoffset() != local.replace(fold=1).utcoffset()
    offset = f" UTC{local.isoformat()[-6:]}" if is_twice else ""
    return f"{local:%Y-%m-%d %H:%M}{offset}"


def prose(text: str) -> str:
    """A sentence whose percent signs stay on the line of their number."""
    return re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", printable(text))


def commands_quoted(text: str) -> str:
    """``text`` with its commands between quotation marks, for paper, where ` means nothing."""
    return COMMAND.sub(r"“\1”", text)


def not_yet_said(sentences: Iterable[str], text: str) -> list[str]:
    """Those of ``sentences`` that ``text`` does not already contain, word for word."""
    text_folded = text.casefold()
    return [
        sentence for sentence in sentences if sentence.strip(" .").casefold() not in text_folded
    ]


def as_sentences(remarks: Iterable[str]) -> str:
    """Remarks as running text: each a sentence, with a capital unless it begins with a tag."""
    text = (remark.strip().rstrip(".") for remark in remarks)
    return " ".join(
        f"{said[:1].upper() if said.partition(' ')[0].isalpha() else said[:1]}{said[1:]}."
        for said in text
        if said
    )


def duration(seconds: float) -> str:
    """A duration in the one or two units in which people say it; a setting's round number stays
    one (60 s, 2.5 min).
    """
    if seconds < 120:
        return f"{seconds:.0f} s" if seconds == round(seconds) else f"{figure(seconds)} s"
    if seconds < 600 and round(seconds) % 60:
        return f"{figure(seconds / 60.0, 2)} min"
    rounded = timedelta(seconds=round(seconds))
    hours, minutes = rounded.seconds // 3600, rounded.seconds % 3600 // 60
    if rounded.days:
        return f"{rounded.days} d {hours} h" if hours else f"{rounded.days} d"
    if hours:
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    return f"{minutes} min"


def window(start: datetime | None, end: datetime | None, zone: tzinfo, zone_name: str) -> str:
    """A window in the plant's zone, the second date left out where it is the first's."""
    if start is None or end is None:
        return "time of day not known"
    first, last = instant(start, zone), instant(end, zone)
    if first[:10] == last[:10]:
        last = last[11:]
    return f"{first} to {last} ({zone_name})"


def signals_read(tags: Mapping[Role, str]) -> str:
    """The tags that were read and what was not, because numbers change with it: PV and set point
    tell where OP was within its recorder's steps. Empty where nothing was read."""
    if not tags:
        return ""
    read = [f"{role.value.upper()} {tag}" for role, tag in tags.items()]
    missing = [name.upper() for name in ("pv", "sp") if name not in tags]
    return f"read: {', '.join(read)}" + (f"; without {' and '.join(missing)}" if missing else "")
