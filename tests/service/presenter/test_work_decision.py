"""From a screening to the kinds of finding that somebody can act on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.record_checks.validity_checks import reversed_obstacles
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Shape, Verdict
from stemwatch.service.presenter import work_decision as k
from stemwatch.service.presenter.finding import present
from stemwatch.service.presenter.work_counts import count_valves
from tests.service.example_mismatches import named
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
        (recording(50.0 + np.roll(np.cumsum(RNG.normal(0, 0.3, T.size)), 77)), k.WRONG),
        (recording(MV * 3.7, unit="mm"), k.WRONG),
        (recording(np.full(T.size, 47.25)), k.FROZEN),
        (recording(50.0 + RNG.normal(0, 0.05, T.size)), k.FROZEN),
        (recording(HALF_FROZEN), k.FROZEN),
        (recording(MANY_BAD), k.BAD),
        (recording(MV).part(0, 90), k.RECORDING),
    ],
    ids=["none", "op", "foreign", "mm", "constant", "noise", "frozen", "bad", "short"],
)
def test_an_obstacle_is_known_by_its_slug(made, kind):
    """What the models find in the way of a verdict says where to look."""
    obstacles = assess(made, Limits()).obstacles
    assert obstacles
    assert k.obstacle_kind(NoVerdict.of(obstacles[0].slug)) == kind


def test_a_position_against_op_that_no_curve_follows_is_the_wrong_one():
    """It is told by its slug here too, where only a fit could find it."""
    (result,) = reversed_obstacles(recording(100.0 - MV))
    assert k.obstacle_kind(NoVerdict.of(result.slug)) == k.WRONG


def test_a_stem_that_moves_by_itself_is_looked_at():
    """It hunts or pulses, or friction does not explain it: each asks for a look at the valve, and a
    recording that is only uncertain for another recording."""
    for reason in (NoVerdict.POSITION_SWINGS, NoVerdict.FRICTION_DOES_NOT_EXPLAIN):
        assert k.obstacle_kind(reason) == k.UNEXPLAINED
    assert k.obstacle_kind(NoVerdict.S_UNCERTAIN) == k.RECORDING


def test_no_word_of_a_sentence_decides():
    """Another wording, or one of another language, asks for the same work."""
    blind = sticky(
        verdict=Verdict.UNDETERMINED,
        shape=None,
        no_verdict=NoVerdict.POSITION_FROZEN,
        reason="Fest",
    )
    assert k.decide(blind, stands=None).kinds == (k.FROZEN,)
    worded = replace(blind, reason="The stem may be stuck.")
    assert k.decide(worded, stands=None).kinds == (k.FROZEN,)
    worded = replace(blind, no_verdict=None, reason="the position did not change by one digit")
    assert k.decide(worded, stands=None).kinds == (k.RECORDING,)


def sticky(**changes) -> Screening:
    """A sticking valve."""
    return replace(screening("FV-1", S=5.0, J=2.0, samples=60), **changes)


def kinds_of(item: Screening, *, stands: bool | None) -> tuple[str, ...]:
    """The kinds of the decision."""
    return k.decide(item, stands=stands).kinds


def needs_work(item: Screening, *, stands: bool | None) -> bool:
    """Whether it counts as a valve that needs work."""
    return k.decide(item, stands=stands).needs_work


@pytest.mark.parametrize("shape", list(Shape))
def test_a_sticking_stem_is_named_by_its_shape(shape):
    """Play asks for other hands than packing; work it is in any case."""
    assert kinds_of(sticky(shape=shape), stands=None) == (k.STICTION[shape],)
    assert needs_work(sticky(shape=shape), stands=None)


def test_an_effect_that_stands_comes_after_stiction_and_before_a_watch():
    """On a sticking valve the packing is the first suspect, on the others the effect is."""
    selection = named()
    slugs = tuple(effect.slug for effect in selection.effects)
    stuck = sticky(mismatch=selection)
    assert kinds_of(stuck, stands=True) == ("stiction_undershoot", *slugs)
    watch = replace(stuck, verdict=Verdict.WATCH)
    assert kinds_of(watch, stands=True) == (*slugs, k.WATCH)
    healthy = replace(stuck, verdict=Verdict.HEALTHY)
    assert kinds_of(healthy, stands=True) == slugs
    assert needs_work(watch, stands=True)
    assert needs_work(healthy, stands=True)


def test_an_effect_that_is_held_back_makes_no_work():
    """Chance alone may have named it."""
    watch = sticky(verdict=Verdict.WATCH, mismatch=named())
    assert kinds_of(watch, stands=False) == (k.WATCH,)
    assert k.decide(watch, stands=False).state is k.WorkState.WATCH
    assert not k.decide(watch, stands=False).has_page
    healthy = replace(watch, verdict=Verdict.HEALTHY)
    assert kinds_of(healthy, stands=False) == (k.HEALTHY,)
    assert k.decide(healthy, stands=False).state is k.WorkState.NO_WORK


def test_what_belongs_to_the_machine_is_named_and_asks_for_no_work():
    """A motor's lag is how a drive is made; a defect beside it is work all the same."""
    first, *others = named().effects
    machine = replace(first, slug="motor_drive", members=("motor_drive",), inherent=True)
    healthy = sticky(verdict=Verdict.HEALTHY, mismatch=replace(named(), effects=(machine,)))
    decided = k.decide(healthy, stands=True)
    assert (decided.verdict, decided.kinds) == (Verdict.HEALTHY, (k.HEALTHY,))
    assert (decided.effects, decided.inherent) == ((), (machine,))
    result = present(healthy, stands=True).found
    assert result[-1] == (
        "Motor drive belongs to such a machine and is no defect. The stem is here whatever the "
        "motor moves."
    )
    assert machine.sentence in " ".join(result)
    both = replace(healthy, mismatch=replace(named(), effects=(machine, *others)))
    assert k.decide(both, stands=True).kinds == tuple(other.slug for other in others)
    assert needs_work(both, stands=True)


def test_an_unknown_difference_gets_a_page_on_a_valve_to_watch_and_none_on_a_healthy_one():
    """Nobody is sent to a stem that follows because a model does not."""
    changed = replace(named(), finding=Finding.UNKNOWN, effects=())
    watch = sticky(verdict=Verdict.WATCH, mismatch=changed)
    assert kinds_of(watch, stands=None) == (k.UNKNOWN, k.WATCH)
    assert k.decide(watch, stands=None).has_page
    assert not needs_work(watch, stands=None)
    assert kinds_of(replace(watch, verdict=Verdict.HEALTHY), stands=None) == (k.HEALTHY,)


def test_a_departure_from_the_baseline_is_to_be_watched_and_gets_a_page():
    """A watch without a shape is one whose S is small."""
    departed = k.decide(sticky(verdict=Verdict.WATCH, shape=None), stands=None)
    assert departed.kinds == (k.DEPARTED,)
    assert departed.state is k.WorkState.WATCH
    assert departed.has_page
    assert not departed.has_order


def test_what_cannot_be_judged_is_no_work_but_a_dead_transmitter_gets_an_order():
    """Of the undetermined only those that somebody can mend at the valve."""
    blind = sticky(verdict=Verdict.UNDETERMINED, shape=None, severity=15.0)
    short = replace(blind, no_verdict=NoVerdict.TOO_SHORT)
    dead = replace(blind, no_verdict=NoVerdict.POSITION_FROZEN)
    decided = k.decide(dead, stands=None)
    assert k.decide(short, stands=None).state is decided.state is k.WorkState.NOT_JUDGED
    assert not k.decide(short, stands=None).has_order
    assert decided.kinds == (k.FROZEN,)
    assert decided.has_order
    assert not replace(decided, no_sign=True).has_order
    assert not decided.needs_work


def test_the_severity_is_the_same_wherever_it_is_shown():
    """A stem that may be stuck fast stands beside the worst, whatever could be measured of it."""
    blind = sticky(verdict=Verdict.UNDETERMINED, shape=None, severity=15.0)
    dead = replace(blind, no_verdict=NoVerdict.POSITION_FROZEN)
    assert k.decide(dead, stands=None).severity == k.SEVERITY_OF[k.FROZEN]
    assert k.decide(blind, stands=None).severity == 15.0
    slow = sticky(verdict=Verdict.HEALTHY, severity=3.0, mismatch=named())
    assert k.decide(slow, stands=True).severity == k.OTHER_SEVERITY
    assert k.decide(slow, stands=False).severity == 3.0


def test_valves_are_counted_as_valves_and_recordings_as_recordings():
    """One tag with three recordings is one valve: work wins, and one verdict is enough to judge."""
    healthy = sticky(verdict=Verdict.HEALTHY)
    blind = sticky(verdict=Verdict.UNDETERMINED, reason="Cannot tell: the recording is too short.")
    created = [
        *[("FV-1", item) for item in (sticky(), healthy, blind)],
        *[("FV-2", item) for item in (blind, healthy)],
        *[("FV-3", item) for item in (blind, blind)],
        ("FV-4", sticky(verdict=Verdict.WATCH)),
    ]
    counts = count_valves((valve, k.decide(item, stands=None)) for valve, item in created)
    assert (counts.valves, counts.recordings) == (4, 8)
    assert counts.sentence == (
        "1 of 4 valves needs work; 1 to watch, 1 cannot be judged, 1 without work (8 recordings)."
    )


def test_where_nothing_can_be_judged_nobody_is_told_that_all_is_well():
    """The number of valves without a verdict is in the sentence."""
    blind = sticky(verdict=Verdict.UNDETERMINED, reason="Cannot tell: too short.")
    counts = count_valves([("FV-1", k.decide(blind, stands=None))])
    assert counts.sentence == "The valve cannot be judged."
    asked = replace(counts, orders=1)
    assert asked.sentence == (
        "The valve cannot be judged; its work order says how to find out why."
    )
    two = count_valves((valve, k.decide(blind, stands=None)) for valve in ("FV-1", "FV-2"))
    assert two.sentence == "None of 2 valves can be judged."
    assert count_valves([]).sentence == "No valve was screened."
