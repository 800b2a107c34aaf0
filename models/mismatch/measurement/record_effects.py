"""What recorder and archive did to the numbers, found before any physics is named.

A frozen reading looks like a sticking stem, and interpolated lines look like a dead time. They are
recognised here from exact repeats and exact straight lines, and the samples that were never
measured are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.findings import RecordEffect
from stemwatch.models.mismatch.measurement.between_samples import Archive
from stemwatch.models.mismatch.measurement.compression import (
    StoredPoints,
    drawn_lines,
    flat_lines,
    held_reports,
)
from stemwatch.models.preparation.own_clock import duration, seconds_of
from stemwatch.models.record_checks.frozen import frozen_samples
from stemwatch.models.recording import Bools, Floats, Recording, Role
from stemwatch.models.signals.forensics import COARSE_PERCENT, coarse_step, position_step, quantum
from stemwatch.models.signals.op_in_steps import op_is_set_in_steps
from stemwatch.models.signals.refresh_period import refresh_period
from stemwatch.models.signals.runs_of_samples import runs_of
from stemwatch.models.stickslip.op_within_steps import WITHIN_STEPS, OpWithinSteps
from stemwatch.models.words import share

MOST_JITTER = 0.1  # of the interval


@dataclass(frozen=True, kw_only=True)
class MeasuredRecord:
    """The record effects, and what is left to score a model on.

    ``frozen`` (n,) is True where the reading of MV stood still by itself. ``real`` (n,) is True
    where MV was measured: stored points only where the archive drew lines or held reports, and no
    frozen sample. ``sigma_floor`` is the least noise of MV that the recorder's
    steps leave, percent: ``step / sqrt(12)``, or ``deviation / sqrt(3)`` of held reports.
    ``spacing_s`` is how far apart true samples are: the interval, or more where the archive
    averaged or the position was scanned slowly. ``slack`` (n,) is how far a value that the archive
    interpolated may lie from the one it dropped, percent, and 0 at all others. ``op_open`` is the
    standard deviation by which OP is not known, percent: ``step / sqrt(12)`` of its recorder's
    steps, ``deviation / sqrt(3)`` of its held reports. ``reported_by``: the deviation of held
    reports of MV or OP, percent, 0 where there are none. ``restore``: S and J may be raised by what
    a slow archive lost of OP's peaks; ``archive`` that one, where it is known.
    """

    effects: tuple[RecordEffect, ...]
    real: Bools
    sigma_floor: float
    spacing_s: float
    slack: Floats
    op_open: float = 0.0
    reported_by: float = 0.0
    restore: bool = True
    archive: Archive | None = None
    frozen: Bools


def measured_record(recording: Recording) -> MeasuredRecord:
    """Find quantisation, historian compression, sampling jitter and frozen readings.

    Takes the recording as it was read, before anything is masked. Without MV only what the clock
    and OP show is found.
    """
    op = recording.op.values
    mv = recording.mv.values if recording.mv is not None else np.full(op.size, np.nan)
    real = np.isfinite(mv)
    # Samples that an archive interpolated or held show neither freezing nor steps, so compression
    # comes first.
    of_mv = _thinned(mv, op)
    if of_mv is not None and recording.mv is not None and recording.mv.deviation is not None:
        of_mv = replace(of_mv, deviation=recording.mv.deviation)
    of_op = drawn_lines(op, mv) if of_mv is not None or _automatic(recording) else None
    stored = of_mv.stored if of_mv is not None else real
    lines = flat_lines(mv, of_mv) if of_mv is not None and not of_mv.held else None
    frozen = frozen_samples(op, mv, recording.interval_s, compressed=of_mv is not None, lines=lines)
    step = _step_of_position(mv[stored & ~frozen], of_mv)
    op_step = coarse_step(op[of_op.stored] if of_op is not None else op)
    if op_step and op_is_set_in_steps(recording):
        op_step = 0.0
    period, refreshed = _refreshed(recording)
    spacing_s = period * recording.interval_s
    door = of_mv.deviation if of_mv is not None and not of_mv.held else 0.0
    effects = (
        _quantisation(step, op_step),
        _compression(of_mv, of_op),
        _jitter(recording, spacing_s),
        _freezing(frozen, recording.interval_s, recording.unit_s),
    )
    deviation = of_mv.deviation if of_mv is not None and of_mv.held else 0.0
    reports = held_reports(op, mv)
    op_deviation = reports.deviation if reports is not None else 0.0
    return MeasuredRecord(
        effects=tuple(effect for effect in effects if effect is not None),
        real=np.asarray(real & stored & ~frozen & refreshed),
        sigma_floor=float(max(step / np.sqrt(12.0), deviation / np.sqrt(3.0))),
        spacing_s=spacing_s,
        slack=np.where(real & ~stored & ~frozen, door, 0.0),
        op_open=float(max(op_step / np.sqrt(12.0), op_deviation / np.sqrt(3.0))),
        reported_by=max(deviation, op_deviation),
        frozen=frozen,
    )


def _step_of_position(measured: Floats, of_mv: StoredPoints | None) -> float:
    """The recorder's step of the ``measured`` values (m,) of a position, percent, 0 without one.

    Where an archive drew lines, its stored points are the bends, which is no sign of noise.
    """
    if of_mv is None or of_mv.held:
        return position_step(measured)
    step = quantum(measured)
    return step if step >= COARSE_PERCENT else 0.0


def _thinned(values: Floats, other: Floats) -> StoredPoints | None:
    """What the archive kept of a signal, or ``None`` where there is no sign that it dropped
    samples.
    """
    lines = drawn_lines(values, other)
    return lines if lines is not None else held_reports(values, other)


def _automatic(recording: Recording) -> bool:
    """True where the loop is known to have been in automatic: an operator's ramps are straight
    lines too.
    """
    mode = recording.get(Role.MODE)
    finite = mode.values[np.isfinite(mode.values)] if mode is not None else np.zeros(0)
    return bool(finite.size and np.all(finite > 0.0))


def _quantisation(step: float, op_step: float) -> RecordEffect | None:
    """Steps of the position's or the command's recorder."""
    if not step and not op_step:
        return None
    sentences, parameters = [], {}
    if step:
        sentences.append(f"the position in steps of {step:.2g} %")
        parameters["step_percent"] = step
    if op_step:
        sentences.append(f"OP in steps of {op_step:.2g} %")
        parameters["op_step_percent"] = op_step
    return RecordEffect(
        slug="quantisation",
        sentence=(
            f"The recorder stores {' and '.join(sentences)}: nothing finer can be seen, and the "
            "noise is taken to be at least that of the rounding."
        ),
        parameters=parameters,
    )


def with_steps_resolved(measured: MeasuredRecord, resolved: OpWithinSteps) -> MeasuredRecord:
    """The record effects with OP as PV and set point resolve it within its recorder's steps."""
    steps = next((one for one in measured.effects if one.slug == "quantisation"), None)
    steps = steps or _quantisation(0.0, resolved.step)
    assert steps is not None
    others = tuple(one for one in measured.effects if one.slug != "quantisation")
    said = replace(steps, sentence=f"{steps.sentence} {WITHIN_STEPS}")
    return replace(measured, effects=(said, *others), op_open=resolved.open)


def _compression(of_mv: StoredPoints | None, of_op: StoredPoints | None) -> RecordEffect | None:
    """Points that the historian dropped, and what it put in their place."""
    sentences, parameters = [], {}
    for stored_points, name, prefix in ((of_mv, "position", ""), (of_op, "OP", "op_")):
        if stored_points is None:
            continue
        archive_text = (
            "held the last between them"
            if stored_points.held
            else "drew straight lines between them"
        )
        sentences.append(
            f"of {name} the historian stored {share(stored_points.kept)} of the samples and "
            f"{archive_text}"
        )
        parameters[f"{prefix}kept_share"] = stored_points.kept
        if stored_points.held:
            parameters[f"{prefix}deviation_percent"] = stored_points.deviation
    if not sentences:
        return None
    text = "; ".join(sentences)
    drawn_mv = of_mv is not None and not of_mv.held
    bound = " and held to the lines within the archive's deviation" if drawn_mv else ""
    advice = f"A model is scored on the stored samples{bound}; export with compression off."
    return RecordEffect(
        slug="historian_compression",
        sentence=f"{text[0].upper()}{text[1:]}. {advice}",
        parameters=parameters,
    )


def _refreshed(recording: Recording) -> tuple[int, Bools]:
    """Samples between refreshes, and (n,) where MV was refreshed.

    Where MV itself changes at the refreshes only, or OP and PV both do: a controller may scan
    slowly, but nothing holds the process.
    """
    everywhere = np.ones(len(recording), dtype=bool)
    if recording.mv is not None:
        period, phase_place = refresh_period(recording.mv.values)
        if period > 1:
            return period, np.arange(len(recording)) % period == phase_place
    pv = recording.get(Role.PV)
    if pv is not None:
        refreshes = {refresh_period(signal.values) for signal in (recording.op, pv)}
        if len(refreshes) == 1:
            return refreshes.pop()[0], everywhere
    return 1, everywhere


def _jitter(recording: Recording, spacing_s: float) -> RecordEffect | None:
    """A clock whose steps are uneven by more than a tenth of the interval, or values that are
    refreshed less often than they are recorded."""
    clock, interval_s, unit_s = recording.clock, recording.interval_s, recording.unit_s
    sentences, parameters = [], {}
    if spacing_s > interval_s:
        sentences.append(
            f"the values change only every {duration(spacing_s, unit_s, 'g')} though there is one "
            f"every {duration(interval_s, unit_s, 'g')}: they are averages, or were scanned slowly"
        )
        parameters["spacing_s"] = seconds_of(spacing_s, "s", unit_s)
    if clock.jitter_s > MOST_JITTER * interval_s:
        sentences.append(
            "the samples are not evenly spaced: their steps scatter by "
            f"{duration(clock.jitter_s, unit_s, '.2g')} about {duration(interval_s, unit_s, 'g')}"
        )
        parameters["jitter_s"] = seconds_of(clock.jitter_s, "s", unit_s)
    if not sentences:
        return None
    text = "; ".join(sentences)
    return RecordEffect(
        slug="sampling_jitter",
        sentence=f"{text[0].upper()}{text[1:]}, so nothing quicker than that can be told.",
        parameters=parameters,
    )


def _freezing(frozen: Bools, interval_s: float, unit_s: float) -> RecordEffect | None:
    """Stretches in which the position reading stood still to the last bit."""
    count = int(np.count_nonzero(frozen))
    if not count:
        return None
    runs = len(runs_of(frozen))
    stretches = "one stretch" if runs == 1 else f"{runs} stretches"
    return RecordEffect(
        slug="frozen_signal",
        sentence=(
            f"The position reading was frozen for {duration(count * interval_s, unit_s)} in "
            f"{stretches} ({share(count / frozen.size)} of the record), which is left out: check "
            "the transmitter and its path to the historian."
        ),
        parameters={
            "frozen_s": seconds_of(count * interval_s, "s", unit_s),
            "frozen_share": count / frozen.size,
            "stretches": float(runs),
        },
    )


def uneven_readings_effect(age_s: float, unit_s: float) -> RecordEffect:
    """The record effect of position readings of uneven age, ``age_s`` units of ``unit_s`` seconds
    on the average and up to twice that."""
    latest_s = 2.0 * age_s
    return RecordEffect(
        slug="sampling_jitter",
        sentence=(
            f"The position is up to {duration(latest_s, unit_s, '.1f')} older than its stamp, in "
            "each sample by another amount: within one move it goes to and fro. A delay this "
            "short cannot be told from it; have OP and position read and stamped by one clock."
        ),
        parameters={"latest_s": seconds_of(latest_s, "s", unit_s)},
    )


def late_effect(late_s: float, unit_s: float) -> RecordEffect:
    """The record effect of an OP stored late by ``late_s`` units of ``unit_s`` seconds."""
    return RecordEffect(
        slug="late_command",
        sentence=(
            f"OP is stored {duration(late_s, unit_s, '.1f')} late: the position moves before its "
            "command. OP is brought forward by as much here; have both tags stored by one clock."
        ),
        parameters={"late_s": seconds_of(late_s, "s", unit_s)},
    )


def small_delay_effect(delay_s: float, unit_s: float) -> RecordEffect:
    """A position that follows OP about a sample late, ``delay_s`` units of ``unit_s`` seconds, for
    people."""
    return RecordEffect(
        slug="small_delay",
        sentence=(
            f"MV follows OP by {duration(delay_s, unit_s, '.1f')}, each time by the same: clocks "
            "of the two tags or a dead time, which about one sample cannot tell apart; no work."
        ),
        parameters={"delay_s": seconds_of(delay_s, "s", unit_s)},
    )


def scan_sentence(recording: Recording) -> str:
    """A sentence on how often OP and position are refreshed, where each has a scan of its own; else
    empty. An OP that its controller holds between scans is the true command, and no record effect.
    """
    if recording.mv is None or op_is_set_in_steps(recording):
        return ""
    op, position = (refresh_period(signal.values)[0] for signal in (recording.op, recording.mv))
    if op == position:
        return ""
    sentences = [
        duration(period * recording.interval_s, recording.unit_s, "g") for period in (op, position)
    ]
    return (
        f"OP changes every {sentences[0]}, the position every {sentences[1]}: each has its own "
        "scan."
    )
