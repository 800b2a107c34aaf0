"""The evidence of many windows of one valve together: which effects are confirmed, and S and J
pooled.

The unit of evidence is the window: each is a search of its own, so that a poor optimum spoils one
window only. Gains are not added up, because their biases would add up too.

    first seen   one window has named the effect
    confirmed    two of the last ``MEMORY`` windows name it (they agree), or one names it and those
                 of the others that name nothing gain by it together
    standing     confirmed before, and still so
    gone         confirmed before, and now so many windows on end neither name it nor gain by it
                 as chance would leave out once in twenty, given how often it was named

With mean gains m_i and t values t_i of the n windows that name nothing (``EffectScore``), they
confirm it where

    sum(m_i) / n >= LEAST_MEAN    and    sum(t_i) / sqrt(n) >= LEAST_T

the second as Stouffer et al. (1949) combine tests. Effects that chance names more often (``HARDER``
in ``mismatch.acceptance_limits``: play, and dwell, which scatter of the breakaways imitates) need
one window more: three that agree, or two and the others. An effect of friction itself counts as
absent in a window whose S is below half of that in the windows with the effect. After work on the
valve, or a change that a window itself shows (``begins_anew``), the evidence starts afresh.

`stemwatch prove-weeks` measures how often this is wrong: it counts valves with nothing hidden on
which an effect is confirmed within 30 daily windows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum

import numpy as np

from stemwatch.models.estimate import NORMAL_95, Estimate
from stemwatch.models.mismatch.acceptance_limits import HARDER, NULL_RATE
from stemwatch.models.mismatch.findings import Effect, EffectScore, Mismatch, Stiction
from stemwatch.models.recording import PERCENT, Floats

MEMORY = 8  # windows that count; AGREE of them must agree
AGREE = 2
LEAST_MEAN, LEAST_T = 0.02, 1.2
FEWEST_OTHERS = 3  # windows that can confirm what one has named
LEFT_OUT_BY_CHANCE = 0.05
# Effects of friction itself: on a valve that sticks they have the same cause as S and J.
OF_FRICTION = frozenset(
    {
        "asymmetric_slip",
        "dwell_dependent_breakaway",
        "growing_stiction",
        "low_speed_restick",
        "position_dependent_friction",
        "slip_overshoot",
    }
)
FRICTION_GONE = 0.5  # of S in the windows that name such an effect: with less it cannot be there
FEWEST_WITHOUT = 3  # consecutive windows without it, before a confirmed effect is gone
# The part of one window's error that all windows share, because no stem is exactly the element.
# With it 66 of 66 pooled intervals of simulated valves on which an effect holds, 8 windows each,
# hold the truth in routine records, and 106 of 118 in those of all kinds; with 0.7 66 and 100
# (development seeds 4065 and 4066).
SHARED = 0.9


class FindingState(StrEnum):
    """Where a finding stands after the last window."""

    FIRST_SEEN = "first seen"
    CONFIRMED = "confirmed"
    STANDING = "standing"
    GONE = "gone"


@dataclass(frozen=True, kw_only=True)
class WindowEvidence:
    """The evidence of one window of a valve; ``at`` is its end, ``start`` its beginning where
    known.

    ``named`` has the class of each named defect: its slug, then those that the window could not
    separate from it. ``sizes`` are its numbers, as far as they are known, by slug and name.
    ``scores`` are those of all effects that it could have shown, named or not. ``S`` and ``J`` are
    restated with the named effects, percent of OP span; ``p_value`` is the probability of an effect
    of this strength on a valve with nothing hidden. ``begins_anew`` says why earlier windows do not
    describe this valve any more; empty where they do.
    """

    at: datetime
    start: datetime | None = None
    named: tuple[tuple[str, ...], ...] = ()
    sizes: Mapping[tuple[str, str], Estimate] = field(default_factory=dict)
    scores: tuple[EffectScore, ...] = ()
    S: Estimate | None = None
    J: Estimate | None = None
    p_value: float | None = None
    begins_anew: str = ""

    @classmethod
    def of(
        cls,
        mismatch: Mismatch,
        at: datetime,
        *,
        start: datetime | None = None,
        begins_anew: str = "",
        effects: Sequence[Effect] | None = None,
    ) -> WindowEvidence:
        """The evidence of a window that ended ``at``, from what was found in it: of its defects, or
        of the named ``effects`` that are given."""
        followed = mismatch.defects if effects is None else effects
        return cls(
            at=at,
            start=start,
            named=tuple(
                (effect.slug, *(slug for slug in effect.members if slug != effect.slug))
                for effect in followed
            ),
            sizes={
                (effect.slug, name): size
                for effect in followed
                for name, size in effect.parameters.items()
                if size.value is not None
            },
            scores=mismatch.scores,
            S=mismatch.restated.S,
            J=mismatch.restated.J,
            p_value=mismatch.p_value,
            begins_anew=begins_anew,
        )

    def names(self, slug: str) -> bool:
        """Whether it names the effect, or one that it cannot separate from it."""
        return any(slug in members for members in self.named)

    def score(self, slug: str) -> EffectScore | None:
        """The effect's score; ``None`` where the window could not have shown it."""
        return next((score for score in self.scores if score.slug == slug), None)

    def looked_for(self, slug: str) -> bool:
        """Whether the window could have shown the effect."""
        return self.names(slug) or self.score(slug) is not None


@dataclass(frozen=True, kw_only=True)
class LastingFinding:
    """One effect over the windows of a valve.

    ``named`` of ``of`` windows, the last ``MEMORY`` that could have shown it, name it. ``mean`` and
    ``t`` are the combined gain by it in those that name nothing; ``None`` where these are too few.
    ``confirmed`` is when it was last confirmed anew, ``None`` where it never was. ``p_value`` is
    the probability that as many windows name it as strongly on a valve with nothing hidden.
    """

    slug: str
    state: FindingState
    first_seen: datetime
    last_seen: datetime
    confirmed: datetime | None
    named: int
    of: int
    mean: float | None = None
    t: float | None = None
    p_value: float = 1.0

    @property
    def holds(self) -> bool:
        """Whether it is confirmed now."""
        return self.state in (FindingState.CONFIRMED, FindingState.STANDING)


def windows_that_count(windows: Iterable[WindowEvidence]) -> list[WindowEvidence]:
    """The windows in order of time since the last one that ``begins_anew``, that one included.
    Windows that share samples with an earlier one are left out: the same minutes are not evidence
    twice.
    """
    separate: list[WindowEvidence] = []
    for window in sorted(windows, key=lambda window: window.at):
        if window.begins_anew:
            separate = []
        if not separate or window.start is None or window.start >= separate[-1].at:
            separate.append(window)
    return separate


def lasting_findings(windows: Iterable[WindowEvidence]) -> tuple[LastingFinding, ...]:
    """Every effect that some window since the last new beginning has named, those that hold first.
    ``windows_that_count`` decides which windows count.

    A window that names one of several effects that it cannot separate counts for the one that most
    windows name, and for no other.
    """
    ordered = windows_that_count(windows)
    findings = [_followed(slug, ordered) for slug in _slugs_followed(ordered)]
    order = list(FindingState)
    return tuple(
        sorted(
            (finding for finding in findings if finding is not None),
            key=lambda finding: (
                not finding.holds,
                order.index(finding.state),
                -finding.named,
                finding.slug,
            ),
        )
    )


def _slugs_followed(windows: Sequence[WindowEvidence]) -> list[str]:
    """The slug under which each class of effects is followed, the one with most windows first."""
    classes = [members for window in windows for members in window.named]
    slugs: list[str] = []
    while classes:
        firsts: dict[str, int] = {}
        for members in classes:
            firsts[members[0]] = firsts.get(members[0], 0) + 1
        strongest = max(
            sorted(firsts), key=lambda slug: (sum(slug in c for c in classes), firsts[slug])
        )
        slugs.append(strongest)
        classes = [members for members in classes if strongest not in members]
    return slugs


def _followed(slug: str, windows: Sequence[WindowEvidence]) -> LastingFinding | None:
    """The effect from its first window to the last one that could have shown it."""
    felt = _friction_with(slug, windows)
    windows_tested = [
        window for window in windows if window.looked_for(slug) or _is_free(window.S, felt)
    ]
    names = [window.names(slug) for window in windows_tested]
    first = next((index for index, named in enumerate(names) if named), None)
    if first is None:
        return None
    confirmed: int | None = None
    state = FindingState.FIRST_SEEN
    for index in range(first, len(windows_tested)):
        begin = max(index + 1 - MEMORY, 0)
        agreed = _confirms(slug, windows_tested[begin : index + 1], names[begin : index + 1])
        if state in (FindingState.FIRST_SEEN, FindingState.GONE):
            if agreed and (state is FindingState.FIRST_SEEN or names[index]):
                state, confirmed = FindingState.CONFIRMED, index
        elif _is_gone(slug, windows_tested[: index + 1], names[: index + 1]):
            state = FindingState.GONE
        else:
            state = FindingState.STANDING
    last = max(index for index, named in enumerate(names) if named)
    if confirmed is None and len(windows_tested) - 1 - last >= MEMORY:
        return None  # only one window named it, and none of the many since
    recent = windows_tested[-MEMORY:]
    mean, t = _combined(slug, recent)
    return LastingFinding(
        slug=slug,
        state=state,
        first_seen=windows_tested[first].at,
        last_seen=windows_tested[last].at,
        confirmed=None if confirmed is None else windows_tested[confirmed].at,
        named=sum(names[-MEMORY:]),
        of=len(recent),
        mean=mean,
        t=t,
        p_value=_chance(slug, recent),
    )


def _friction_with(slug: str, windows: Sequence[WindowEvidence]) -> float:
    """The median S of the windows that name an effect of friction itself, percent; 0 for any
    other."""
    known_scores = [
        window.S.value
        for window in windows
        if window.names(slug) and window.S is not None and window.S.value is not None
    ]
    return float(np.median(known_scores)) if known_scores and slug in OF_FRICTION else 0.0


def _is_free(S: Estimate | None, felt: float) -> bool:
    """Whether S lies, with its interval, below ``FRICTION_GONE`` of what was ``felt``."""
    return S is not None and S.high is not None and S.high < FRICTION_GONE * felt


def _chance(slug: str, windows: Sequence[WindowEvidence]) -> float:
    """``min over k of C(n, k) p_1 ... p_k``, at most 1, with n windows and in rising order the p
    values of those that name the effect: how probable it is that chance makes k of them as small,
    for the k with the least product.
    """
    named = sorted(
        NULL_RATE if window.p_value is None else window.p_value
        for window in windows
        if window.names(slug)
    )
    least = product = 1.0
    for k, p_value in enumerate(named, start=1):
        product *= p_value
        least = min(least, math.comb(len(windows), k) * product)
    return least


def _confirms(slug: str, recent: Sequence[WindowEvidence], names: Sequence[bool]) -> bool:
    """Whether enough windows agree, or one fewer and those that name nothing gain by the effect
    together."""
    agree = AGREE + (slug in HARDER)
    if sum(names) >= agree:
        return True
    return sum(names) == agree - 1 and gain_together(slug, recent)


def gain_together(slug: str, windows: Sequence[WindowEvidence]) -> bool:
    """Whether the windows that name nothing gain by the effect together."""
    mean, t = _combined(slug, windows)
    return mean is not None and t is not None and mean >= LEAST_MEAN and t >= LEAST_T


def _combined(
    slug: str, windows: Sequence[WindowEvidence]
) -> tuple[float, float] | tuple[None, None]:
    """Mean gain and pooled t of the windows that name nothing: in one that names another effect,
    whatever does a part of that one's work gains too."""
    scores = [window.score(slug) for window in windows if not window.named]
    known_scores = [score for score in scores if score is not None]
    if len(known_scores) < FEWEST_OTHERS:
        return None, None
    mean = sum(score.mean for score in known_scores) / len(known_scores)
    return mean, sum(score.t for score in known_scores) / math.sqrt(len(known_scores))


def windows_to_be_gone(before: Sequence[bool]) -> int:
    """Windows on end without a finding, at most ``MEMORY``, from which chance hardly explains that
    it is not there: with a share s = found / (n + 1) of the n windows ``before``, the least k with
    (1 - s)^k <= ``LEFT_OUT_BY_CHANCE``. 0 where it was in none of them."""
    share = sum(before) / (len(before) + 1.0)
    if share <= 0.0:
        return 0
    return min(math.ceil(math.log(LEFT_OUT_BY_CHANCE) / math.log(1.0 - share)), MEMORY)


def _is_gone(slug: str, windows: Sequence[WindowEvidence], names: Sequence[bool]) -> bool:
    """Whether so many windows at the end do not name the effect that chance hardly explains it, and
    they do not gain by it together either."""
    windows_without = next((k for k, named in enumerate(reversed(names)) if named), len(names))
    before = names[: len(names) - windows_without][-MEMORY:]
    if windows_without < max(windows_to_be_gone(before), FEWEST_WITHOUT):
        return False
    return not gain_together(slug, windows[len(windows) - windows_without :][-MEMORY:])


def pooled_stiction(
    windows: Iterable[WindowEvidence], findings: Sequence[LastingFinding]
) -> Stiction | None:
    """S and J over the last ``MEMORY`` windows that name just what holds; ``None`` where there are
    fewer than two of them.

    Random-effects mean (DerSimonian and Laird 1986, doi:10.1016/0197-2456(86)90046-2); ``SHARED``
    of the windows' median error is added in quadrature.
    """
    holding = [finding.slug for finding in findings if finding.holds]
    same_names = [window for window in windows_that_count(windows) if _names_just(window, holding)][
        -MEMORY:
    ]
    S = _pooled([window.S for window in same_names])
    J = _pooled([window.J for window in same_names])
    return None if S is None or J is None else Stiction(S=S, J=J)


def _names_just(window: WindowEvidence, slugs: Sequence[str]) -> bool:
    if window.S is None or window.S.value is None:
        return False
    return len(window.named) == len(slugs) and all(window.names(slug) for slug in slugs)


def _pooled(estimates: Sequence[Estimate | None]) -> Estimate | None:
    """The random-effects mean of several estimates, with its 95 % interval."""
    known_estimates = [
        estimate for estimate in estimates if estimate is not None and estimate.value is not None
    ]
    known_estimates = [
        estimate
        for estimate in known_estimates
        if estimate.low is not None and estimate.high is not None
    ]
    if len(known_estimates) < 2:
        return None
    values = np.array([estimate.value for estimate in known_estimates], dtype=np.float64)
    errors = np.array(
        [(estimate.high or 0.0) - (estimate.low or 0.0) for estimate in known_estimates]
    ) / (2.0 * NORMAL_95)
    mean, error = _random_effects(values, np.maximum(errors, 1e-6))
    reach = NORMAL_95 * math.hypot(error, SHARED * float(np.median(errors)))
    return Estimate(value=mean, low=max(mean - reach, 0.0), high=mean + reach, unit=PERCENT)


def _random_effects(values: Floats, errors: Floats) -> tuple[float, float]:
    weights = errors**-2.0
    fixed = float(weights @ values / weights.sum())
    excess = float(weights @ (values - fixed) ** 2) - (values.size - 1)
    scale = float(weights.sum() - weights @ weights / weights.sum())
    between = max(excess / scale, 0.0)
    weights = 1.0 / (errors**2 + between)
    mean = float(weights @ values / weights.sum())
    return mean, float(weights.sum() ** -0.5)
