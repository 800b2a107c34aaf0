"""How much of a dead band averages hide, and how often that is doubted.

    python tests/benchmarks/bench_averaged_band.py [--valves N] [--seed N]

First a stem without jumps, whose OP has white noise at each scan on a slow wave: how many times as
large S is as the scatter that averages over n scans leave of OP - MV, beside the band that they
still show. Then six hours of valves simulated by force balance at 1 s, with the noise of OP as
drawn and with 0.3 and 0.6 % of it, kept as averages, and as samples, of 10, 30 and 60 s: how often
S below the sticky limit is doubted, and how often steps of OP and set point show what is kept.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from stemwatch.models.decision.shaken_loose import S_averaged
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Floats, Recording, Signal
from stemwatch.models.signals.averages_in_steps import keeps_averages
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky
from tests.benchmarks.bench_shaken_band import hours_of

SCANS = (10, 30, 60)
NOISES = (0.0, 0.3, 0.6)  # percent of OP; 0: as it is drawn
MEANS = 400
SHARES = (1.0, 0.5, 1.0 / 3.0, 0.25)  # of S, that the noise has


def dead_band(op: Floats, S: float) -> Floats:
    """(n,) a stem that stays within S/2 of OP (n,)."""
    stem, place = np.empty_like(op), float(op[0])
    for k, asked in enumerate(op):
        place = min(max(place, asked - 0.5 * S), asked + 0.5 * S)
        stem[k] = place
    return stem


def hidden_in(scans: int, noise: float, rng: np.random.Generator) -> tuple[float, float]:
    """S over the scatter of OP - MV of averages, over the root of their ``scans``, and the share of
    the band that they show; ``noise`` is in units of S."""
    time = np.arange(scans * MEANS) / (12.0 * scans)
    op = 5.0 * np.sin(time) + noise * rng.standard_normal(time.size)
    apart = (dead_band(op, 1.0) - op).reshape(-1, scans).mean(axis=1)
    rises = np.cos(time.reshape(-1, scans).mean(axis=1))
    shown = float(apart[rises < -0.5].mean() - apart[rises > 0.5].mean())
    left = apart + 0.5 * shown * np.sign(rises)
    return 1.0 / (float(left.std()) * np.sqrt(scans)), shown


def stored(recording: Recording, scans: int, *, averaged: bool) -> Recording:
    """The ``recording`` kept as averages or samples of so many ``scans``."""
    count = len(recording) // scans
    signals = {
        role: Signal.good(
            signal.values[: count * scans].reshape(-1, scans).mean(axis=1)
            if averaged
            else signal.values[: count * scans : scans],
            signal.tag,
            signal.unit,
        )
        for role, signal in recording.signals.items()
    }
    return replace(recording, signals=signals, interval_s=scans * recording.interval_s)


def main() -> None:
    """Print the table of the factor, and a line for each kind of valve, noise and archive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    for scans in SCANS:
        found = [hidden_in(scans, share, rng) for share in SHARES]
        cells = ", ".join(
            f"noise of S x {share:.2f}: {factor:.1f} (band shown {shown:.2f})"
            for share, (factor, shown) in zip(SHARES, found, strict=True)
        )
        print(f"averages over {scans} scans, S over scatter and root of the scans, {cells}")
    limit = Limits().sticky_S_percent
    for name, draw in (("healthy", draw_healthy), ("sticking", draw_sticky)):
        for noise in NOISES:
            counts = {True: [0, 0], False: [0, 0]}
            told = {True: [0, 0], False: [0, 0]}
            for number, loop in enumerate(draw(options.valves, options.seed)):
                recording = hours_of(loop, noise, options.seed + number)
                for averaged, seen in counts.items():
                    for scans in SCANS:
                        record = stored(recording, scans, averaged=averaged)
                        by_steps, fit = keeps_averages(record), fit_stickslip(record)
                        small = fit.S < limit
                        seen[0] += small
                        seen[1] += small and S_averaged(fit, fit.S, by_steps) >= limit
                        if by_steps is not None:
                            told[averaged][int(by_steps is not averaged)] += 1
            (means, doubted), (samples, wrongly) = counts[True], counts[False]
            of = len(SCANS) * options.valves
            print(
                f"{name}, noise of OP {f'{noise:g} %' if noise else 'as drawn'}: averages, S below "
                f"{limit:g} % in {means} of {of}, doubted {doubted}; samples, "
                f"{samples}, doubted {wrongly}; steps show averages {told[True][0]} times, samples "
                f"{told[False][0]} times, wrongly {told[True][1]} and {told[False][1]} times",
                flush=True,
            )


if __name__ == "__main__":
    main()
