"""How sure a finding is: its interval, its confidence, how often it was seen, how often such
findings are wrong, and whether it stands among all valves of the run."""

from __future__ import annotations

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.since import Since
from stemwatch.service.report.discoveries import LEVEL_PERCENT, Discoveries
from stemwatch.service.report.words import share

# Counted on simulated valves that took no part in choosing the limits: the tables "How often is it
# right?" and "Does it name the right physics?" of the README, which a test compares.
FALSE_STICKY = (1, 240, "0.1 to 2.3 %")
FALSE_EFFECT = (0, 52, "0 to 6.9 %")
FALSE_EFFECT_SCATTERED = (3, 64, "1.6 to 13 %")


def how_sure(
    screening: Screening, stands: bool | None, found: Discoveries, seen: Since
) -> tuple[str, ...]:
    """One sentence for each source of doubt, the nearest first."""
    said = [_confidence(screening), _seen(seen), _wrong_of_sticky(screening)]
    if stands is not None:
        said.append(_standing(stands, found))
        said.append(_rate("simulated valves with nothing hidden, yet named", *FALSE_EFFECT))
        said.append(_rate("the same with a stickband that scatters", *FALSE_EFFECT_SCATTERED))
    said.append(_data(screening))
    return tuple(one for one in said if one)


def _confidence(screening: Screening) -> str:
    if screening.confidence is None:
        return ""
    return f"Confidence in the verdict {screening.verdict.value}: {share(screening.confidence)}."


def _seen(seen: Since) -> str:
    if seen.count == 1:
        return "One screening shows it; a second one would make it firmer."
    return f"{seen.count} screenings on end show it."


def _wrong_of_sticky(screening: Screening) -> str:
    if screening.verdict is not Verdict.STICKY:
        return ""
    return _rate("simulated healthy valves, called sticky", *FALSE_STICKY)


def _rate(what: str, count: int, of: int, interval: str) -> str:
    return (
        f"Published false alarms: {what}: {count} of {of} ({100 * count / of:.1f} %, {interval})."
    )


def _standing(stands: bool, found: Discoveries) -> str:
    if not stands:
        return found.remark
    return (
        f"What is named beside friction stands among all valves of the run: of such findings at "
        f"most {LEVEL_PERCENT} are expected to be due to chance."
    )


def _data(screening: Screening) -> str:
    quality = screening.quality
    remarks = " ".join(quality.reasons)
    return f"Data grade {quality.grade}{': ' + remarks if remarks else '.'}"
