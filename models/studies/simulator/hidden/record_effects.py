"""Hidden effects of the record: rounding, compression, uneven sampling, a frozen transmitter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    HiddenEffect,
    Sizes,
    with_archive,
    with_transmitters,
)
from stemwatch.models.studies.simulator.loop import Compression, CompressionKind, PlantLoop, Span


def with_steps(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    """``loop`` with position and OP rounded to steps in percent."""
    return with_transmitters(
        loop, position_step=sizes["position_percent"], op_step=sizes["op_percent"]
    )


def with_swinging_door(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    """``loop`` with the position, and OP where asked, behind a swinging door."""
    roles = [(Role.MV, sizes["position_percent"]), (Role.OP, sizes["op_percent"])]
    doors = tuple(
        Compression(role=role, kind=CompressionKind.SWINGING_DOOR, deviation=deviation)
        for role, deviation in roles
        if deviation > 0.0
    )
    return with_archive(loop, compression=doors)


def draw_steps(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    """Steps of 0.25 to 1 % of the position, of OP in half of the records."""
    op = float(rng.choice([0.1, 0.25])) if rng.random() < 0.5 else 0.0
    return {"position_percent": float(rng.choice([0.25, 0.4, 0.5, 0.5, 1.0])), "op_percent": op}


def draw_deviation(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    """A door of 0.3 to 0.6 % for the position, a narrower one for OP in a third of the records."""
    op = float(rng.uniform(0.1, 0.3)) if rng.random() < 0.33 else 0.0
    return {"position_percent": float(rng.uniform(0.3, 0.6)), "op_percent": op}


def _unevenness(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    if rng.random() < 0.7:
        return {"jitter_s": float(rng.uniform(0.8, 3.0)), "average_s": 0.0}
    return {"jitter_s": 0.0, "average_s": float(rng.choice([3.0, 5.0, 10.0]))}


def _freeze(rng: np.random.Generator, loop: PlantLoop) -> Sizes:
    """One to three stretches, a fifth to a half of the record in all."""
    count = int(rng.integers(1, 4))
    share = float(rng.uniform(0.2, 0.5)) / count
    sizes = {}
    for index in range(count):
        start = (index + float(rng.uniform(0.05, 0.95 - share * count))) / count
        sizes[f"start_{index}_s"] = start * loop.duration_s
        sizes[f"stop_{index}_s"] = min(start + share, 1.0) * loop.duration_s
    return sizes


def _frozen(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    spans = tuple(
        Span(
            start_s=sizes[f"start_{index}_s"],
            stop_s=sizes[f"stop_{index}_s"],
            role=Role.MV,
        )
        for index in range(len(sizes) // 2)
    )
    return with_archive(loop, frozen=spans)


RECORD_EFFECTS = (
    HiddenEffect(slug="quantisation", draw=draw_steps, apply=with_steps),
    HiddenEffect(slug="historian_compression", draw=draw_deviation, apply=with_swinging_door),
    HiddenEffect(
        slug="sampling_jitter",
        draw=_unevenness,
        apply=lambda loop, sizes: with_archive(
            loop, position_jitter_s=sizes["jitter_s"], average_s=sizes["average_s"]
        ),
    ),
    HiddenEffect(slug="frozen_signal", draw=_freeze, apply=_frozen),
)
