"""Populations of loops with hidden effects; each loop depends on its index and the seed alone."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from stemwatch.models.studies.simulator.hidden.case import HiddenCase
from stemwatch.models.studies.simulator.hidden.catalogue import (
    EFFECTS,
    PHYSICS,
    effect_named,
    go_together,
    with_effect,
)
from stemwatch.models.studies.simulator.hidden.loops import (
    CONCEALMENTS,
    HIGH_SCATTER,
    draw_loop,
    moved_anew,
    tuned,
)
from stemwatch.models.studies.simulator.hidden.unknown import RARE, UNKNOWN

# Of twenty cases: four nulls, eleven with one effect, three with a pair, two with a rare effect,
# most of which are outside the catalogue.
_PATTERN = "NSSPSSNSUSSPSNSUSPSN"
# Effects that a concealment already contains.
_SAME = {("quantisation", "quantised"), ("historian_compression", "compressed")}


def draw_hidden(n: int, seed: int) -> list[HiddenCase]:
    """``n`` mixed cases: a fifth nulls (half of them with 12 % scatter), eleven in twenty with one
    effect (all of ``EFFECTS`` in turn), three in twenty with a pair, a tenth with a rare effect;
    concealments in turn. The first k cases do not depend on ``n``."""
    return [_mixed(index, np.random.default_rng([seed, index, 3])) for index in range(n)]


def draw_nulls(n: int, seed: int, concealment: str | None = None) -> list[HiddenCase]:
    """``n`` cases with nothing hidden, every second one with 12 % scatter; ``concealment`` for all
    of them, or all in turn."""
    return [
        _null(index, concealment or _in_turn(index), np.random.default_rng([seed, index, 4]))
        for index in range(n)
    ]


def draw_effect(
    slug: str, n: int, seed: int, concealment: str | None = "routine"
) -> list[HiddenCase]:
    """``n`` cases with the catalogue's effect ``slug``; ``concealment`` for all of them, or
    (``None``) all in turn, each effect beginning with another one.

    Raises ``KeyError`` with the slugs there are.
    """
    effect_named(slug)
    key = zlib.crc32(slug.encode())
    return [
        _case(
            (slug,),
            concealment or CONCEALMENTS[(key + index) % len(CONCEALMENTS)],
            str(index),
            np.random.default_rng([seed, index, 5, key]),
        )
        for index in range(n)
    ]


def draw_unknown(n: int, seed: int, concealment: str = "routine") -> list[HiddenCase]:
    """``n`` cases outside the catalogue, their kinds in turn."""
    names = tuple(UNKNOWN)
    return [
        _case(
            (names[index % len(names)],),
            concealment,
            str(index),
            np.random.default_rng([seed, index, 6]),
        )
        for index in range(n)
    ]


def _in_turn(index: int) -> str:
    """The concealment of an index; shifted at each round, so that an effect does not always have
    the same one.
    """
    return CONCEALMENTS[(index + index // len(EFFECTS)) % len(CONCEALMENTS)]


def _mixed(index: int, rng: np.random.Generator) -> HiddenCase:
    kind = _PATTERN[index % len(_PATTERN)]
    before = _PATTERN[: index % len(_PATTERN)].count(kind)
    rank = index // len(_PATTERN) * _PATTERN.count(kind) + before
    concealment, tag = _in_turn(rank), str(index)
    if kind == "N":
        return _null(rank, concealment, rng, tag)
    if kind == "S":
        names: tuple[str, ...] = (tuple(EFFECTS)[rank % len(EFFECTS)],)
    elif kind == "U":
        names = (tuple(RARE)[rank % len(RARE)],)
    else:
        first = PHYSICS[rank % len(PHYSICS)]
        others = [slug for slug in PHYSICS if go_together(first, slug)]
        names = (first, str(rng.choice(others)))
    return _case(names, concealment, tag, rng)


def _null(
    index: int, concealment: str, rng: np.random.Generator, tag: str | None = None
) -> HiddenCase:
    scatter = HIGH_SCATTER if index % 2 else None
    return _case((), concealment, tag or str(index), rng, scatter)


def _case(
    names: tuple[str, ...],
    concealment: str,
    tag: str,
    rng: np.random.Generator,
    scatter: float | None = None,
) -> HiddenCase:
    if any((name, concealment) in _SAME for name in names):
        concealment = "routine"
    plain_loop = draw_loop(rng, tag, concealment, scatter=scatter)
    sizes: dict[str, float] = {}
    extra_s = 0.0
    for name in names:
        effect = effect_named(name).draw(rng, plain_loop)
        sizes |= {f"{name}.{size}": value for size, value in effect.items()}
        extra_s += effect_named(name).delay_s(effect)
    plain_loop = tuned(plain_loop, extra_s, rng)
    loop = plain_loop
    for name in names:
        loop = with_effect(loop, name, sizes)
    outside = any(name in UNKNOWN for name in names)
    return HiddenCase(
        loop=loop,
        plain=plain_loop,
        seed=int(rng.integers(2**31)),
        hidden=names,
        effects=("unknown",) if outside else names,
        concealment=concealment,
        sizes=sizes,
    )


def windows_of(case: HiddenCase, n: int) -> list[HiddenCase]:
    """``n`` windows of one valve, each as long as the case and ``case`` itself the first: the same
    nameplate, controller and hidden effects, with other movements and random numbers. The first k
    do not depend on ``n``.
    """
    return [
        case if window_number == 0 else _later(case, window_number) for window_number in range(n)
    ]


def _later(case: HiddenCase, window_number: int) -> HiddenCase:
    rng = np.random.default_rng([case.seed, window_number, 7])
    plain_loop = moved_anew(case.plain, rng)
    loop = plain_loop
    for name in case.hidden:
        loop = with_effect(loop, name, case.sizes)
    return replace(case, loop=loop, plain=plain_loop, seed=int(rng.integers(2**31)), excitation={})
