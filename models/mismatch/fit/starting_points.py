"""Where the search for one more term begins: what S and J become once it is there.

In a base without the term, S and J are biased to make up for it. The search must begin near their
values with the term, or it never leaves the base's own optimum.
"""

from __future__ import annotations

from stemwatch.models.mismatch.fit.crossfit import Beginning
from stemwatch.models.mismatch.term import ActsOn, Term

# S that valves have, percent, for terms that make the base's own S meaningless.
FRESH = (2.0, 4.0, 7.0)
FRESH_RATIO = 0.4
COMES_TO_REST = 0.02  # %/s
PARTS_OF_PLAY = (0.5, 1.0, 0.75, 0.2)  # of it, that S alone has taken up
_LED_ASTRAY = ("travel_stop", "rate_limit", "asymmetric_rate_limit")


def beginnings(term: Term, S: float, J: float) -> list[Beginning]:
    """S and J to begin with where the simpler hypothesis found ``S`` and ``J``, percent."""
    own_reading = Beginning(S, J)
    if term.slug in _LED_ASTRAY:
        return [own_reading, *(Beginning(s, FRESH_RATIO * s, plain=True) for s in FRESH)]
    if term.acts_on is ActsOn.COMMAND or term.slug == "viscous_drag":
        # The term smears the slips, which has driven J to zero; and a lagged command that only
        # approaches its end never turns, so that a stem which sticks only at a turn would creep on
        # with it.
        return [
            own_reading,
            Beginning(S, J, restick=COMES_TO_REST),
            Beginning(0.75 * S, 0.25 * S, plain=True),
            Beginning(S, 0.6 * S, plain=True),
            Beginning(0.5 * S, 0.1 * S, plain=True),
        ]
    if term.slug == "lost_motion":
        # The base has fitted the play as part of S and subtracted it from J.
        return [
            own_reading,
            Beginning(S, J, S_less=1.0),
            Beginning(S, J, S_less=1.0, J_less=-0.5),
            Beginning(S, J, S_less=0.0, J_less=-1.0),
        ]
    if term.slug == "dwell_dependent_breakaway":
        # The term raises the breakaway only, by b ln(1 + rest/t0), so S and J both become smaller.
        return [own_reading, *(Beginning(S, J, S_less=k, J_less=k) for k in (1.0, 2.0, 3.0))]
    # A base without the term may have a biased reading, or a J of zero.
    return [
        own_reading,
        Beginning(S, J, plain=True),
        Beginning(0.85 * S, 0.55 * S, plain=True),
        Beginning(0.7 * S, 0.2 * S, plain=True),
    ]


def play_beginnings(S: float, J: float) -> list[Beginning]:
    """S and J to begin with beside play, by which the reading comes to rest as with ``S`` and ``J``
    alone, percent: that tells S - J + b. What the base has too much of S and too little of J is b
    together, in unknown parts.
    """
    return [Beginning(S, J, S_less=part, J_less=part - 1.0) for part in PARTS_OF_PLAY]
