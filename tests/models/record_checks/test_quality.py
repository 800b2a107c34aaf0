"""Each obstacle to a verdict has a sentence on what was found and one on the remedy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.frozen import frozen_runs
from stemwatch.models.record_checks.quality import Assessment, assess, with_obstacles
from stemwatch.models.record_checks.validity_checks import reversed_obstacles
from stemwatch.models.recording import ClockFacts, Quality, Recording, Role, Signal
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import (
    Compression,
    CompressionKind,
    Load,
    LoadKind,
    SimulatedArchive,
    Span,
)

LIMITS = Limits()
rng = np.random.default_rng(8)


@cache
def plant(S=5.0, J=2.0, **archive) -> Recording:
    """An hour of a flow loop under load, at 1 s unless told."""
    return simulate_loop(
        PlantLoop(
            valve=SimulatedValve(S=S, J=J),
            setpoints=((10.0, 51.3), (900.0, 55.0), (1800.0, 47.0), (2700.0, 52.0)),
            loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
            archive=SimulatedArchive(**archive),
        ),
        3,
    ).recording


def recorded(op=None, mv=None, *, unit="%", op_unit="%", mode=None, interval_s=1.0) -> Recording:
    """The plant's hour with OP or MV exchanged; ``mv=False`` leaves the position out."""
    base = plant()
    op = base.op.values if op is None else op
    signals = {Role.OP: Signal.good(op, "FV-7.OUT", op_unit)}
    if mv is not False:
        mv = base.signals[Role.MV].values if mv is None else mv
        signals[Role.MV] = Signal.good(mv, "FV-7.ZT", unit)
    if mode is not None:
        signals[Role.MODE] = Signal.good(mode, "FV-7.MODE", "")
    return Recording(valve="FV-7", signals=signals, interval_s=interval_s)


OP, MV = plant().op.values, plant().signals[Role.MV].values
N = OP.size


def seen(recording) -> Assessment:
    return assess(recording, LIMITS)


def the_obstacle(recording, slug):
    """The first obstacle, which has the slug, costs the grade, and reads like two sentences."""
    assessment = seen(recording)
    assert "D" == assessment.quality.grade
    first = assessment.obstacles[0]
    assert slug == first.slug
    assert first.reason in assessment.quality.reasons
    assert not first.reason.endswith(".")
    assert first.remedy.endswith(".")
    assert first.remedy[0].isupper()
    return first


def test_a_clean_recording_has_no_obstacle():
    """An hour of a moving loop with a noisy position is grade A, without a remark."""
    assessment = seen(plant())
    assert ("A", ()) == (assessment.quality.grade, assessment.quality.reasons)
    assert () == assessment.obstacles


def test_no_position():
    """OP without a position carries no verdict, and the remedy says how to get one."""
    first = the_obstacle(recorded(mv=False), "no_position")
    assert "there is no valve position" in first.reason
    assert "stroke test" in first.remedy


@pytest.mark.parametrize("rounding", [0.0, 1e-9])
def test_position_is_op(rounding):
    """A position tag that repeats OP sample for sample is refused by name."""
    first = the_obstacle(recorded(mv=OP + rounding), "position_is_op")
    assert "FV-7.ZT repeats OP sample for sample" in first.reason


def test_position_in_another_unit():
    """A position in millimetres is not compared with OP; its range is asked for."""
    first = the_obstacle(recorded(mv=MV * 0.29, unit="mm"), "position_unit")
    assert "FV-7.ZT is in mm, not in percent of travel" in first.reason
    assert "0 % and 100 %" in first.remedy


def test_command_in_another_unit():
    """S and J are percent of OP span, so OP in milliamperes is refused."""
    first = the_obstacle(recorded(op=4.0 + 0.16 * OP, op_unit="mA"), "op_unit")
    assert "FV-7.OUT is in mA, not in percent of span" in first.reason


def test_command_whose_values_are_no_percent():
    """OP from 389 to 396 is no percent, whatever its unit says."""
    first = the_obstacle(recorded(op=np.linspace(389.0, 396.0, N)), "op_unit")
    assert "FV-7.OUT runs from 389 to 396, not in percent" in first.reason


def test_missing_position_is_said_before_the_unit():
    """Where both stand in the way, the position is what must be got first."""
    slugs = [o.slug for o in seen(recorded(mv=False, op_unit="mA")).obstacles]
    assert ["no_position", "op_unit"] == slugs


def test_reverse_acting_position():
    """A position that counts the other way is no obstacle: a curve from OP to stroke reads it."""
    assert () == seen(recorded(mv=100.0 - MV)).obstacles


def test_a_position_against_op_without_a_curve():
    """Where no curve explains why it falls when OP rises, it costs the grade and says the mend."""
    recording = recorded(mv=100.0 - MV)
    before = seen(recording)
    after = with_obstacles(before, reversed_obstacles(recording))
    (first,) = after.obstacles
    assert "position_reversed" == first.slug
    assert "the position falls when OP rises (correlation -0." in first.reason
    assert "the other way round" in first.remedy
    assert "D" == after.quality.grade
    assert first.reason == after.quality.reasons[0]
    assert with_obstacles(before, reversed_obstacles(recorded())) is before


@pytest.mark.parametrize("shape", [(10.0, 3.0), (8.0, 8.0), (0.3, 0.0)])
def test_a_sticking_position_is_not_reversed(shape):
    """However much a stem sticks, its own position is not taken for a reversed one."""
    assert () == seen(plant(*shape)).obstacles


def test_constant_position():
    """A position without one changing digit is a frozen transmitter or a stuck stem."""
    first = the_obstacle(recorded(mv=np.full(N, 47.0)), "position_frozen")
    assert "did not change by one digit while OP moved over 14.1 %" in first.reason


def test_position_of_noise_only():
    """A position that only shows noise is no stem whose S and J could be read."""
    first = the_obstacle(recorded(mv=47.0 + 0.03 * rng.standard_normal(N)), "position_still")
    assert "nothing but its noise while OP moved over 14.1 %" in first.reason


def test_too_short():
    """Two minutes are too few, and the remedy says how much is wanted."""
    first = the_obstacle(plant().part(0, 120), "too_short")
    assert "120 usable samples in 2.0 minutes" in first.reason
    assert "at least 200 samples and 5 minutes" in first.remedy


def test_bad_samples():
    """Two fifths of the samples marked bad are too many."""
    first = the_obstacle(plant(bad=(Span(start_s=0.0, stop_s=1440.0),)), "bad_samples")
    assert "40 % of the samples are missing or marked bad" == first.reason


def test_samples_that_an_archive_repeated_are_not_called_bad():
    """Nothing is broken where most of them repeat an older value: the archive is to be asked."""
    recording = recorded()
    signals = dict(recording.signals)
    old = np.arange(N) % 10 < 4
    quality = np.where(old, Quality.HELD, Quality.GOOD).astype(np.uint8)
    signals[Role.MV] = replace(recording.mv, quality=quality)
    first = the_obstacle(replace(recording, signals=signals), "bad_samples")
    assert "40 % of the samples are missing or repeat an older value" in first.reason
    assert "without compression" in first.remedy


def test_holes_everywhere():
    """A hole every half minute leaves no stretch long enough to fit, and is said to do so."""
    mv = np.where(np.arange(N) % 25 < 5, np.nan, MV)
    first = the_obstacle(recorded(mv=mv), "broken_up")
    assert "0 samples are more than 30 s after a hole" in first.reason


@pytest.mark.parametrize(
    ("op", "mv"), [([], []), ([50.0], [50.0]), ([np.nan] * 500, [np.nan] * 500)]
)
def test_next_to_nothing(op, mv):
    """No sample, one sample, or no number at all: an obstacle, not an exception."""
    assert "D" == seen(recorded(op=np.array(op), mv=np.array(mv))).quality.grade


def test_op_still():
    """A command that hardly moves cannot show a sticking stem."""
    op = 50.0 + 0.1 * rng.standard_normal(N)
    first = the_obstacle(recorded(op=op, mv=op + 0.03 * rng.standard_normal(N)), "op_still")
    assert "OP moved over 0.5 % only" in first.reason


@pytest.mark.parametrize(
    ("low", "high", "says"), [(0.0, 1.0, "0 to 1,"), (4.0, 20.0, "4 to 20 mA,")]
)
def test_an_op_that_may_be_stored_in_another_range_is_told_so(low, high, says):
    """A fraction or milliamperes that are read as percent hardly move: the sentence says what it
    would be, and the remedy which range to give."""
    op = low + 0.01 * (high - low) * (45.0 + 0.18 * (OP - OP.mean()))
    first = the_obstacle(recorded(op=op), "op_still")
    assert f"it stays within {says} and if it is stored so it moved over " in first.reason
    assert f"low = {low:g}, high = {high:g}" in first.remedy


def test_manual():
    """In manual with OP still the sentence says that the loop was in manual."""
    op = 50.0 + 0.1 * rng.standard_normal(N)
    mv = op + 0.03 * rng.standard_normal(N)
    first = the_obstacle(recorded(op=op, mv=mv, mode=np.zeros(N)), "manual")
    assert first.reason.startswith("the loop was in manual and OP moved over")


def test_manual_that_moves_is_no_obstacle():
    """A stroke test in manual is as good as a closed loop; other mode codes are not manual."""
    assert () == seen(recorded(mode=np.zeros(N))).obstacles
    op = 50.0 + 0.1 * rng.standard_normal(N)
    mv = op + 0.03 * rng.standard_normal(N)
    for code in (1.0, 2.0, np.nan):
        assert "op_still" == seen(recorded(op=op, mv=mv, mode=np.full(N, code))).obstacles[0].slug


def test_few_reversals():
    """A command that only rises cannot show what happens at a reversal."""
    op = np.linspace(30.0, 60.0, N)
    mv = op + 0.05 * rng.standard_normal(N)
    first = the_obstacle(recorded(op=op, mv=mv), "few_reversals")
    assert "OP never turned round" in first.reason


def test_slow_sampling():
    """Three samples per cycle of OP are too few, and the remedy names the interval."""
    op = 50.0 + 5.0 * np.sin(2 * np.pi * np.arange(600) / 3.1)
    mv = op + 0.3 * rng.standard_normal(600)
    first = the_obstacle(recorded(op=op, mv=mv, interval_s=10.0), "slow_sampling")
    assert "samples per cycle of OP" in first.reason
    assert "Record faster than every 10 s." == first.remedy


def test_compressed_by_a_swinging_door():
    """A position that the historian drew with lines hides the slips, and is refused."""
    door = Compression(role=Role.MV, kind=CompressionKind.SWINGING_DOOR, deviation=1.0)
    first = the_obstacle(plant(compression=(door,)), "compressed")
    assert "the historian compressed the position" in first.reason
    assert "compression off" in first.remedy


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_coarse_position_is_not_compressed(step):
    """Rounding is not compression: samples on a lattice are not drawn lines."""
    for S, J in ((5.0, 2.0), (0.3, 0.0)):
        recording = plant(S, J)
        mv = np.round(recording.signals[Role.MV].values / step) * step
        assert () == seen(recorded(op=recording.op.values, mv=mv)).obstacles


@pytest.mark.parametrize("share", [0.1, 0.25])
def test_a_frozen_run_is_masked(share):
    """A frozen stretch of a noisy position is left out, remarked, and costs the grade."""
    mv, last = MV.copy(), 1000 + round(share * N)
    mv[1000:last] = mv[1000]
    assessment = seen(recorded(mv=mv))
    assert [(1000, last)] == frozen_runs(recorded(mv=mv))
    assert abs(assessment.frozen_share - share) < 0.01
    quality = assessment.recording.signals[Role.MV].quality
    assert (quality[1001:last] == Quality.BAD).all()
    assert Quality.GOOD == quality[1000] == quality[last]
    assert "C" == assessment.quality.grade
    assert any("was frozen for" in reason for reason in assessment.quality.reasons)


@pytest.mark.parametrize("percent", [35, 47, 67])
def test_frozen_too_long(percent):
    """A position frozen for longer than bad samples may last carries no verdict, and the freeze is
    the only reason: its samples are not called missing as well.
    """
    mv = MV.copy()
    mv[600 : 600 + N * percent // 100] = mv[600]
    assessment = seen(recorded(mv=mv))
    assert ["position_frozen"] == [obstacle.slug for obstacle in assessment.obstacles]
    assert f"frozen for {percent} % of the time" in assessment.obstacles[0].reason
    assert "D" == assessment.quality.grade
    assert not any("left out" in reason for reason in assessment.quality.reasons)


@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(10.0, 3.0), (8.0, 8.0), (5.0, 2.0), (0.3, 0.0)])
def test_a_stem_at_rest_is_not_frozen(shape, step):
    """A coarse position that repeats itself while the stem sticks is evidence, not a fault."""
    recording = plant(*shape)
    mv = np.round(recording.signals[Role.MV].values / step) * step
    assert [] == frozen_runs(recorded(op=recording.op.values, mv=mv))


def test_a_coarse_position_can_freeze():
    """A coarse position that repeats itself while OP moves far beyond its usual rests is frozen."""
    recording = plant(0.3, 0.0)
    mv = np.round(recording.signals[Role.MV].values / 0.1) * 0.1
    mv[1000:2000] = mv[1000]
    runs = frozen_runs(recorded(op=recording.op.values, mv=mv))
    assert 1 == len(runs)
    assert abs(runs[0][0] - 1000) <= 3
    assert abs(runs[0][1] - 2000) <= 3


def test_one_impossible_sample_is_masked():
    """A single 1e300 among percents is left out, and the rest of the record kept."""
    mv = MV.copy()
    mv[1700] = 1e300
    assessment = seen(recorded(mv=mv))
    assert () == assessment.obstacles
    assert Quality.RANGE == assessment.recording.signals[Role.MV].quality[1700]
    assert N - 1 == assessment.recording.usable.sum()


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        (ClockFacts(gaps=2, longest_gap_s=61.0), "2 gaps, the longest 61 s"),
        (ClockFacts(gaps=1, longest_gap_s=61.0), "1 gap of 61 s"),
        (ClockFacts(repeated_times=3), "3 repeated times, 0 steps backward"),
        (ClockFacts(repeated_times=1, backward_steps=1), "1 repeated time, 1 step backward"),
        (ClockFacts(jitter_s=0.4), "the clock jitters by 0.4 s"),
    ],
)
def test_clock_remarks(clock, words):
    """What the source's clock did is remarked and costs grade A."""
    assessment = seen(replace(plant(), clock=clock))
    assert ("B", (words,)) == (assessment.quality.grade, assessment.quality.reasons)


def test_coarse_and_saturated_are_remarked():
    """Coarse steps and a command at its limit make grade C."""
    op = np.clip(np.round(OP + 45.0), 0.0, 100.0)
    reasons = seen(recorded(op=op, mv=np.clip(MV + 45.0, 0.0, 100.0))).quality.reasons
    assert any("OP is recorded in steps of 1 %" in reason for reason in reasons)
    assert any("OP is at its limit for" in reason for reason in reasons)


def test_pieces_with_holes_between_them_are_screened_and_said():
    """Half of the record was never taken: each piece is fitted from its own start, and a hole is no
    fault of the archive."""
    piece = np.arange(N) % 900 < 450
    assessment = seen(recorded(op=np.where(piece, OP, np.nan), mv=np.where(piece, MV, np.nan)))
    assert assessment.obstacles == ()
    text = "the recording is put together from 4 pieces, each fitted from its own start"
    assert text in assessment.quality.reasons
    assert assessment.quality.grade == "C"


def test_a_position_that_is_missing_within_the_pieces_counts_as_missing():
    """The share is that of what was recorded at all."""
    piece, lost = np.arange(N) % 900 < 450, np.arange(N) % 900 < 200
    recording = recorded(op=np.where(piece, OP, np.nan), mv=np.where(piece & ~lost, MV, np.nan))
    first = the_obstacle(recording, "bad_samples")
    assert first.reason == "44 % of the samples are missing or marked bad"


def test_lines_of_a_known_deviation_are_no_obstacle():
    """What they hide is known, and S's interval holds it."""
    door = Compression(role=Role.MV, kind=CompressionKind.SWINGING_DOOR, deviation=1.0)
    recording = plant(compression=(door,))
    known = {**recording.signals, Role.MV: replace(recording.signals[Role.MV], deviation=1.0)}
    assert () == seen(replace(recording, signals=known)).obstacles
