"""From a screening to the kinds of finding that somebody can act on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.quality import assess
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.maintenance import finding_kinds as k
from tests.service.made_mismatch import named
from tests.service.report.conftest import screening, stick_slip

RNG = np.random.default_rng(7)
T = np.arange(3600, dtype=np.float64)
OP = 50.0 + 8.0 * np.sin(2 * np.pi * T / 300)
MV = stick_slip(OP, 3.0, 1.0) + RNG.normal(0.0, 0.05, T.size)


def recording(mv, **of_mv) -> Recording:
    """An hour of OP with this position."""
    signals = {Role.OP: Signal.good(OP, "OP")}
    if mv is not None:
        signals[Role.MV] = Signal.good(np.asarray(mv), "MV", **of_mv)
    return Recording(valve="FV-1", signals=signals, interval_s=1.0)


MANY_BAD = np.where(RNG.random(T.size) < 0.8, np.nan, MV)
HALF_FROZEN = np.where(T > 1200, MV[1200], MV)


@pytest.mark.parametrize(
    ("made", "kind"),
    [
        (recording(None), k.NO_POSITION),
        (recording(OP), k.WRONG),
        (recording(100.0 - MV), k.WRONG),
        (recording(50.0 + np.roll(np.cumsum(RNG.normal(0, 0.3, T.size)), 77)), k.WRONG),
        (recording(MV * 3.7, unit="mm"), k.WRONG),
        (recording(np.full(T.size, 47.25)), k.FROZEN),
        (recording(50.0 + RNG.normal(0, 0.05, T.size)), k.FROZEN),
        (recording(HALF_FROZEN), k.FROZEN),
        (recording(MANY_BAD), k.BAD),
        (recording(MV).part(0, 90), k.RECORDING),
    ],
    ids=["none", "op", "reversed", "foreign", "mm", "constant", "noise", "frozen", "bad", "short"],
)
def test_an_obstacle_is_known_by_the_sentence_that_the_models_give_it(made, kind):
    """A stored screening has the sentence only; a new wording there must not lose the kind."""
    obstacles = assess(made, Limits()).obstacles
    assert obstacles
    assert k.obstacle_kind(f"Cannot tell: {obstacles[0].reason}.") == kind


def sticky(**changes) -> Screening:
    """A sticking valve."""
    return replace(screening("FV-1", S=5.0, J=2.0, samples=60), **changes)


@pytest.mark.parametrize("shape", list(Shape))
def test_a_sticking_stem_is_named_by_its_shape(shape):
    """Play asks for other hands than packing."""
    assert k.kinds_of(sticky(shape=shape), stands=None) == (k.STICTION[shape],)


def test_an_effect_that_stands_comes_after_stiction_and_before_a_watch():
    """On a sticking valve the packing is the first suspect, on the others the effect is."""
    found = named()
    slugs = tuple(one.slug for one in found.effects)
    stuck = sticky(mismatch=found)
    assert k.kinds_of(stuck, stands=True) == ("stiction_undershoot", *slugs)
    watch = replace(stuck, verdict=Verdict.WATCH)
    assert k.kinds_of(watch, stands=True) == (*slugs, k.WATCH)
    healthy = replace(stuck, verdict=Verdict.HEALTHY)
    assert k.kinds_of(healthy, stands=True) == slugs
    assert k.needs_work(k.kinds_of(healthy, stands=True))


def test_an_effect_that_is_held_back_makes_no_work():
    """Chance alone may have named it."""
    watch = sticky(verdict=Verdict.WATCH, mismatch=named())
    assert k.kinds_of(watch, stands=False) == (k.WATCH,)
    assert not k.needs_work((k.WATCH,))
    assert k.kinds_of(replace(watch, verdict=Verdict.HEALTHY), stands=False) == (k.HEALTHY,)


def test_an_unknown_difference_is_work_on_a_valve_to_watch_and_not_on_a_healthy_one():
    """Nobody is sent to a stem that follows because a model does not."""
    found = replace(named(), finding=Finding.UNKNOWN, effects=())
    watch = sticky(verdict=Verdict.WATCH, mismatch=found)
    assert k.kinds_of(watch, stands=None) == (k.UNKNOWN, k.WATCH)
    assert k.needs_work(k.kinds_of(watch, stands=None))
    assert k.kinds_of(replace(watch, verdict=Verdict.HEALTHY), stands=None) == (k.HEALTHY,)


def test_a_departure_from_the_baseline_is_work():
    """A watch without a shape is one whose S is small."""
    assert k.kinds_of(sticky(verdict=Verdict.WATCH, shape=None), stands=None) == (k.DEPARTED,)
    assert k.needs_work((k.DEPARTED,))


def test_a_short_recording_is_no_work_and_a_dead_transmitter_is():
    """Of the undetermined only those that somebody can mend at the valve."""
    blind = sticky(verdict=Verdict.UNDETERMINED, shape=None)
    short = replace(blind, reason="Cannot tell: the recording is too short.")
    assert not k.needs_work(k.kinds_of(short, stands=None))
    dead = replace(blind, reason="Cannot tell: the position did not change by one digit while OP")
    assert k.kinds_of(dead, stands=None) == (k.FROZEN,)
    assert k.needs_work((k.FROZEN,))
