"""The recording that transmitters and historian make of the true signals of a simulated loop.

Noise, rounding, sampling and averaging; compression by swinging door or exception reporting.
"""

from __future__ import annotations

import numpy as np
from numba import njit

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


@njit(cache=True)
def swinging_door(values: Floats, deviation: float) -> Bools:
    """(n,) True at the samples a swinging door keeps.

    From the last kept sample two doors open to ``deviation`` above and below each new sample; when
    they no longer leave a straight way through, the sample before is kept and the doors start
    anew there. Every dropped sample then lies within ``deviation`` of the line between the kept
    ones. The first and the last sample are always kept.
    """
    kept = np.zeros(values.size, dtype=np.bool_)
    kept[0] = True
    kept[values.size - 1] = True
    anchor = 0
    highest, lowest = -np.inf, np.inf
    for i in range(1, values.size):
        span = i - anchor
        rise = values[i] - values[anchor]
        slope = rise / span
        if slope > lowest or slope < highest:
            anchor = i - 1
            kept[anchor] = True
            rise = values[i] - values[anchor]
            highest, lowest = rise - deviation, rise + deviation
            continue
        highest = max(highest, (rise - deviation) / span)
        lowest = min(lowest, (rise + deviation) / span)
    return kept


@njit(cache=True)
def exception_report(values: Floats, deviation: float) -> Floats:
    """(n,) the last reported value; a sample is reported when it is more than ``deviation`` away
    from it."""
    held = np.empty_like(values)
    last = values[0]
    for i in range(values.size):
        if abs(values[i] - last) > deviation:
            last = values[i]
        held[i] = last
    return held


SUFFIX = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV", Role.SP: "SP", Role.MODE: "MODE"}

READS = 20  # samples of the plant in each interval of an archive with jitter or averages


def archived(loop: PlantLoop, columns: dict[Role, Floats], rng: np.random.Generator) -> Recording:
    """The recording of true ``columns`` (n,) in percent (mode 1 or 0), sampled on the clock.

    Where the archive is uneven, OP, MV and PV are (READS n,).
    """
    measured = _measured(loop, _sampled(loop.archive, columns, rng), rng)
    signals = {}
    for role, values in measured.items():
        kept, dropped = _compressed(_frozen(values, role, loop.archive), role, loop.archive)
        quality = _quality(kept.size, role, loop.archive)
        quality[dropped] = Quality.MISSING
        unit = "" if role is Role.MODE else "%"
        signals[role] = Signal(
            values=kept, quality=quality, tag=f"{loop.tag}.{SUFFIX[role]}", unit=unit
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
        place = np.arange(0, fine.size, READS)
        if archive.average_s > 0.0:
            block = max(round(archive.average_s / archive.interval_s), 1) * READS
            sums = np.concatenate([[0.0], np.cumsum(fine)])
            # What is stored is the mean over the last complete block, none before the first.
            stop = np.maximum(place // block * block, 1)
            start = np.maximum(stop - block, 0)
            sampled[role] = (sums[stop] - sums[start]) / (stop - start)
            continue
        if role is Role.MV:
            most = archive.position_jitter_s / archive.interval_s * READS
            place = np.maximum(place - np.round(rng.uniform(0.0, most, place.size)).astype(int), 0)
        sampled[role] = fine[place]
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
    # Drawn whether or not it is used, so that later draws do not depend on it.
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


def _inside(count: int, span: Span, interval_s: float) -> slice:
    return slice(*(min(max(round(t / interval_s), 0), count) for t in (span.start_s, span.stop_s)))


def _frozen(values: Floats, role: Role, archive: SimulatedArchive) -> Floats:
    held = values.copy()
    for span in archive.frozen:
        place = _inside(values.size, span, archive.interval_s)
        if span.role in (None, role) and place.start < place.stop:
            held[place] = held[place.start]
    return held


def _compressed(values: Floats, role: Role, archive: SimulatedArchive) -> tuple[Floats, Bools]:
    """(n,) the values that the archive returns, and where it returns none."""
    dropped = np.zeros(values.size, dtype=np.bool_)
    for compression in archive.compression:
        if compression.role is not role:
            continue
        if compression.kind is CompressionKind.EXCEPTION:
            held = exception_report(values, compression.deviation)
            kept = np.concatenate([[True], held[1:] != held[:-1]])
            values = held
        else:
            kept = swinging_door(values, compression.deviation)
            knots = np.flatnonzero(kept)
            values = np.interp(np.arange(values.size), knots, values[knots])
        if not compression.filled:
            dropped |= ~kept
    return values, dropped


def _quality(count: int, role: Role, archive: SimulatedArchive) -> QualityCodes:
    quality = np.full(count, Quality.GOOD, dtype=np.uint8)
    for spans, code in ((archive.bad, Quality.BAD), (archive.gaps, Quality.MISSING)):
        for span in spans:
            if span.role in (None, role):
                quality[_inside(count, span, archive.interval_s)] = code
    return quality
