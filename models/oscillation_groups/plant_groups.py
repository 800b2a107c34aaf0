"""From the recordings of a run to groups of loops that oscillate together, each with its source."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.oscillation_groups.find_groups import (
    FoundGroup,
    find_groups,
    strength_over_time,
)
from stemwatch.models.oscillation_groups.limits import LIMITS, WEIGHTS
from stemwatch.models.oscillation_groups.loop_spectra import LoopSpectra, loop_spectra
from stemwatch.models.oscillation_groups.sources import (
    NAMES,
    MemberEvidence,
    SourceRanking,
    compared,
    member_evidence,
    rank_sources,
)
from stemwatch.models.recording import Floats, Recording, Role

LONGEST = 8640  # samples of a loop that are kept: a day at 10 s
# What loops must have in common, or unrelated ones look alike: two hours at 10 s, from which on
# none of 80 sets of unrelated loops makes a group (2 do at 480 samples); at 1 s, where a record
# holds fewer swings, 3 of 20 sets do in twelve minutes and none in twenty-four
# (``python -m tests.benchmarks.bench_short_groups``).
FEWEST, SHORTEST_S = 720, 1440.0
WINDOWS = 24  # of the record, for each of which the strength is given
BANDS = 60  # of the heat map
_OVERLAP = 0.5  # of the shorter window, that loops were recorded together
_ACTIVE = 0.5  # of the usual strength, from which a group counts as oscillating
_SAID = 0.3  # of evidence above the group's mean, from which it is mentioned
Small = NDArray[np.float32]
NO_UNITS: Mapping[str, str] = MappingProxyType({})
NO_FEEDS: Mapping[str, Sequence[str]] = MappingProxyType({})

_WORDS = {
    "share": "this oscillation makes more of its movement than of the others'",
    "purity": "it has less movement of its own beside it than the others",
    "harmonics of PV": "its PV has more of the oscillation's harmonics",
    "harmonics of OP": "its OP has more of the oscillation's harmonics",
    "lead": "it wanders in phase before the others",
    "suspicion": "its OP and PV look more like a sticking valve than those of the others",
    "sticking": "its valve sticks by its measured position",
    "nearness": "by the connections in the plant file it acts on the others more directly",
}


@dataclass(frozen=True, kw_only=True)
class ThinnedLoop:
    """OP, PV and SP (n,) of one loop, thinned to ``LONGEST`` samples by means over blocks; NaN
    where there is none. ``sticks`` by a measured position, ``score`` of sticking by OP and PV alone
    (0 to 1); ``None`` where it is not known."""

    loop: str
    source: str
    start: datetime | None
    interval_s: float
    op: Small
    pv: Small
    sp: Small
    sticks: bool | None = None
    score: float | None = None


@dataclass(frozen=True, kw_only=True)
class GroupMember:
    """A loop of a group: the share of its PV's variance that the oscillation makes, the probability
    that it begins here, and the evidence for that.
    """

    loop: str
    share: float
    probability: float
    evidence: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class OscillationGroup:
    """Loops that oscillate together, the likeliest source first.

    ``outside`` is the probability that it begins in none of them. ``strength`` (24,) over the
    record, its mean square 1; ``since`` the start of the window from which on it oscillates,
    ``None`` where it always did or the source has no dates. ``spectra`` (members, 60) powers on
    ``periods_s`` (60,), each loop's largest 1. ``windows`` in which the same oscillation was found,
    this one included; ``first_found`` the start of the first of them, ``None`` where it is this.
    """

    period_s: float
    members: tuple[GroupMember, ...]
    outside: float
    regularity: float
    start: datetime | None
    duration_s: float
    since: datetime | None
    strength: tuple[float, ...]
    periods_s: tuple[float, ...]
    spectra: tuple[tuple[float, ...], ...]
    windows: int = 1
    first_found: datetime | None = None

    @property
    def source(self) -> str:
        """The loop in which it most likely begins; empty where none of them is."""
        first = self.members[0]
        return "" if self.outside > first.probability else first.loop

    @property
    def variance_share(self) -> float:
        """The mean share of the members' variance that the oscillation makes."""
        return float(np.mean([member.share for member in self.members]))


def _are_enough(samples: int, interval_s: float) -> bool:
    return samples >= FEWEST and samples * interval_s >= SHORTEST_S


def thinned_loop(
    recording: Recording, sticks: bool | None = None, score: float | None = None
) -> ThinnedLoop | None:
    """The signals of a recording for the search; ``None`` without PV or with too few samples."""
    pv, sp = recording.get(Role.PV), recording.get(Role.SP)
    if pv is None or not _are_enough(len(recording), recording.interval_s):
        return None
    stride = -(-len(recording) // LONGEST)
    same_unit = sp is not None and sp.unit == pv.unit
    none = np.full(len(recording), np.nan)

    def thinned(values: Floats, usable: NDArray[np.bool_]) -> Small:
        return _means_of_finite(np.where(usable, values, np.nan), stride).astype(np.float32)

    return ThinnedLoop(
        loop=recording.valve,
        source=recording.provenance.source,
        start=recording.start,
        interval_s=recording.interval_s * stride,
        op=thinned(recording.op.values, recording.op.usable),
        pv=thinned(pv.values, pv.usable),
        sp=thinned(sp.values, sp.usable) if same_unit and sp is not None else none[:0].astype("f4"),
        sticks=sticks,
        score=score,
    )


def _means_of_finite(values: Floats, stride: int) -> Floats:
    """(n // stride,) means of the finite values of each block; NaN where a block has none."""
    if stride == 1:
        return values
    blocks = values[: values.size // stride * stride].reshape(-1, stride)
    finite = np.isfinite(blocks)
    total = np.where(finite, blocks, 0.0).sum(axis=1)
    count = finite.sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def plant_groups(
    loops: Iterable[ThinnedLoop],
    units: Mapping[str, str] = NO_UNITS,
    feeds: Mapping[str, Sequence[str]] = NO_FEEDS,
) -> list[OscillationGroup]:
    """The groups of all loops, those that move most loops first. Loops are compared where they were
    recorded together; where nothing dates them, within one file. ``units`` has the unit of the
    plant that a loop is in, where that is known: loops of one unit are neighbours; ``feeds`` the
    loops that a loop acts on."""
    groups: list[OscillationGroup] = []
    for recorded_together in _recorded_together(list(loops)):
        groups += _groups_of(recorded_together, units, feeds)
    return sorted(groups, key=lambda group: -sum(member.share for member in group.members))


def _recorded_together(loops: Sequence[ThinnedLoop]) -> list[list[ThinnedLoop]]:
    """Loops whose windows overlap, or, undated, of one source and length; each loop once."""
    undated: dict[tuple[str, int, float], list[ThinnedLoop]] = defaultdict(list)
    dated: list[tuple[list[ThinnedLoop], datetime, datetime]] = []
    for loop in sorted(
        loops, key=lambda recorded_loop: (str(recorded_loop.start), recorded_loop.loop)
    ):
        if loop.start is None:
            undated[(loop.source, loop.pv.size, loop.interval_s)].append(loop)
            continue
        end = loop.start + timedelta(seconds=loop.pv.size * loop.interval_s)
        for index, (members, first, last) in enumerate(dated):
            begin, stop = max(first, loop.start), min(last, end)
            if stop - begin >= _OVERLAP * min(last - first, end - loop.start) and stop > begin:
                dated[index] = ([*members, loop], begin, stop)
                break
        else:
            dated.append(([loop], loop.start, end))
    groups = [members for members, _, _ in dated] + list(undated.values())
    return [
        members for members in groups if len({recorded_loop.loop for recorded_loop in members}) > 1
    ]


def _groups_of(
    loops: Sequence[ThinnedLoop], units: Mapping[str, str], feeds: Mapping[str, Sequence[str]]
) -> list[OscillationGroup]:
    loops = list({recorded_loop.loop: recorded_loop for recorded_loop in loops}.values())
    interval_s = max(recorded_loop.interval_s for recorded_loop in loops)
    starts = [recorded_loop.start for recorded_loop in loops if recorded_loop.start is not None]
    start = max(starts) if starts else None
    rows: dict[str, list[Small]] = {"op": [], "pv": [], "sp": []}
    for recorded_loop in loops:
        for name in rows:
            values = getattr(recorded_loop, name)
            values = values if values.size else np.full(recorded_loop.pv.size, np.nan, np.float32)
            rows[name].append(_on_clock(values, recorded_loop, start, interval_s))
    size = min(row.size for row in rows["pv"])
    if not _are_enough(size, interval_s):
        return []
    # One signal after the other: of a thousand loops each takes tens of MB, its spectra twice that.
    outputs = loop_spectra(np.array([row[:size] for row in rows.pop("op")]), interval_s)
    pv = np.array([row[:size] for row in rows.pop("pv")])
    measured = loop_spectra(pv, interval_s)
    sp = np.array([row[:size] for row in rows.pop("sp")], dtype=np.float64)
    sp[~np.isfinite(sp)] = 0.0
    spectra = loop_spectra(sp - pv, interval_s)
    del rows, pv, sp
    suspicion = {i: log_odds(loop.score) for i, loop in enumerate(loops) if loop.score is not None}
    acts_on = _by_number(loops, feeds)
    groups = []
    for group in find_groups(spectra, measured, LIMITS, suspicion):
        evidence = member_evidence(
            spectra,
            outputs,
            group,
            suspicion,
            lambda i: _as_number(loops[i].sticks),
            acts_on,
        )
        names = {i: loops[i].loop for i in group.members}
        groups.append(_group_result(spectra, group, evidence, names, start, units))
    return groups


def _as_number(sticks: bool | None) -> float | None:
    return None if sticks is None else float(sticks)


def _on_clock(values: Small, loop: ThinnedLoop, start: datetime | None, interval_s: float) -> Small:
    """The values on the common clock: the last one before each instant."""
    offset = 0.0 if start is None or loop.start is None else (start - loop.start).total_seconds()
    count = int((values.size * loop.interval_s - offset) // interval_s)
    sample_index = ((offset + np.arange(max(count, 0)) * interval_s) / loop.interval_s).astype(
        np.int64
    )
    return np.asarray(values[np.minimum(sample_index, values.size - 1)])


def log_odds(score: float) -> float:
    """Of a score of 0 to 1, at most 5 either way."""
    return float(np.clip(np.log((score + 1e-3) / (1.0 - score + 1e-3)), -5.0, 5.0))


def _by_number(
    loops: Sequence[ThinnedLoop], feeds: Mapping[str, Sequence[str]]
) -> dict[int, list[int]]:
    """Which loops each loop acts on, by their index in ``loops``; other loops of the plant, through
    which paths may lead, have higher indices.
    """
    places = {loop.loop: i for i, loop in enumerate(loops)}
    for name, fed in feeds.items():
        for each in (name, *fed):
            places.setdefault(each, len(places))
    return {places[name]: [places[each] for each in fed] for name, fed in feeds.items() if fed}


def _group_result(
    spectra: LoopSpectra,
    group: FoundGroup,
    evidence: MemberEvidence,
    names: Mapping[int, str],
    start: datetime | None,
    units: Mapping[str, str],
) -> OscillationGroup:
    ranking = rank_sources(evidence, WEIGHTS)
    shares = dict(zip(group.members, group.shares, strict=True))
    sentences = evidence_sentences(evidence, ranking)
    strength, _ = strength_over_time(spectra, group, WINDOWS)
    duration_s = spectra.size * spectra.interval_s
    periods = np.geomspace(
        4.0 * spectra.interval_s, max(duration_s / 8.0, 5.0 * spectra.interval_s), BANDS + 1
    )
    return OscillationGroup(
        period_s=group.period_s,
        members=tuple(
            GroupMember(
                loop=names[i],
                share=min(shares[i], 1.0),
                probability=p,
                evidence=(
                    *sentences.get(i, ()),
                    *(_neighbours(names, i, units) if i in sentences else ()),
                ),
            )
            for i, p in zip(ranking.members, ranking.probability, strict=True)
        ),
        outside=ranking.none,
        regularity=group.regularity,
        start=start,
        duration_s=duration_s,
        since=_since(strength, start, duration_s),
        strength=tuple(round(float(number), 3) for number in strength),
        periods_s=tuple(float(x) for x in np.sqrt(periods[1:] * periods[:-1])),
        spectra=tuple(_bands(spectra, i, periods) for i in ranking.members),
    )


def evidence_sentences(
    evidence: MemberEvidence, ranking: SourceRanking
) -> dict[int, tuple[str, ...]]:
    """The evidence for each of the first two, the weightiest first."""
    # Evidence with a negative weight is used but not mentioned.
    weighed = compared(evidence) * np.maximum(WEIGHTS.member, 0.0)
    out = {}
    for i in ranking.members[:2]:
        place = evidence.members.index(i)
        row = weighed[place].copy()
        if evidence.values[place, NAMES.index("sticking")] <= 0.0:
            # Ahead of valves that do not stick is also one of which nothing is known.
            row[NAMES.index("sticking")] = 0.0
        order = np.argsort(-row)
        out[i] = tuple(_WORDS[NAMES[k]] for k in order[:3] if row[k] >= _SAID)
    return out


def _neighbours(names: Mapping[int, str], member: int, units: Mapping[str, str]) -> tuple[str, ...]:
    """That other loops of the group are in its unit, which an oscillation that begins there reaches
    first.
    """
    unit = units.get(names[member], "")
    others = [units.get(name, "") for i, name in names.items() if i != member]
    near = sum(one == unit for one in others)
    if not unit or not near:
        return ()
    if near == len(others):
        which = {1: "the other loop is", 2: "both other loops are"}.get(
            near, f"all {near} other loops are"
        )
    else:
        which = f"{near} of the {len(others)} other loops {'is' if near == 1 else 'are'}"
    return (f"{which} of its unit {unit}",)


def _since(strength: Floats, start: datetime | None, duration_s: float) -> datetime | None:
    """When the group began, where it did not oscillate before and has not stopped."""
    active = strength >= _ACTIVE
    if start is None or active.all() or not active[-1]:
        return None
    first = int(np.flatnonzero(~active)[-1]) + 1
    return start + timedelta(seconds=first * duration_s / strength.size)


def _bands(spectra: LoopSpectra, loop: int, periods: Floats) -> tuple[float, ...]:
    power = np.abs(spectra.spectra[loop]) ** 2
    total = np.concatenate([[0.0], np.cumsum(power)])
    edges = np.searchsorted(spectra.frequencies, 1.0 / periods)
    bands = total[edges[:-1]] - total[edges[1:]]
    return tuple(round(float(x), 3) for x in bands / max(float(bands.max()), 1e-30))
