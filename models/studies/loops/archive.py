"""What an archive keeps of a simulated loop: thinned, averaged, compressed, held, late."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats

_COMPRESSED = 0.12  # of signals
_HELD = 0.1  # of records: every second or third row repeats the one before
_AVERAGED = 0.25
_LATE = 0.15  # of records: PV was stored one row after the OP of the same time
_SPIKED = 0.03


def archived(
    signals: tuple[Floats, Floats, Floats], first: int, stride: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """OP, PV and SP, (n,) each, as stored once in ``stride`` scans from scan ``first`` on."""
    averaged = stride > 1 and rng.random() < _AVERAGED
    count = (signals[0].size - first) // stride
    op, pv, sp = (_thinned(signal[first:], stride, count, averaged) for signal in signals)
    if rng.random() < _SPIKED:
        bad_samples = rng.integers(0, pv.size, 1 + pv.size // 400)
        pv[bad_samples] += rng.standard_normal(bad_samples.size) * 3.0 * np.std(pv)
    op, pv = _compressed(op, rng), _compressed(pv, rng)
    if rng.random() < _HELD:
        is_held = rng.random(count) < rng.uniform(0.1, 0.6)
        is_held[0] = False
        last = np.maximum.accumulate(np.where(is_held, 0, np.arange(count)))
        op, pv, sp = op[last], pv[last], sp[last]
    if rng.random() < _LATE:
        late = 1 if rng.random() < 0.5 else -1
        pv = np.roll(pv, late)
        op, pv, sp = op[1:-1], pv[1:-1], sp[1:-1]
    return op, pv, sp


def _thinned(values: Floats, stride: int, count: int, averaged: bool) -> Floats:
    values = values[: count * stride].reshape(count, stride)
    return np.asarray(values.mean(axis=1) if averaged else values[:, 0].copy())


def _compressed(values: Floats, rng: np.random.Generator) -> Floats:
    """Exception reporting: a value is kept where it differs from the last kept one by more than a
    deviation; between, values are held or, as from an interpolating historian, on a straight line.
    """
    if rng.random() > _COMPRESSED:
        return values
    deviation = float(rng.uniform(0.02, 0.25)) * float(np.std(values))
    stored = [0]
    for k, value in enumerate(values):
        if abs(value - values[stored[-1]]) > deviation:
            if k - 1 > stored[-1]:
                stored.append(k - 1)  # so that a straight line does not smear a jump
            stored.append(k)
    places = np.arange(values.size)
    if rng.random() < 0.5:
        return np.asarray(np.interp(places, stored, values[stored]))
    last = np.searchsorted(stored, places, side="right") - 1
    return np.asarray(values[stored][last])
