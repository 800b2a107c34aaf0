"""The evidence of one loop as numbers: the gain by a stick-slip element, against chance, and wave
shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.without_position import wave_shapes
from stemwatch.models.without_position.hammerstein import HeldOut, block_means, held_out

PER_PERIOD = (25, 60)  # blocks in a period, at the two scales
SIZES = 12  # values of S that are tried
SURROGATES = 9
FEWEST_PERIODS = 4  # in a record; what is slower is drift
_FEWEST_BLOCKS = 120
_COARSE_RATIOS = np.array([0.3, 1.0])
_COARSE_DELAYS = 2
_SPREAD_FLOOR = 0.005

# Few and robust on purpose: with fifty more numbers of shape, a network learned the simulator it
# was trained on and separated the loops of another one worse.
NAMES = (
    *(
        f"{what} at {blocks} to a period"
        for blocks in PER_PERIOD
        for what in (
            "gain of sticking",
            "gain of both",
            "share of folds, sticking",
            "share of folds, both",
            "fit of the linear model",
            "S over amplitude",
            "rise over small S",
        )
    ),
    "gain of both beyond its surrogates",
    "gain of sticking beyond its surrogates",
    "agreement of S at both scales",
    "agreement of S of both models",
    "periods in the record",
    *wave_shapes.NAMES,
)


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The evidence of OP and PV. ``values`` are in the order of ``NAMES``; period in samples;
    amplitude and S in percent of OP.
    """

    values: Floats
    period: float
    amplitude: float
    fine: HeldOut
    coarse: HeldOut
    sizes: Floats


def dominant_period(op: Floats) -> float:
    """The period, in samples, at which f times the power spectrum of ``op`` (n,) peaks, between
    four samples and a quarter of the record."""
    n = op.size
    spectrum = np.abs(np.fft.rfft(op - np.linspace(op[0], op[-1], n))) ** 2
    order = np.arange(spectrum.size)
    low, high = FEWEST_PERIODS, max(n // 4, FEWEST_PERIODS)
    # The spectrum is smoothed over a sixth of an octave, so that a wave with a wandering period is
    # one peak.
    weighted = np.cumsum(np.concatenate([[0.0], spectrum * order]))
    left_edge = np.maximum((order * 0.94).astype(np.int64), 0)
    right = np.minimum((order * 1.06).astype(np.int64) + 1, spectrum.size)
    mean = (weighted[right] - weighted[left_edge]) / (right - left_edge)
    return n / float(low + int(np.argmax(mean[low : high + 1])))


def amplitude_of(op: Floats, period: float) -> float:
    """The median range of ``op`` over windows of one and a half periods, percent; at least a
    thousandth of the whole range."""
    width = int(min(max(1.5 * period, 4.0), op.size))
    starts = range(0, op.size - width + 1, max(width // 2, 1))
    median = float(np.median([np.ptp(op[start : start + width]) for start in starts]))
    return max(median, 1e-3 * float(np.ptp(op)))


def evidence(op: Floats, pv: Floats, *, seed: int = 1) -> Evidence:
    """The evidence of ``op`` and ``pv`` (n,), without holes.

    Raises ``ValueError`` for a record of fewer than ``_FEWEST_BLOCKS`` samples or a still signal.
    """
    if op.size < _FEWEST_BLOCKS or np.ptp(op) <= 0.0 or np.ptp(pv) <= 0.0:
        raise ValueError("too short or still: nothing can be compared")
    # The correlation of PV and OP shows the controller's direction; afterwards PV rises as OP
    # falls.
    if float(np.diff(op) @ np.diff(pv)) > 0.0:
        pv = -pv
    period = dominant_period(op)
    amplitude = amplitude_of(op, period)
    spread = float(np.ptp(op))
    sizes = np.geomspace(0.08 * amplitude, max(min(spread, 3.0 * amplitude), amplitude), SIZES)
    longest_block = max(op.size // _FEWEST_BLOCKS, 1)
    block_lengths = [min(max(1, round(period / blocks)), longest_block) for blocks in PER_PERIOD]
    coarse = held_out(op, pv, block_lengths[0], sizes)
    fine = (
        coarse
        if block_lengths[1] == block_lengths[0]
        else held_out(op, pv, block_lengths[1], sizes)
    )
    gains = _beyond_surrogates(op, pv, block_lengths[0], sizes[2::3], seed)
    values = np.array(
        [
            *_of_scale(coarse, amplitude),
            *_of_scale(fine, amplitude),
            *gains,
            abs(np.log(coarse.S / fine.S)),
            abs(np.log(coarse.S / coarse.S_of_both)),
            np.log(op.size / period),
            *wave_shapes.wave_shapes(
                block_means(op, block_lengths[0]),
                block_means(pv, block_lengths[0]),
                period / block_lengths[0],
            ),
        ]
    )
    return Evidence(
        values=np.nan_to_num(values, nan=0.0, posinf=20.0, neginf=-20.0),
        period=period,
        amplitude=amplitude,
        fine=fine,
        coarse=coarse,
        sizes=sizes,
    )


def _of_scale(gains: HeldOut, amplitude: float) -> list[float]:
    return [
        _squeezed(gains.gain_of_sticking),
        _squeezed(gains.gain_of_both),
        *gains.shares,
        gains.linear_fit,
        float(np.log(gains.S / amplitude)),
        _squeezed(float(gains.curve.max() - gains.curve[:2].max())),
    ]


def _squeezed(value: float) -> float:
    """Compress large values: a gain of 0.03 can be certain, and one of 3 is no more certain than
    one of 1.
    """
    return float(np.arcsinh(value / 0.03))


def _beyond_surrogates(
    op: Floats, pv: Floats, block_length: int, sizes: Floats, seed: int
) -> list[float]:
    """Gains of the models "both" and "sticking" beyond those of surrogates, in standard
    deviations.
    """
    rng = np.random.default_rng(seed)

    def gains(u: Floats, y: Floats) -> tuple[float, float]:
        gain = held_out(u, y, block_length, sizes, _COARSE_RATIOS, _COARSE_DELAYS)
        return gain.gain_of_both, gain.gain_of_sticking

    own_gains = np.array(gains(op, pv))
    others = np.array([gains(*common_phase_surrogate(op, pv, rng)) for _ in range(SURROGATES)])
    in_spreads = (own_gains - others.mean(axis=0)) / (others.std(axis=0) + _SPREAD_FLOOR)
    return [float(number) for number in np.arcsinh(in_spreads)]


def common_phase_surrogate(
    op: Floats, pv: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """``op`` and ``pv`` (n,) with the same random phases added to both spectra.

    Spectra and cross spectrum, and with them every linear model between the two, stay the same;
    what only a stick-slip element would explain is destroyed. The line through the ends is
    subtracted first, because a spectrum sees it as a jump, and added afterwards. Prichard and
    Theiler (1994), doi:10.1103/PhysRevLett.73.951.
    """
    n = op.size
    phases = rng.uniform(0.0, 2.0 * np.pi, n // 2 + 1)
    phases[0] = 0.0
    if n % 2 == 0:
        phases[-1] = 0.0
    turn = np.exp(1j * phases)
    return _turned(op, turn), _turned(pv, turn)


def _turned(values: Floats, turn: np.ndarray) -> Floats:
    line = np.linspace(values[0], values[-1], values.size)
    return np.asarray(np.fft.irfft(np.fft.rfft(values - line) * turn, values.size) + line)
