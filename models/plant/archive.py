"""What transmitters and historian do to the true signals of a simulated loop."""

from __future__ import annotations

import numpy as np

from stemwatch.models.plant.compression import exception_report, swinging_door
from stemwatch.models.plant.loop import Archive, CompressionKind, PlantLoop, Span
from stemwatch.models.recording import (
    Floats,
    Provenance,
    Quality,
    QualityCodes,
    Recording,
    Role,
    Signal,
)

SUFFIX = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV", Role.SP: "SP", Role.MODE: "MODE"}


def archived(loop: PlantLoop, columns: dict[Role, Floats], rng: np.random.Generator) -> Recording:
    """The recording of true ``columns`` (n,) in percent (mode 1 or 0), sampled on the clock."""
    measured = _measured(loop, columns, rng)
    signals = {}
    for role, values in measured.items():
        kept = _compressed(_frozen(values, role, loop.archive), role, loop.archive)
        quality = _quality(kept.size, role, loop.archive)
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


def _measured(
    loop: PlantLoop, columns: dict[Role, Floats], rng: np.random.Generator
) -> dict[Role, Floats]:
    seen = loop.transmitters
    measured = dict(columns)
    position = measured.pop(Role.MV)
    # Drawn whether or not it is used, so that a valve without transmitter behaves the same.
    noise = rng.standard_normal(position.size) * seen.position_noise
    if seen.has_position:
        reading = seen.position_span * (position - 50.0) + 50.0 + seen.position_zero + noise
        measured[Role.MV] = rounded(reading, seen.position_step)
    measured[Role.OP] = rounded(measured[Role.OP], seen.op_step)
    measured[Role.PV] = rounded(measured[Role.PV], seen.pv_step)
    return measured


def rounded(values: Floats, step: float) -> Floats:
    """``values`` to the nearest multiple of ``step``; unchanged where ``step`` is 0."""
    return np.asarray(np.round(values / step) * step) if step > 0.0 else values


def _inside(count: int, span: Span, interval_s: float) -> slice:
    return slice(*(min(max(round(t / interval_s), 0), count) for t in (span.start_s, span.stop_s)))


def _frozen(values: Floats, role: Role, archive: Archive) -> Floats:
    held = values.copy()
    for span in archive.frozen:
        place = _inside(values.size, span, archive.interval_s)
        if span.role in (None, role) and place.start < place.stop:
            held[place] = held[place.start]
    return held


def _compressed(values: Floats, role: Role, archive: Archive) -> Floats:
    for compression in archive.compression:
        if compression.role is not role:
            continue
        if compression.kind is CompressionKind.EXCEPTION:
            values = exception_report(values, compression.deviation)
        else:
            knots = np.flatnonzero(swinging_door(values, compression.deviation))
            values = np.interp(np.arange(values.size), knots, values[knots])
    return values


def _quality(count: int, role: Role, archive: Archive) -> QualityCodes:
    quality = np.full(count, Quality.GOOD, dtype=np.uint8)
    for spans, code in ((archive.bad, Quality.BAD), (archive.gaps, Quality.MISSING)):
        for span in spans:
            if span.role in (None, role):
                quality[_inside(count, span, archive.interval_s)] = code
    return quality
