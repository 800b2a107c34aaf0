"""Two named effects that may be one cause.

Air, drag and positioner each delay the stem by a lag, and act one after the other: the record shows
one answer of second order. A volume behind a narrow line, a booster or a stem with mass has such an
answer alone, and what its term lacks of it a second lag takes up. In the same way a supply that is
short limits the speed, one way more than the other, and sags. So two of one kind are one effect
that the recording cannot tell from the other, and not two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stemwatch.models.mismatch.evidence.describe_effect import with_what_tells
from stemwatch.models.mismatch.findings import Effect

KINDS = (
    frozenset({"actuator_lag", "asymmetric_lag", "underdamped_positioner", "viscous_drag"}),
    frozenset({"rate_limit", "asymmetric_rate_limit", "supply_sag"}),
)


def one_cause(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The ``effects``, of each kind the one with the largest gain, or one that it cannot be told
    from and that is named itself, with the others of that kind as what cannot be told from it.
    """
    kept: list[Effect] = []
    for one in sorted(effects, key=lambda effect: -effect.evidence.mean):
        same = next((k for k, other in enumerate(kept) if of_one_kind(one.slug, other.slug)), None)
        if same is None:
            kept.append(one)
        else:
            kept[same] = _with(kept[same], one)
    return tuple(kept)


def of_one_kind(slug: str, other: str) -> bool:
    """Whether two effects may be one cause."""
    return any({slug, other} <= kind for kind in KINDS)


def _with(stronger: Effect, weaker: Effect) -> Effect:
    """The stronger of two effects of one kind, with the weaker one as another of its class; the
    weaker one, where it alone may be the cause of both.
    """
    if weaker.slug in stronger.members and stronger.slug not in weaker.members:
        stronger, weaker = weaker, stronger
    names = [effect.slug.replace("_", " ") for effect in (stronger, weaker)]
    tells = (
        f"With {names[1]} behind the {names[0]} the record is followed better still; one cause of "
        "two stages does that too, so that they are not two findings."
    )
    more = tuple(slug for slug in weaker.members if slug not in stronger.members)
    return with_what_tells(replace(stronger, members=(*stronger.members, *more)), tells)
