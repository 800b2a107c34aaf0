"""Facts about a recording without a verdict, one sentence each."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import PERCENT, Quality, Recording, Role, Signal
from stemwatch.models.signals.excitation import at_limits, swing
from stemwatch.models.signals.forensics import longest_repeat, quantum, repeat_share
from stemwatch.models.signals.oscillation import Oscillation, loop_oscillation
from stemwatch.models.words import counted, share

MOST_MINUTES = 180.0  # of a length that is said in minutes
NAMES = {Role.OP: "OP", Role.MV: "The position", Role.PV: "PV", Role.SP: "The set point"}


def _unit(signal: Signal) -> str:
    return f" {signal.unit}" if signal.unit else ""


def _coarse(name: str, signal: Signal) -> list[str]:
    """Resolution, repeats, codes: what the archive left of the signal."""
    sentences = []
    finite = signal.values[np.isfinite(signal.values)]
    codes = float(np.mean(signal.quality == Quality.CODE)) if signal.values.size else 0.0
    if codes > 0.01:
        sentences.append(
            f"{name} holds state codes instead of values in {share(codes)} of the samples."
        )
    if finite.size < 10:
        return [*sentences, f"{name} has hardly any usable sample."]
    if float(np.ptp(finite)) == 0.0:
        return [*sentences, f"{name} is constant at {finite[0]:.4g}{_unit(signal)}."]
    repeats = repeat_share(signal.values)
    if repeats > 0.3:
        run = longest_repeat(signal.values)
        sentences.append(
            f"{name} repeats its last value in {share(repeats)} of the samples, up to {run} in a "
            "row: it is coarse, compressed or held."
        )
    step, swing_percent = quantum(signal.values), swing(signal.values)
    if step > 0.02 * swing_percent:
        sentences.append(f"{name} is recorded in steps of {step:.3g}{_unit(signal)}.")
    return sentences


def _cycles(oscillations: dict[Role, Oscillation]) -> list[str]:
    regular = {role: seen for role, seen in oscillations.items() if seen.regular}
    if not regular:
        return ["No regular oscillation was found."]
    sentences = []
    for role, seen in regular.items():
        spec = ".3g" if seen.period_s < 1000.0 else ".0f"
        sentences.append(
            f"{NAMES[role]} oscillates regularly, every {seen.period_s:{spec}} s (regularity "
            f"{seen.regularity:.1f}, above 1 is regular)."
        )
    if Role.OP in regular:
        sentences.append("A sticking valve, tight tuning and a disturbance can all do this.")
    return sentences


def _limits(recording: Recording) -> list[str]:
    if recording.op.unit != PERCENT:
        return [f"OP is in {recording.op.unit or 'an unknown unit'}, not in percent."]
    op = recording.op.values[np.isfinite(recording.op.values)]
    if not op.size:
        return []
    sentences = []
    for limited, end in zip(at_limits(op), ("lower", "upper"), strict=True):
        if limited > 0.05:
            sentences.append(f"OP is at its {end} limit for {share(limited)} of the time.")
    if op.min() < -10.0 or op.max() > 110.0:
        sentences.append(f"OP runs from {op.min():.4g} to {op.max():.4g}: it is not in percent.")
    return sentences


def _not_controlled(recording: Recording) -> list[str]:
    """That PV never comes near its set point."""
    pv, set_point = recording.get(Role.PV), recording.get(Role.SP)
    if pv is None or set_point is None or pv.unit != set_point.unit:
        return []
    both = pv.usable & set_point.usable
    error = (pv.values - set_point.values)[both]
    if error.size < 10 or error.min() <= 0.0 <= error.max():
        return []
    nearest = float(np.abs(error).min())
    if nearest <= float(np.ptp(pv.values[both])):
        return []
    return [
        f"PV stays {nearest:.3g}{_unit(pv)} and more from its set point, farther than it moves: "
        "this loop does not hold it. Another controller, OP at a limit, or tags of two loops make "
        "such a record."
    ]


def _long(seconds: float) -> str:
    minutes = seconds / 60.0
    if minutes < MOST_MINUTES:
        return counted(round(minutes), "minute")
    return counted(round(minutes / 60.0), "hour")


def facts_without_verdict(recording: Recording) -> tuple[str, ...]:
    """Sentences that hold without a verdict: movement, oscillation, limits, archive."""
    sentences = [
        f"OP moved over a range of {swing(recording.op.values):.3g}{_unit(recording.op)} in "
        f"{_long(recording.duration_s)}.",
        *_cycles(loop_oscillation(recording)),
        *_limits(recording),
        *_not_controlled(recording),
    ]
    for role in (Role.OP, Role.PV, Role.MV):
        signal = recording.get(role)
        if signal is not None:
            sentences += _coarse(NAMES[role], signal)
    set_point = recording.get(Role.SP)
    if set_point is not None and swing(set_point.values) > 0.0:
        sentences.append("The set point moved during the recording.")
    return tuple(sentences)
