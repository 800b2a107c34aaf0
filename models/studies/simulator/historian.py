"""The recording that transmitters and historian make of the true signals of a simulated loop.

Noise, rounding, sampling and averaging; compression by swinging door or exception reporting.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import (
    Bools,
    Floats,
    Provenance,
    Quality,
    QualityCodes,
    Recording,
    Role,
    Signal,
)
from stemwatch.models.studies.simulator.loop import (
    CompressionKind,
    PlantLoop,
    SimulatedArchive,
    Span,
    Transmitters,
)


@compiled()
def swinging_door(values: Floats, deviation: float) -> Bools:
    """(n,) True at the samples a swinging door keeps.

    From the last kept sample two doors open to ``deviation`` above and below each new sample; when
    no straight line fits between them, the sample before is kept and the doors start anew there.
    Every dropped sample then lies within ``deviation`` of the line between the kept ones. The first
    and the last sample are always kept.
    """
    is_kept = np.zeros(values.size, dtype=np.bool_)
    is_kept[0] = True
    is_kept[values.size - 1] = True
    anchor = 0
    highest, lowest = -np.inf, np.inf
    for i in range(1, values.size):
        span = i - anchor
        rise = values[i] - values[anchor]
        slope = rise / span
        if slope > lowest or slope < highest:
            anchor = i - 1
            is_kept[anchor] = True
            rise = values[i] - values[anchor]
            highest, lowest = rise - deviation, rise + deviation
            continue
        highest = max(highest, (rise - deviation) / span)
        lowest = min(lowest, (rise + deviation) / span)
    return is_kept


@compiled()
def exception_report(values: Floats, deviation: float) -> Floats:
    """(n,) the last reported value; a sample is reported when it is more than ``deviation`` away
    from it."""
    held_values = np.empty_like(values)
    last = values[0]
    for i in range(values.size):
        if abs(values[i] - last) > deviation:
            last = values[i]
        held_values[i] = last
    return held_values


SUFFIX = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV", Role.SP: "SP", Role.MODE: "MODE"}

READS = 20  # samples of the plant in each interval of an archive with jitter or averages


def archived(loop: PlantLoop, columns: dict[Role, Floats], rng: np.random.Generator) -> Recording:
    """The recording of true ``columns`` (n,) in percent (mode 1 or 0), sampled on the clock.

    Where the archive is uneven, OP, MV and PV are (READS n,).
    """
    measured = _measured(loop, _sampled(loop.archive, columns, rng), rng)
    signals = {}
    for role, values in measured.items():
        is_kept, dropped = _compressed(_frozen(values, role, loop.archive), role, loop.archive)
        quality = _quality(is_kept.size, role, loop.archive)
        quality[dropped] = Quality.MISSING
        unit = "" if role is Role.MODE else "%"
        signals[role] = Signal(
            values=is_kept, quality=quality, tag=f"{loop.tag}.{SUFFIX[role]}", unit=unit
        )
    return Recording(
        valve=loop.tag,
        signals=signals,
        interval_s=loop.archive.interval_s,
        provenance=Provenance(source="simulated plant", layout=loop.story),
    )


def _sampled(
    archive: SimulatedArchive, columns: dict[Role, Floats], rng: np.random.Generator
) -> dict[Role, Floats]:
    """The columns on the archive's clock: read late by chance, or averaged over blocks."""
    if not archive.uneven:
        return columns
    sampled = dict(columns)
    for role in (Role.OP, Role.MV, Role.PV):
        fine = columns[role]
        sample_places = np.arange(0, fine.size, READS)
        if archive.average_s > 0.0:
            block = max(round(archive.average_s / archive.interval_s), 1) * READS
            sums = np.concatenate([[0.0], np.cumsum(fine)])
            # The mean over the last complete block is stored, and nothing before the first.
            stop = np.maximum(sample_places // block * block, 1)
            start = np.maximum(stop - block, 0)
            sampled[role] = (sums[stop] - sums[start]) / (stop - start)
            continue
        if role is Role.MV:
            most_jitter = archive.position_jitter_s / archive.interval_s * READS
            sample_places = np.maximum(
                sample_places
                - np.round(rng.uniform(0.0, most_jitter, sample_places.size)).astype(int),
                0,
            )
        sampled[role] = fine[sample_places]
    return sampled


def reading_of(transmitters: Transmitters, position: Floats) -> Floats:
    """(n,) the transmitter's reading of ``position`` (n,) percent, without noise and walk."""
    record = np.linspace(0.0, 1.0, position.size)
    bow = (
        transmitters.position_bow * np.sin(np.pi * position / 50.0)
        if transmitters.position_bow
        else 0.0
    )
    reading = transmitters.position_span * (position - 50.0) + 50.0 + transmitters.position_zero
    return np.asarray(reading + bow + transmitters.position_drift * record)


def _measured(
    loop: PlantLoop, columns: dict[Role, Floats], rng: np.random.Generator
) -> dict[Role, Floats]:
    transmitters = loop.transmitters
    measured = dict(columns)
    position = measured.pop(Role.MV)
    # Drawn even where it is not used, so that later draws do not depend on it.
    noise = rng.standard_normal(position.size) * transmitters.position_noise
    if transmitters.has_position:
        reading = reading_of(transmitters, position) + noise
        if transmitters.position_walk > 0.0:
            walk = np.cumsum(rng.standard_normal(position.size)) / np.sqrt(position.size)
            reading = reading + transmitters.position_walk * walk
        measured[Role.MV] = rounded(reading, transmitters.position_step)
    measured[Role.OP] = rounded(measured[Role.OP], transmitters.op_step)
    measured[Role.PV] = rounded(measured[Role.PV], transmitters.pv_step)
    return measured


def rounded(values: Floats, step: float) -> Floats:
    """``values`` to the nearest multiple of ``step``; unchanged where ``step`` is 0."""
    return np.asarray(np.round(values / step) * step) if step > 0.0 else values


def _samples_inside(count: int, span: Span, interval_s: float) -> slice:
    return slice(*(min(max(round(t / interval_s), 0), count) for t in (span.start_s, span.stop_s)))


def _frozen(values: Floats, role: Role, archive: SimulatedArchive) -> Floats:
    held_values = values.copy()
    for span in archive.frozen:
        part = _samples_inside(values.size, span, archive.interval_s)
        if span.role in (None, role) and part.start < part.stop:
            held_values[part] = held_values[part.start]
    return held_values


def _compressed(values: Floats, role: Role, archive: SimulatedArchive) -> tuple[Floats, Bools]:
    """(n,) the values that the archive returns, and where it returns none."""
    dropped = np.zeros(values.size, dtype=np.bool_)
    for compression in archive.compression:
        if compression.role is not role:
            continue
        if compression.kind is CompressionKind.EXCEPTION:
            held_values = exception_report(values, compression.deviation)
            is_kept = np.concatenate([[True], held_values[1:] != held_values[:-1]])
            values = held_values
        else:
            is_kept = swinging_door(values, compression.deviation)
            knots = np.flatnonzero(is_kept)
            values = np.interp(np.arange(values.size), knots, values[knots])
        if not compression.filled:
            dropped |= ~is_kept
    return values, dropped


def _quality(count: int, role: Role, archive: SimulatedArchive) -> QualityCodes:
    quality = np.full(count, Quality.GOOD, dtype=np.uint8)
    for spans, code in ((archive.bad, Quality.BAD), (archive.gaps, Quality.MISSING)):
        for span in spans:
            if span.role in (None, role):
                quality[_samples_inside(count, span, archive.interval_s)] = code
    return quality
