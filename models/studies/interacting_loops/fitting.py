"""Fit the limits and weights of ``models.oscillation_groups`` to drawn plants whose truth is
known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.stats import binom

from stemwatch.models.oscillation_groups.find_groups import candidate
from stemwatch.models.oscillation_groups.limits import (
    LIMITS,
    WEIGHTS,
    GroupLimits,
    SourceWeights,
)
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra, oscillations
from stemwatch.models.oscillation_groups.sources import (
    MemberEvidence,
    compared,
    member_evidence,
    of_none,
    without_connections,
)
from stemwatch.models.recording import Floats
from stemwatch.models.studies.interacting_loops.draws import RunPlant
from stemwatch.models.studies.interacting_loops.score_plant import PlantSuspicions

QUIET = 0.05  # of quiet plants may have a candidate that passes the limit
CERTAIN = 0.95  # that no more have, though only some were drawn
# Jaccard index with a true group, from which a candidate counts as one, and below which as none
_SAME, _OTHER = 0.4, 0.2
_RIDGE = 0.5
_NONE = -10.0  # the evidence in a plant without any candidate
_STICKING, _NEARNESS = 6, 7  # places in a member's weights
_OF_NONE_KNOWN = 5  # places of "none" that need no connections


@dataclass(frozen=True, kw_only=True)
class PlantEvidence:
    """The evidence from one plant. ``candidates`` (c, 4) are the statistics of each candidate that
    is no faint pair (``GroupLimits.pair_share``); ``alike`` (c,) its Jaccard index with the most
    similar true group; ``groups`` the evidence of
    the candidate most similar to each true group, and the true source (-1: outside).
    """

    quiet: bool
    candidates: Floats
    alike: Floats
    groups: tuple[tuple[MemberEvidence, int], ...]


def plant_evidence(plant: RunPlant) -> PlantEvidence:
    """The candidate groups of a plant before any group is removed from it."""
    errors = loop_spectra(plant.sp - plant.pv, plant.interval_s)
    pv = loop_spectra(plant.pv, plant.interval_s)
    outputs = loop_spectra(plant.op, plant.interval_s)
    suspicion, seen = PlantSuspicions(plant), oscillations(errors)
    label = np.array(plant.label)
    true = {row: set(np.flatnonzero(label == row).tolist()) for row in set(plant.label) - {-1}}
    rows, alike = [], []
    best: dict[int, tuple[float, MemberEvidence]] = {}
    for peak in seen:
        group = candidate(peak, errors, pv, errors.spectra, seen, LIMITS, suspicion)
        if group is None or group.weaker_of_two < LIMITS.pair_share:
            continue
        members = set(group.members)
        index = {row: len(members & of) / len(members | of) for row, of in true.items()}
        rows.append(group.statistics)
        alike.append(max(index.values(), default=0.0))
        for row, share in index.items():
            if share > max(_SAME, best.get(row, (0.0, None))[0]):
                shown = member_evidence(errors, outputs, group, suspicion, feeds=plant.feeds)
                best[row] = (share, shown)
    return PlantEvidence(
        quiet=not true,
        candidates=np.array(rows).reshape(-1, 4),
        alike=np.array(alike),
        groups=tuple((shown, plant.sources[row].loop) for row, (_, shown) in best.items()),
    )


def fit_limits(plants: Sequence[PlantEvidence], quiet: Sequence[PlantEvidence]) -> GroupLimits:
    """Weights by a logistic regression of true groups against false ones, with each plant's
    candidates weighted by one over their number; the limit (``limit_of``) from ``quiet`` plants,
    none of which took part in that.
    """
    rows = np.concatenate([plant.candidates for plant in plants])
    alike = np.concatenate([plant.alike for plant in plants])
    weigh = np.concatenate(
        [np.full(p.alike.size, p.alike.size**-0.5) for p in plants if p.alike.size]
    )
    told = (alike >= _SAME) | (alike < _OTHER)
    sign = np.where(alike >= _SAME, 1.0, -1.0)[told]

    def loss(weights: Floats) -> float:
        odds = sign * (rows[told] @ weights)
        return float(
            weigh[told] @ np.logaddexp(0.0, -odds) + _RIDGE * (weights[1:] @ weights[1:]) / 2.0
        )

    weights = minimize(loss, np.zeros(rows.shape[1])).x
    a, b, c, d = (round(float(weight), 2) for weight in weights)
    strongest = [float((plant.candidates @ (a, b, c, d)).max(initial=_NONE)) for plant in quiet]
    return replace(LIMITS, weights=(a, b, c, d), evidence=limit_of(np.array(strongest)))


def limit_of(strongest: Floats) -> float:
    """The least limit, to a hundredth, of which ``strongest``, the largest evidence in each of n
    quiet plants, lets us be ``CERTAIN`` that at most ``QUIET`` of all quiet plants pass it.

    As many of the n may pass as make a binomial count of no more, at the share ``QUIET``, no
    likelier than 1 - ``CERTAIN`` (Wilks 1941, doi:10.1214/aoms/1177731788; quoted from memory).
    Raises ``ValueError`` for fewer plants than let none pass.
    """
    may_pass = int(binom.ppf(1.0 - CERTAIN, strongest.size, QUIET)) - 1
    if may_pass < 0:
        raise ValueError(f"{strongest.size} quiet plants are too few for a limit: draw more")
    highest_that_may_not = float(np.sort(strongest)[::-1][may_pass])
    return (math.floor(100.0 * highest_that_may_not) + 1) / 100.0


def fit_sources(plants: Sequence[PlantEvidence]) -> SourceWeights:
    """Fit a multinomial logit without connections, then the weights of the connections on top of
    it.
    """
    groups = [group for plant in plants for group in plant.groups]
    members, none = np.array(WEIGHTS.member), np.array(WEIGHTS.none)
    members[_NEARNESS], none[_OF_NONE_KNOWN:] = 0.0, 0.0
    alone = [(without_connections(shown), source) for shown, source in groups]
    free = [i for i in range(members.size) if i not in (_STICKING, _NEARNESS)]
    _improve(members, none, free, [0, 1, 2, 3], alone)
    _improve(members, none, [_NEARNESS], [5, 6], groups)
    return SourceWeights(
        member=tuple(round(float(x), 2) for x in members),
        none=tuple(round(float(x), 2) for x in none),
    )


def _improve(
    members: Floats,
    none: Floats,
    of_member: list[int],
    of_none_: list[int],
    groups: Sequence[tuple[MemberEvidence, int]],
) -> None:
    """Fit some of the weights by maximum likelihood, in place, with the others fixed."""
    terms = [(compared(shown), of_none(shown), _place(shown, source)) for shown, source in groups]

    def loss(free: Floats) -> float:
        members[of_member], none[of_none_] = free[: len(of_member)], free[len(of_member) :]
        total = _RIDGE * float(free @ free) / 2.0
        for values, outside, place in terms:
            utility = np.append(values @ members, outside @ none)
            total += float(np.logaddexp.reduce(utility) - utility[place])
        return total

    loss(minimize(loss, np.zeros(len(of_member) + len(of_none_))).x)


def _place(shown: MemberEvidence, source: int) -> int:
    """The place of the source among the members; behind them where it is outside."""
    return shown.members.index(source) if source in shown.members else len(shown.members)
