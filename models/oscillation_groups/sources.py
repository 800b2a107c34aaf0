"""Where the oscillation of a group likely begins: each member's evidence and its weights.

The loop in which an oscillation begins shows more of it and more of its harmonics (each process on
the way is a low pass), has the least other noise, and leads the others in phase. Where its valve
sticks, its OP and PV show signs of it. It acts on the others rather than they on it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from stemwatch.models.oscillation_groups.find_groups import FoundGroup
from stemwatch.models.oscillation_groups.limits import SourceWeights
from stemwatch.models.oscillation_groups.loop_spectra import LoopSpectra
from stemwatch.models.recording import Floats

NAMES = (
    "share",
    "purity",
    "harmonics of PV",
    "harmonics of OP",
    "lead",
    "suspicion",
    "sticking",
    "nearness",
)
_HARMONICS = (2, 3, 4, 5)
_MOST_LEAD = 2.0  # periods
NO_CONNECTIONS: Mapping[int, Sequence[int]] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class MemberEvidence:
    """(k, 8) the evidence for each member, in the order of ``NAMES``, before comparison with the
    others.

    ``connected`` is whether connections of these loops are known; ``at_rest`` has the members whose
    controller does not take part: its output moves less often than the oscillation turns.
    """

    members: tuple[int, ...]
    values: Floats
    connected: bool = False
    at_rest: frozenset[int] = frozenset()


@dataclass(frozen=True, kw_only=True)
class SourceRanking:
    """``members``, the likeliest source first, with the ``probability`` of each; ``none`` of the
    oscillation coming from outside these loops."""

    members: tuple[int, ...]
    probability: tuple[float, ...]
    none: float

    @property
    def outside(self) -> bool:
        """Whether no loop of the group is likelier than a cause outside."""
        return self.none > max(self.probability, default=0.0)


def member_evidence(
    errors: LoopSpectra,
    outputs: LoopSpectra,
    group: FoundGroup,
    suspicion: Mapping[int, float],
    sticking: Callable[[int], float | None] = lambda _: None,
    feeds: Mapping[int, Sequence[int]] = NO_CONNECTIONS,
) -> MemberEvidence:
    """The evidence of each member. ``suspicion`` has the log odds that a loop's valve sticks by its
    OP and PV; ``sticking`` gives 1 where a measured position says that it does, 0 where it says
    that it does not; ``feeds`` the loops that each loop acts on."""
    members = list(group.members)
    coherence = np.clip(np.array(group.coherence), 0.0, 0.9999)
    sticking_of_each = [sticking(loop) for loop in members]
    near = nearness(feeds, members, group.shares)
    values = np.stack(
        [
            np.log(np.array(group.shares)),
            -np.log(1.0 - coherence**2),
            _harmonics(errors, group, members),
            _harmonics(outputs, group, members),
            _lead(errors, group, members),
            np.array([suspicion.get(loop, 0.0) for loop in members]),
            np.array(
                [
                    0.0 if probability is None else 2.0 * probability - 1.0
                    for probability in sticking_of_each
                ]
            ),
            near,
        ],
        axis=1,
    )
    at_rest = outputs.moves[members] < errors.size * errors.interval_s / group.period_s
    if at_rest.any() and not at_rest.all():
        # An OP that does not move has no harmonics: it must not make those of others look strong.
        of_output = NAMES.index("harmonics of OP")
        values[at_rest, of_output] = values[~at_rest, of_output].mean()
    return MemberEvidence(
        members=group.members,
        values=values,
        connected=bool(near.any()),
        at_rest=frozenset(np.array(members)[at_rest].tolist()),
    )


def nearness(
    feeds: Mapping[int, Sequence[int]], members: Sequence[int], shares: Sequence[float]
) -> Floats:
    """(k,) how directly each member acts on the others: the mean of one over the number of
    connections on the way to each, 0 where there is no way, weighed by what the oscillation makes
    of it. 1 acts on all others at once; the ways may pass through loops that do not oscillate."""
    out = np.zeros(len(members))
    if not feeds:
        return out
    for place, member in enumerate(members):
        steps, waiting = {member: 0}, deque([member])
        while waiting:
            loop = waiting.popleft()
            for fed in feeds.get(loop, ()):
                if fed not in steps:
                    steps[fed] = steps[loop] + 1
                    waiting.append(fed)
        others = [(share, steps.get(other, 0)) for share, other in
                  zip(shares, members, strict=True) if other != member]  # fmt: skip
        near = sum(share / count for share, count in others if count)
        out[place] = near / max(sum(share for share, _ in others), 1e-12)
    return out


def _harmonics(spectra: LoopSpectra, group: FoundGroup, members: Sequence[int]) -> Floats:
    """Amplitude of what is bound to the reference's phase at 2 to 5 times its frequency, over that
    of the fundamental; log."""
    wave = spectra.time(group.reference[None, :], group.band)[0]
    size = np.abs(wave)
    turn = wave / np.maximum(size, 1e-30)
    bound = np.zeros(len(members))
    first = np.abs(spectra.spectra[members][:, group.band] @ group.reference.conj())
    for k in _HARMONICS:
        low, high = (k * group.frequency * (1.0 + side * 0.25 / k) for side in (-1.0, 1.0))
        if high >= spectra.frequencies[-1]:
            break
        band = spectra.within(low, high)
        line = np.fft.fft(size * turn**k)[band]
        line /= max(float(np.linalg.norm(line)), 1e-30)
        bound += np.abs(spectra.spectra[members][:, band] @ line.conj()) ** 2
    return np.asarray(np.log(0.01 + np.sqrt(bound) / np.maximum(first, 1e-6)))


def _lead(spectra: LoopSpectra, group: FoundGroup, members: Sequence[int]) -> Floats:
    """By how many periods the phase variations of a member lead those of the others: the delay at
    which its band agrees best with the reference's. The sign does not depend on gains.
    """
    cross = spectra.spectra[members][:, group.band] * group.reference.conj()
    delays = np.linspace(-_MOST_LEAD, _MOST_LEAD, 81)
    turns = np.exp(2j * np.pi * np.outer(spectra.frequencies[group.band] / group.frequency, delays))
    delay = delays[np.abs(cross @ turns).argmax(axis=1)]
    return np.asarray(np.median(delay) - delay)


def rank_sources(evidence: MemberEvidence, weights: SourceWeights) -> SourceRanking:
    """The members in the order of their probability of being the source, and the probability of
    none.

    Probabilities are those of a multinomial logit over the members and "none". Nothing begins in a
    loop whose controller is at rest, in manual or at its limit: neither its valve nor its tuning
    can be the cause. What it shows came from elsewhere, so that its probability is that of none.
    """
    utility = np.append(
        compared(evidence) @ np.array(weights.member), of_none(evidence) @ np.array(weights.none)
    )
    odds = np.exp(utility - utility.max())
    odds /= odds.sum()
    still = np.append([member in evidence.at_rest for member in evidence.members], False)
    odds[-1] += odds[still].sum()
    odds[still] = 0.0
    order = np.argsort(-odds[:-1], kind="stable")
    return SourceRanking(
        members=tuple(evidence.members[i] for i in order),
        probability=tuple(float(odds[i]) for i in order),
        none=float(odds[-1]),
    )


def compared(evidence: MemberEvidence) -> Floats:
    """(k, 8) each member's evidence above the mean of the group."""
    return np.asarray(evidence.values - evidence.values.mean(axis=0))


def without_connections(evidence: MemberEvidence) -> MemberEvidence:
    """The evidence without connections, as where none are known."""
    values = evidence.values.copy()
    values[:, NAMES.index("nearness")] = 0.0
    return replace(evidence, values=values, connected=False)


def of_none(evidence: MemberEvidence) -> Floats:
    """(7,) the evidence for a source outside the group."""
    values = evidence.values
    return np.array(
        [
            1.0,
            np.log(len(evidence.members)),
            values[:, 2].max(),
            values[:, 5].max(),
            values[:, 6].max(),
            float(evidence.connected),
            values[:, 7].max(),
        ]
    )
