"""The evidence of OP and PV alone: the element, the surrogates, the networks, and the results."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.signal import lfilter

from stemwatch.models.recording import Quality, Recording, Role, Signal
from stemwatch.models.stickslip import kernel
from stemwatch.models.studies.loops.draws import STORIES, draw_loop
from stemwatch.models.studies.loops.examples import example, teaches
from stemwatch.models.studies.loops.random_signals import many_scales
from stemwatch.models.studies.loops.training import train
from stemwatch.models.without_position import trained_weights
from stemwatch.models.without_position.features import (
    NAMES,
    amplitude_of,
    common_phase_surrogate,
    dominant_period,
    evidence,
)
from stemwatch.models.without_position.hammerstein import element, held_out
from stemwatch.models.without_position.network import LoopNetwork, packed, unpacked
from stemwatch.models.without_position.no_sign import NoSignLimit
from stemwatch.models.without_position.suspicion import (
    LEAST_S_PERCENT,
    MOST_SAMPLES,
    SOUND_S_PERCENT,
    Judge,
    Suspicion,
    SuspicionLimits,
    WithoutPosition,
    estimated_S,
    look_at_loop,
    trained_judge,
)
from stemwatch.models.without_position.suspicion import suspect as suspect_by
from stemwatch.models.without_position.windows import (
    LENGTH,
    PER_PERIOD,
    SIGNALS,
    STRETCHES,
    windows,
)


@cache
def few_trained() -> Judge:
    """Networks trained on a few loops, poor but working; trained once, on the first use."""
    shown = [example(5151, index) for index in range(40)]
    no_sign = NoSignLimit(0.0, 0.0, 0.0, by_S=1.0, beyond=0.0, by_amplitude=0.0)
    limits = SuspicionLimits(suspected_from=0.8, no_sign=no_sign)
    network: LoopNetwork = train(
        [item for item in shown if item is not None], seed=1, epochs=10, window_epochs=3
    )
    return Judge(network=network, limits=limits)


def suspect(recording: Recording) -> WithoutPosition:
    """The result for a recording."""
    return suspect_by(recording, few_trained())


def loop_of(op: np.ndarray, pv: np.ndarray | None, unit: str = "%") -> Recording:
    """A recording without a position."""
    signals = {Role.OP: Signal.good(op, "OP", unit)}
    if pv is not None:
        signals[Role.PV] = Signal.good(pv, "PV")
    return Recording(valve="FIC-1", signals=signals, interval_s=1.0)


def drawn(place: int, story: str = "") -> Recording:
    """A loop drawn as those of the training, on a seed of its own."""
    loop = draw_loop(77, place, story)
    return loop_of(loop.op, loop.pv)


@given(
    S=st.floats(0.1, 5.0),
    ratio=st.floats(0.0, 1.0),
    steps=st.lists(st.floats(-2.0, 2.0), min_size=9),
)
def test_the_element_is_the_one_that_positions_are_fitted_with(S, ratio, steps) -> None:
    """The same stem from the same OP, wherever both begin at rest."""
    op = 50.0 + np.concatenate([[0.0], np.cumsum(steps)])
    stem = np.empty(op.size)
    element(op, S, ratio * S, stem)
    q = np.array([S, ratio * S, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 1.0, 0.0])
    assert np.allclose(stem, one_by_one(op, q), atol=1e-9)


def one_by_one(op: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The canonical element, a sample at a time."""
    fs, fd, a_up, a_dn, up, down, _, _ = kernel._constants(q, 1.0)
    p, x, d, moving = op[0], op[0], 1.0, 0.0
    stem = [x]
    for value in op[1:]:
        p, x, d, moving = kernel._advance(
            p, x, d, moving, value, fs, fd, a_up, a_dn, up, down, q[kernel.RESTICK]
        )
        stem.append(x)
    return np.array(stem)


@given(st.integers(0, 1000), st.integers(64, 257))
def test_a_surrogate_keeps_spectra_and_cross_spectrum(seed, size) -> None:
    """So that every linear relation between OP and PV stays as it was."""
    rng = np.random.default_rng(seed)
    op, pv = rng.standard_normal(size), np.cumsum(rng.standard_normal(size))
    other = common_phase_surrogate(op, pv, np.random.default_rng(1))

    def spectra(u, y):
        a, b = (np.fft.rfft(v - np.linspace(v[0], v[-1], size)) for v in (u, y))
        return np.abs(a), np.abs(b), a * np.conj(b)

    # The line through the ends of the surrogate is another one: it is taken off as the first was.
    line = [np.linspace(v[0], v[-1], size) for v in (op, pv)]
    shown = [np.fft.rfft(new - straight) for new, straight in zip(other, line, strict=True)]
    before = spectra(op, pv)
    assert np.allclose(np.abs(shown[0]), before[0], atol=1e-8 * size)
    assert np.allclose(shown[0] * np.conj(shown[1]), before[2], atol=1e-6 * size**2)


def test_a_sticking_element_in_the_loop_is_found_with_its_S() -> None:
    """PV is a filtered stem: the model with the element wins at the S that made it."""
    rng = np.random.default_rng(3)
    op = 50.0 + 4.0 * np.sin(np.arange(3000) / 12.0) + 0.05 * rng.standard_normal(3000)
    stem = np.empty(op.size)
    element(op, 3.0, 1.5, stem)
    pv = lfilter([0.0, 0.2], [1.0, -0.8], stem - 50.0) + 0.02 * rng.standard_normal(op.size)
    result = held_out(op, pv, 3, np.geomspace(0.75, 12.0, 13))
    assert result.gain_of_both > 0.5
    assert 2.3 <= result.S <= 3.9
    sound = lfilter([0.0, 0.2], [1.0, -0.8], op - 50.0) + 0.02 * rng.standard_normal(op.size)
    assert held_out(op, sound, 3, np.geomspace(0.5, 10.0, 12)).gain_of_both < 0.1


@pytest.mark.long
def test_units_and_direction_of_the_loop_change_nothing() -> None:
    """PV in another unit, or a valve that acts the other way round: the same score and S."""
    plain = drawn(0, "load")
    op, pv = plain.op.values, plain.get(Role.PV).values
    suspicion = suspect(plain)
    for other in (loop_of(op, 40.0 + 0.01 * pv), loop_of(op, 100.0 - pv)):
        assert suspect(other).score == pytest.approx(suspicion.score, abs=1e-6)
        assert suspect(other).verdict is suspicion.verdict
    faster = Recording(valve="FIC-1", signals=plain.signals, interval_s=0.01)
    assert suspect(faster).score == suspicion.score


@pytest.mark.parametrize("story", STORIES)
def test_every_kind_of_drawn_loop_gets_an_answer(story) -> None:
    """Sticking and sound loops: numbers are finite, and the result is consistent."""
    for index in (2, 3):
        suspicion = suspect(drawn(index, story))
        assert suspicion.score is None or 0.0 <= suspicion.score <= 1.0
        assert (suspicion.verdict is Suspicion.SUSPECTED) == (
            suspicion.apparent_S.value is not None
        )
        assert (suspicion.verdict is Suspicion.NO_SIGN) == (suspicion.shows_from is not None)
        assert (suspicion.verdict is Suspicion.SUSPECTED) == bool(suspicion.rivals)
        assert suspicion.reason.endswith(".")
        assert suspicion.advice


def test_what_cannot_be_judged_says_why() -> None:
    """No PV, a short record, a dead PV, a still OP, OP at its limit, a PV that is held."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(1000)
    wave = 50.0 + 5.0 * np.sin(np.arange(1000) / 10.0)
    text = {
        "PV is not": loop_of(wave, None),
        "only 100 samples": loop_of(wave[:100], noise[:100]),
        "PV stands at 3.5": loop_of(wave, np.full(1000, 3.5)),
        "OP changed 0 times": loop_of(np.full(1000, 50.0), noise),
        "at its limit": loop_of(np.clip(wave, 45.0, 50.0), noise),
        "repeats its last": loop_of(wave, np.repeat(noise[:100], 10)),
    }
    for reason, recording in text.items():
        answer = suspect(recording)
        assert answer.verdict is Suspicion.CANNOT_TELL
        assert reason in answer.reason
        assert (answer.score is None) == (reason != "repeats its last")


def test_a_doubt_leaves_the_score_but_no_answer() -> None:
    """OP that moves by less than any valve notices: the networks see no scale, the score does."""
    loop = limit_cycle()
    op, pv = loop.op.values, loop.get(Role.PV).values
    tiny = suspect_by(loop_of(50.0 + 0.2 * (op - 50.0) / np.ptp(op), pv), trained_judge())
    assert tiny.verdict is Suspicion.CANNOT_TELL
    assert tiny.likeness == pytest.approx(suspect_by(loop, trained_judge()).likeness, abs=1e-6)
    assert tiny.score is not None
    assert tiny.score < 0.1 * tiny.likeness
    assert "OP changed" in tiny.reason


def test_holes_are_bridged_when_short_and_split_the_record_when_long() -> None:
    """The longest stretch is judged; a sample missing here and there costs nothing."""
    plain = drawn(0, "tight")
    op, pv = plain.op.values, plain.get(Role.PV)
    quality = pv.quality.copy()
    quality[100:2000:150] = Quality.BAD
    values = np.where(quality == Quality.BAD, np.nan, pv.values)
    holed = Recording(
        valve="FIC-1",
        signals={Role.OP: plain.op, Role.PV: Signal(values, quality, "PV")},
        interval_s=1.0,
    )
    assert suspect(holed).score == pytest.approx(suspect(plain).score, abs=0.1)
    half = op.size // 2
    quality = quality.copy()
    quality[half : half + 20] = Quality.BAD
    split = replace(holed, signals={Role.OP: plain.op, Role.PV: Signal(values, quality, "PV")})
    longest = suspect(loop_of(op[:half], pv.values[:half]))
    assert suspect(split).score == pytest.approx(longest.score, abs=0.1)


def test_numpy_and_torch_give_the_same_logits() -> None:
    """What torch trains is what runs without torch."""
    import torch

    from stemwatch.models.studies.loops.training import _Convolutional

    torch.manual_seed(4)
    trained = _Convolutional().eval().double()
    cut = np.random.default_rng(2).standard_normal((len(PER_PERIOD), STRETCHES, SIGNALS, LENGTH))
    expected = trained(torch.tensor(cut[None])).item()
    assert LoopNetwork(trained.arrays()).convolved(cut) == pytest.approx(expected, abs=1e-9)


def test_a_loop_upside_down_is_as_sticky() -> None:
    """The curves have no sense of up."""
    network = trained_judge().network
    loop = draw_loop(77, 2)
    cut = windows(loop.op, loop.pv, loop.sp, dominant_period(loop.op))
    assert network.by_curves(cut) == pytest.approx(network.by_curves(-cut), abs=1e-9)


@given(st.integers(120, 2000), st.floats(4.0, 400.0))
def test_windows_fit_every_record(size, period) -> None:
    """Whatever its length and period."""
    rng = np.random.default_rng(0)
    op, pv = rng.standard_normal(size), rng.standard_normal(size)
    cut = windows(op, pv, None, min(period, size / 4))
    assert cut.shape == (len(PER_PERIOD), STRETCHES, SIGNALS, LENGTH)
    assert np.all(cut[:, :, 2] == 0.0)
    assert np.isfinite(cut).all()
    assert np.allclose(cut[:, :, :2].mean(axis=3), 0.0, atol=1e-6)


def test_windows_keep_how_far_the_set_point_is() -> None:
    """SP lies beside PV, in sizes of PV: OP's ramp while PV stays away from SP is evidence."""
    time = np.arange(2000)
    op, pv = np.cos(time / 9.0), 50.0 + 2.0 * np.sin(time / 9.0)
    cut = windows(op, pv, np.full(2000, 52.0), 2.0 * np.pi * 9.0)
    size = 2.0 / np.sqrt(2.0)
    # the shortest stretch holds no whole number of swings: its mean is not that of PV
    assert np.allclose(np.abs(cut[:2, :, 2]), 2.0 / size, atol=0.05)
    far = windows(op, pv, np.full(2000, 900.0), 2.0 * np.pi * 9.0)
    assert np.all(np.abs(far[:, :, 2]) == 5.0)


def test_what_cannot_be_seen_teaches_nothing() -> None:
    """A sound stem that moves OP as a sticking one does, and a sticking one behind wide swings."""
    loop = draw_loop(77, 0)
    assert teaches(loop, loop.S)
    assert not teaches(loop, 20.0 * loop.S)
    sound = draw_loop(77, 1)
    assert teaches(sound, 20.0 * sound.stem_S)
    assert not teaches(sound, sound.stem_S)


@pytest.mark.long
def test_one_seed_draws_one_loop_in_every_process() -> None:
    """Also where a wave and a neighbour act at once: Python orders a set of words by a key that
    each process draws."""
    code = (
        "from stemwatch.models.studies.loops.draws import draw_loop; loop = draw_loop(11, 585); "
        "print(loop.op.sum(), loop.pv.sum())"
    )
    drawn = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": key},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for key in ("0", "2")
    ]
    assert drawn[0] == drawn[1] != ""


def test_load_on_all_scales_has_a_spectrum_of_one_over_the_frequency() -> None:
    """Each decade of frequency holds about as much of it, and its variance is one."""
    rng = np.random.default_rng(3)
    noise = np.array([many_scales(4000, rng) for _ in range(40)])
    assert np.mean(noise**2) == pytest.approx(1.0, abs=0.3)
    power = (np.abs(np.fft.rfft(noise, axis=1)) ** 2).mean(axis=0)
    decades = [power[first : 10 * first].sum() for first in (2, 20, 200)]
    assert max(decades) < 4.0 * min(decades)


def test_the_period_is_that_of_a_wave_that_wanders() -> None:
    """Within a tenth, beside slow drift and noise."""
    rng = np.random.default_rng(5)
    phase = 2.0 * np.pi * np.arange(2000) / 80.0 + np.cumsum(0.02 * rng.standard_normal(2000))
    op = 50.0 + np.sin(phase) + np.linspace(0.0, 3.0, 2000) + 0.1 * rng.standard_normal(2000)
    assert dominant_period(op) == pytest.approx(80.0, rel=0.1)


def test_evidence_has_a_name_for_every_number() -> None:
    """Signals without movement are refused."""
    loop = draw_loop(77, 0)
    assert evidence(loop.op, loop.pv).values.shape == (len(NAMES),)
    with pytest.raises(ValueError, match="too short or still"):
        evidence(loop.op[:50], loop.pv[:50])


def test_what_is_shipped_is_what_was_trained() -> None:
    """The digest is that of the numbers, and the limits are in order."""
    result = sha256("".join(trained_weights.PACKED.split()).encode()).hexdigest()
    assert result == trained_weights.DIGEST
    limits = trained_judge().limits
    assert 0.5 < limits.suspected_from < 1.0
    assert limits.no_sign.by_S > 0.0
    assert trained_judge().network.arrays["mean"].shape == (len(NAMES),)


def test_the_score_asks_for_more_than_the_S_of_a_sound_stem() -> None:
    """Half of the networks' where S is as likely less; the networks' own where S is surely more or
    OP is in no known unit."""
    loop, judge = draw_loop(77, 0), trained_judge()
    seen = look_at_loop(loop_of(loop.op, loop.pv))
    answer = judge.network.answer(seen.shown.values, seen.windows)
    to_sound = SOUND_S_PERCENT / estimated_S(seen.shown, answer)

    def said(share: float, unit: str = "%") -> WithoutPosition:
        op = 50.0 + share * (loop.op - 50.0)
        return judge.says(replace(look_at_loop(loop_of(op, loop.pv)), unit=unit))

    for share, expected in ((to_sound, 0.5), (20.0 * to_sound, 1.0), (0.05 * to_sound, 0.0)):
        assert said(share).likeness == pytest.approx(answer.score, abs=1e-6)
        assert said(share).score == pytest.approx(expected * answer.score, abs=1e-3)
    assert said(to_sound, unit="mA").score == pytest.approx(answer.score, abs=1e-6)


@pytest.mark.parametrize("place", [1, 3, 5, 9])
def test_no_sign_names_a_smaller_S_where_OP_swings_less(place) -> None:
    """The same loop with half the swing of OP: a smaller S, down to what a sound valve may have.
    No less than half, because an S near that of a sound stem scores less. Where OP swings by less
    than that, it is all of OP's swing."""
    loop = draw_loop(77, place)
    amplitude = amplitude_of(loop.op, dominant_period(loop.op))
    whole, half, tiny = (
        suspect_by(loop_of(50.0 + share * (loop.op - 50.0), loop.pv), trained_judge())
        for share in (1.0, 0.5, 0.5 / amplitude)
    )
    assert whole.verdict is half.verdict is tiny.verdict is Suspicion.NO_SIGN
    assert whole.shows_from is not None
    assert LEAST_S_PERCENT <= half.shows_from <= whole.shows_from
    assert half.shows_from >= 0.5 * whole.shows_from
    # In another unit nobody knows what a sound stem has, and S is a share of OP's swing alone.
    in_unit, half_in_unit = (
        suspect_by(loop_of(50.0 + share * (loop.op - 50.0), loop.pv, "m3/h"), trained_judge())
        for share in (1.0, 0.5)
    )
    assert half_in_unit.shows_from == pytest.approx(0.5 * in_unit.shows_from)
    assert tiny.shows_from == pytest.approx(0.5)
    assert f"sticks by {whole.shows_from:.1f} % of OP or more" in whole.reason


def test_nothing_is_to_do_only_where_a_small_S_would_have_shown() -> None:
    """At most 2 % of OP, and OP is in percent; else a test is worth the way."""
    loop = draw_loop(77, 1)

    def said(share: float, unit: str) -> WithoutPosition:
        op = 50.0 + share * (loop.op - 50.0)
        return suspect_by(loop_of(op, loop.pv, unit), trained_judge())

    for shows, unit, is_done in ((1.9, "%", True), (2.1, "%", False), (1.9, "m3/h", False)):
        share = brentq(lambda of, S=shows, u=unit: said(of, u).shows_from - S, 0.4, 3.0, xtol=1e-3)
        answer = said(share, unit)
        assert answer.shows_from == pytest.approx(shows, abs=0.01)
        assert answer.leaves_nothing_to_do is is_done
        assert answer.advice.startswith("Nothing to do" if is_done else "Do a bump test")


def test_an_S_that_nobody_misses_is_no_answer() -> None:
    """Where OP swings wide, only a large S would have shown: then nothing can be told. In a unit
    that nobody knows the S is named as it is."""
    loop = draw_loop(77, 1)
    wide = 50.0 + 20.0 * (loop.op - 50.0)
    found = suspect_by(loop_of(wide, loop.pv), trained_judge())
    assert found.verdict is Suspicion.CANNOT_TELL
    assert "only a valve that sticks by" in found.reason
    named = suspect_by(loop_of(wide, loop.pv, "m3/h"), trained_judge())
    assert named.verdict is Suspicion.NO_SIGN
    assert "m3/h of OP or more" in named.reason


def test_numbers_come_back_from_text_in_half_precision() -> None:
    """Whatever their shapes and however the lines are broken."""
    arrays = {"a": np.arange(6.0).reshape(2, 3) / 7.0, "b": np.array([1e-3])}
    shapes, text = packed(arrays)
    back = unpacked(shapes, "\n".join([text[:9], text[9:], ""]))
    for name, array in arrays.items():
        assert np.allclose(back[name], array, rtol=2.0**-11, atol=0.0)


def limit_cycle() -> Recording:
    """A loop that plainly limits by a sticking stem, as the training draws them."""
    for index in range(0, 200, 2):
        loop = draw_loop(78, index, "quiet")
        recording = loop_of(loop.op, loop.pv)
        if suspect_by(recording, trained_judge()).verdict is Suspicion.SUSPECTED:
            return recording
    raise AssertionError("no limit cycle of a hundred was suspected")


def test_without_the_scale_of_op_nothing_is_suspected() -> None:
    """Whether S is larger than in a sound valve is unknown; the advice says what would help."""
    percent = limit_cycle()
    op, pv = percent.op.values, percent.get(Role.PV).values
    known = suspect_by(percent, trained_judge())
    for other in (loop_of(op - op.mean(), pv), loop_of(4.0 + 0.16 * op, pv, unit="mA")):
        answer = suspect_by(other, trained_judge())
        assert answer.verdict is Suspicion.CANNOT_TELL
        assert "not in percent" in answer.reason
        assert "low, high" in answer.advice
        assert answer.score == pytest.approx(known.score, abs=1e-6)


def test_a_suspicion_has_a_picture_and_a_sound_filter_has_none() -> None:
    """The stem stays within OP's range and lags it; both models follow PV."""
    recording = limit_cycle()
    suspicion = suspect_by(recording, trained_judge())
    assert suspicion.traces is not None
    assert suspicion.apparent_S.value is not None
    op, pv = recording.op.values, recording.get(Role.PV).values
    assert suspicion.traces.stem.shape == op.shape
    assert (
        op.min() - 1e-9
        <= suspicion.traces.stem.min()
        <= suspicion.traces.stem.max()
        <= op.max() + 1e-9
    )
    for model in (suspicion.traces.linear, suspicion.traces.sticking):
        known = np.isfinite(model)
        assert known.mean() > 0.8
        assert np.corrcoef(model[known], pv[known])[0, 1] > 0.5
    short = suspicion.traces.part(10, 30)
    assert np.array_equal(short.stem, suspicion.traces.stem[10:30])


def test_a_long_record_is_judged_by_its_end() -> None:
    """It takes as long as a short one, with S in the same unit."""
    recording = limit_cycle()
    op, pv = (np.tile(recording.get(role).values, 12) for role in (Role.OP, Role.PV))
    seen = look_at_loop(loop_of(op, pv))
    assert seen.samples <= MOST_SAMPLES
    assert suspect_by(loop_of(op, pv), trained_judge()).score is not None
