"""Groups of loops that oscillate together, on waves whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from stemwatch.models.oscillation_groups.find_groups import find_groups
from stemwatch.models.oscillation_groups.limits import LIMITS, WEIGHTS, SourceWeights
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra, oscillations
from stemwatch.models.oscillation_groups.plant_groups import (
    LONGEST,
    ThinnedLoop,
    plant_groups,
    thinned_loop,
)
from stemwatch.models.oscillation_groups.sources import (
    MemberEvidence,
    member_evidence,
    nearness,
    rank_sources,
)
from stemwatch.models.recording import Quality, Recording, Role, Signal

N, INTERVAL_S = 4000, 10.0
START = datetime(2026, 3, 2, tzinfo=UTC)


def noises(loops: int, seed: int = 1) -> np.ndarray:
    """(loops, N) noise that wanders."""
    white = np.random.default_rng(seed).normal(size=(loops, N))
    out = np.zeros_like(white)
    for k in range(1, N):
        out[:, k] = 0.9 * out[:, k - 1] + white[:, k]
    return out


def wave(period_s: float, *, wander: float = 0.02, seed: int = 7, delay_s: float = 0.0):
    """A cycle whose phase wanders, as a limit cycle's does; ``delay_s`` later."""
    phase = 2.0 * np.pi * np.arange(N) * INTERVAL_S / period_s
    phase += np.cumsum(np.random.default_rng(seed).normal(size=N)) * wander
    return np.interp(np.arange(N) - delay_s / INTERVAL_S, np.arange(N), np.sin(phase))


def found(values: np.ndarray):
    spectra = loop_spectra(values, INTERVAL_S)
    return find_groups(spectra, spectra, LIMITS)


def test_loops_with_one_wave_are_a_group_whatever_delay_and_sign() -> None:
    """Three loops of eight share a wave of 400 s, late and upside down."""
    values = noises(8)
    for loop, (size, delay) in {1: (5.0, 0.0), 4: (-4.0, 90.0), 6: (3.0, 200.0)}.items():
        values[loop] += size * wave(400.0, delay_s=delay)
    (group,) = found(values)
    assert group.members == (1, 4, 6)
    assert group.period_s == pytest.approx(400.0, rel=0.03)


def test_loops_that_oscillate_each_by_itself_are_no_group() -> None:
    """Equal periods are not enough: the phases wander apart."""
    values = noises(6)
    for loop in range(3):
        values[loop] += 5.0 * wave(400.0, seed=20 + loop, wander=0.08)
    assert found(values) == []


def test_noise_makes_no_group() -> None:
    """Wandering noise in thirty loops, in part the same in all of them."""
    values = noises(30) + 1.5 * noises(1, seed=3)
    assert found(values) == []


def test_a_short_record_makes_no_group_of_a_sticking_valve_and_noise() -> None:
    """Eleven cycles leave six bins in the band: whatever moves in it is half coherent. For a strong
    cycle of a valve that surely sticks, beside fourteen loops of wandering noise, in twenty plants.
    """
    short = 700
    for seed in range(20):
        values = noises(15, seed=seed)[:, :short]
        values[4] += 8.0 * wave(640.0, seed=100 + seed)[:short]
        spectra = loop_spectra(values, INTERVAL_S)
        assert find_groups(spectra, spectra, LIMITS, {4: 5.0}) == []


def test_a_loop_may_belong_to_two_groups() -> None:
    """Each oscillation has its share of the loop's variance."""
    values = noises(7)
    for loop, (first, second) in {0: (6, 0), 1: (5, 0), 2: (6, 3), 3: (0, 5), 4: (0, 5)}.items():
        values[loop] += first * wave(300.0) + second * wave(910.0, seed=9)
    groups = found(values)
    assert sorted(group.members for group in groups) == [(0, 1, 2), (2, 3, 4)]
    stronger, weaker = (group.shares[group.members.index(2)] for group in groups)
    assert stronger > 2.0 * weaker


def test_two_steady_waves_of_near_periods_stay_two_groups() -> None:
    """Within a quarter of each other, and both in one loop."""
    values = 0.4 * noises(8)
    for loop_number in (0, 1, 2, 3):
        values[loop_number] += 4.0 * wave(500.0, wander=0.0)
    for loop_number in (3, 4, 5, 6):
        values[loop_number] += 3.0 * wave(610.0, wander=0.0)
    groups = found(values)
    assert sorted(group.members for group in groups) == [(0, 1, 2, 3), (3, 4, 5, 6)]
    assert sorted(group.period_s for group in groups) == pytest.approx([500.0, 610.0], rel=0.02)


def test_harmonics_belong_to_their_group() -> None:
    """A square wave is one oscillation, not one for each of its harmonics."""
    values = noises(6)
    for loop in (1, 2, 3):
        values[loop] += 6.0 * np.sign(wave(600.0))
    (group,) = found(values)
    assert group.members == (1, 2, 3)
    assert group.period_s == pytest.approx(600.0, rel=0.03)


def test_constant_loops_holes_and_spikes_are_handled() -> None:
    """Loops that cannot be compared are left out; a constant loop has a spectrum of zero."""
    values = noises(6)
    for loop in (0, 3):
        values[loop] += 5.0 * wave(400.0)
    values[1] = 7.0
    values[2, :] = np.nan
    values[3, 500:560] = np.nan
    values[4, 1000] = 1e6
    (group,) = found(values)
    assert group.members == (0, 3)
    assert not np.abs(loop_spectra(values, INTERVAL_S).spectra[1:3]).any()


@pytest.mark.parametrize("samples", [1, 5, 40])
def test_records_too_short_for_a_period_show_nothing(samples: int) -> None:
    """No error, no oscillation."""
    spectra = loop_spectra(np.ones((2, samples)) * np.arange(samples), 10.0)
    assert oscillations(spectra) == []
    assert find_groups(spectra, spectra, LIMITS) == []


def test_squares_of_a_spectrum_add_up_to_one() -> None:
    """So that a band's squares are its share of the variance."""
    spectra = loop_spectra(noises(3), INTERVAL_S)
    assert (np.abs(spectra.spectra) ** 2).sum(axis=1) == pytest.approx(np.ones(3))


def test_the_weaker_of_two_loops_needs_more_than_a_member_of_a_larger_group() -> None:
    """A share near a tenth is known to a third, and the second loop alone would decide."""
    values = noises(5)
    values[0] += 5.0 * wave(400.0)
    values[1] += 1.08 * wave(400.0)
    assert found(values) == []
    values[2] += 5.0 * wave(400.0)
    (group,) = found(values)
    assert group.members == (0, 1, 2)
    assert LIMITS.share < group.shares[1] < LIMITS.pair_share


def test_odds_of_sticking_count_by_the_share_of_their_loop() -> None:
    """A valve that sticks but hardly moves with the others is little evidence for their group."""
    values = noises(4)
    for loop, size in {0: 6.0, 1: 4.0, 2: 1.5}.items():
        values[loop] += size * wave(400.0)
    spectra = loop_spectra(values, INTERVAL_S)
    for odds in ({0: -1.0, 2: 2.0}, {0: 1.0, 2: 2.0}, {}):
        (group,) = find_groups(spectra, spectra, LIMITS, odds)
        by_share = [odds[i] + np.log(group.shares[i]) for i in odds] or [np.log(group.shares[0])]
        assert group.statistics[3] == pytest.approx(max(by_share), abs=0.02)


def test_a_member_is_a_loop_of_whose_pv_the_wave_makes_enough() -> None:
    """A set point that moves hides no wave from the search, but a wave that makes little of PV's
    variance makes no member."""
    errors = 0.1 * noises(4)
    for loop_number in (0, 1, 2):
        errors[loop_number] += wave(400.0)
    set_points = np.zeros_like(errors)
    set_points[1] = wave(2400.0)
    set_points[2] = 10.0 * wave(2400.0, seed=8)
    spectra = loop_spectra(errors, INTERVAL_S)
    (group,) = find_groups(spectra, loop_spectra(set_points - errors, INTERVAL_S), LIMITS)
    assert group.members == (0, 1)
    assert group.shares[0] > 0.9
    assert group.shares[1] == pytest.approx(0.5, abs=0.1)


def test_the_loop_before_the_others_leads() -> None:
    """The wandering of its phase comes first, whatever the signs."""
    values = 0.1 * noises(4)
    for loop, (size, delay) in {0: (2.0, 150.0), 1: (-3.0, 0.0), 2: (2.0, 300.0)}.items():
        values[loop] += size * wave(400.0, delay_s=delay, wander=0.08)
    spectra = loop_spectra(values, INTERVAL_S)
    (group,) = find_groups(spectra, spectra, LIMITS)
    evidence = member_evidence(spectra, spectra, group, {})
    lead = evidence.values[:, 4]
    assert lead[1] > lead[0] > lead[2]
    assert lead[1] - lead[2] == pytest.approx(300.0 / 400.0, abs=0.25)


def test_probabilities_are_of_one_source_or_none() -> None:
    """They add up to one; a verdict from a position outweighs what is equal otherwise."""
    weights = SourceWeights(member=(0, 0, 0, 0, 0, 1.0, 3.0, 0), none=(0,) * 7)
    values = np.zeros((3, 8))
    values[2, 6] = 1.0
    ranking = rank_sources(MemberEvidence(members=(4, 7, 9), values=values), weights)
    assert ranking.members[0] == 9
    assert sum(ranking.probability) + ranking.none == pytest.approx(1.0)
    assert not ranking.outside
    none = replace(weights, none=(9.0, 0, 0, 0, 0, 0, 0))
    assert rank_sources(MemberEvidence(members=(4, 7, 9), values=values), none).outside


@pytest.mark.parametrize(("moves", "begins_there"), [(0, False), (1, False), (200, True)])
def test_nothing_begins_in_a_loop_whose_controller_is_at_rest(
    moves: int, begins_there: bool
) -> None:
    """A loop in manual shows what passes through it, however early and however pure. The other
    loops are no likelier for that: it came from outside."""
    values = 0.3 * noises(3)
    for member, delay in enumerate((0.0, 150.0, 300.0)):
        values[member] += (3.0 - member) * wave(400.0, delay_s=delay, wander=0.08)
    outputs = values.copy()
    outputs[0] = np.repeat(np.arange(moves + 1), -(-N // (moves + 1)))[:N] % 2
    errors, moved = loop_spectra(values, INTERVAL_S), loop_spectra(outputs, INTERVAL_S)
    (group,) = find_groups(errors, errors, LIMITS)
    ranking = rank_sources(member_evidence(errors, moved, group, {}), WEIGHTS)
    all_move = rank_sources(member_evidence(errors, errors, group, {}), WEIGHTS)
    assert all_move.members[0] == 0
    assert (ranking.members[0] == 0) is begins_there
    assert (ranking.probability[ranking.members.index(0)] > 0.0) is begins_there
    assert ranking.outside is not begins_there
    assert sum(ranking.probability) + ranking.none == pytest.approx(1.0)


def loop(name: str, values: np.ndarray, start: datetime | None = START, **more) -> ThinnedLoop:
    small = (50.0 + values).astype(np.float32)
    known = {"source": "a.csv", "interval_s": INTERVAL_S, "sp": np.empty(0, np.float32)} | more
    return ThinnedLoop(loop=name, start=start, op=-small, pv=small, **known)


def test_loops_recorded_together_are_compared() -> None:
    """By their dates, on the slowest clock, whatever begins when; told with source and strength."""
    values = 0.3 * noises(3)
    late = wave(400.0)
    late[: N // 2] = 0.0
    values += late
    loops = [
        loop("A", values[0]),
        loop("B", values[1, 300:], START + timedelta(seconds=3000)),
        loop("C", values[2, ::2], interval_s=20.0),
        loop("D", values[0], START + timedelta(days=30)),
    ]
    (group,) = plant_groups(loops)
    assert {member.loop for member in group.members} == {"A", "B", "C"}
    assert group.since is not None
    assert abs(group.since - START - timedelta(seconds=N * INTERVAL_S / 2)) < timedelta(hours=1)
    assert len(group.spectra) == 3
    assert 0.2 < group.variance_share <= 1.0
    total = sum(member.probability for member in group.members) + group.outside
    assert total == pytest.approx(1.0)
    units = {"A": "100", "B": "100", "C": "200", "D": "100"}
    (in_units,) = plant_groups(loops, units)
    assert [(m.loop, m.probability) for m in in_units.members] == [
        (m.loop, m.probability) for m in group.members
    ]
    for place, member in enumerate(in_units.members):
        near = "1 of the 2 other loops is of its unit 100" in member.evidence
        assert near == (place < 2 and units[member.loop] == "100")
        assert not any("unit 200" in text for text in member.evidence)


def test_an_irregular_swing_in_common_is_a_group_where_a_valve_looks_as_if_it_sticks() -> None:
    """Loads that travel look the same, so that without a suspicion nothing is said."""
    values = noises(6)
    swing = wave(400.0, wander=0.2)
    values[1] += 2.0 * swing
    values[4] += 1.5 * swing
    spectra = loop_spectra(values, INTERVAL_S)
    assert find_groups(spectra, spectra, LIMITS) == []
    assert find_groups(spectra, spectra, LIMITS, {1: -4.0, 4: -4.0, 2: 4.0}) == []
    (group,) = find_groups(spectra, spectra, LIMITS, {1: 4.0, 4: -4.0})
    assert group.members == (1, 4)


def test_a_loop_that_acts_on_the_others_is_near_them() -> None:
    """One over the number of connections on the way, which may pass through other loops."""
    feeds = {0: [1], 1: [2, 9], 9: [3], 7: [0]}
    near = nearness(feeds, [0, 2, 3], [0.5, 0.4, 0.2])
    assert near == pytest.approx([(0.4 / 2 + 0.2 / 3) / 0.6, 0.0, 0.0])
    assert nearness({}, [0, 2], [0.5, 0.4]).tolist() == [0.0, 0.0]
    assert nearness({0: [0]}, [0, 2], [0.5, 0.4]).tolist() == [0.0, 0.0]


def test_connections_favour_the_loop_that_acts_on_the_others() -> None:
    """Through a loop that is not in the run; and it is said."""
    values = noises(3) * 0.5 + 3.0 * wave(400.0)
    loops = [loop(name, row) for name, row in zip("ABC", values, strict=True)]
    feeds = {"B": ["X"], "X": ["A", "C"]}
    (without,), (group,) = plant_groups(loops), plant_groups(loops, feeds=feeds)
    before = {member.loop: member.probability for member in without.members}
    after = {member.loop: member for member in group.members}
    assert after["B"].probability > before["B"]
    said = "by the connections in the plant file it acts on the others more directly"
    assert [member.loop for member in group.members if said in member.evidence] == ["B"]


def test_a_suspicion_by_op_and_pv_favours_the_loop_as_source() -> None:
    """A suspicion raises the probability, and the evidence mentions it."""
    values = noises(3) * 0.5 + 3.0 * wave(400.0)
    loops = [loop(name, row, score=0.5) for name, row in zip("ABC", values, strict=True)]
    suspected = [replace(one, score=0.95 if one.loop == "C" else 0.05) for one in loops]
    (alike,), (group,) = plant_groups(loops), plant_groups(suspected)
    before = {member.loop: member.probability for member in alike.members}
    assert group.members[0].loop == "C"
    assert group.members[0].probability > before["C"]
    assert (
        "its OP and PV look more like a sticking valve than those of the others"
        in group.members[0].evidence
    )


def test_undated_loops_are_compared_within_a_file() -> None:
    """Two files without dates may be from different times."""
    values = noises(4) * 0.3 + wave(400.0)
    item = [loop("A", values[0], None), loop("B", values[1], None)]
    other = [loop("C", values[2], None, source="c.csv"), loop("D", values[3], None, source="d.csv")]
    (group,) = plant_groups([*item, *other])
    assert {member.loop for member in group.members} == {"A", "B"}


def signal(values: np.ndarray, unit: str) -> Signal:
    quality = np.where(np.isfinite(values), Quality.GOOD, Quality.BAD).astype(np.uint8)
    return Signal(values=values, quality=quality, tag=unit, unit=unit)


def test_a_recording_is_thinned_and_its_bad_samples_left_out() -> None:
    """Means over blocks, at most ``LONGEST``; SP only in the unit of PV."""
    n = 3 * LONGEST
    values = np.arange(n, dtype=np.float64)
    values[:3] = np.nan
    signals = {
        Role.OP: signal(np.arange(n, dtype=np.float64), "%"),
        Role.PV: signal(values, "degC"),
        Role.SP: signal(np.ones(n), "%"),
    }
    recording = Recording(valve="A", signals=signals, interval_s=2.0, start=START)
    waves = thinned_loop(recording)
    assert waves.interval_s == 6.0
    assert waves.op.size == LONGEST
    assert waves.op[1] == 4.0
    assert np.isnan(waves.pv[0])
    assert waves.sp.size == 0
    assert thinned_loop(replace(recording, signals={Role.OP: signals[Role.OP]})) is None
