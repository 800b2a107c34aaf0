"""What is drawn behind MV against OP: the curve from OP to stroke, and the stick band of S and J.

The report, the pages, the PDF and the figures of a notebook all draw what stands here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats
from stemwatch.models.screening_result import Screening
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.presenter.wording import finite

CURVE, BAND = "curve from OP to stroke", "stick band of S and J"
FEWEST_TURNS = 4  # of the command from which its usual turns are known
SLIDE_POINTS = 40  # of a slide along a bent curve


@dataclass(frozen=True)
class LoopShapes:
    """``curve`` (k, 2) and the corners of ``band`` (m, 2), OP and MV in percent; ``None`` where
    there is none. ``caption`` is the curve's sentence, with the plant file's line for it."""

    curve: Floats | None = None
    band: Floats | None = None
    caption: str = ""

    def lines(self) -> list[dict[str, Any]]:
        """Both as plain types for a page's scripts, the band first."""
        named = (("band", BAND, self.band), ("curve", CURVE, self.curve))
        return [
            {
                "role": role,
                "label": label,
                "op": np.round(shape[:, 0], 3).tolist(),
                "values": np.round(shape[:, 1], 3).tolist(),
            }
            for role, label, shape in named
            if shape is not None
        ]


def loop_shapes(screening: Screening, op: Floats, mv: Floats) -> LoopShapes:
    """The curve and the band over the samples ``op`` (n,) and ``mv`` (n,) in percent."""
    both_finite, curve = np.isfinite(op) & np.isfinite(mv), screening.stroke_curve
    if not both_finite.any():
        return LoopShapes()
    op, mv = op[both_finite], mv[both_finite]
    if curve is None:
        return LoopShapes(band=stick_band(screening.S, screening.J, op, mv))
    command = curve.command(op)
    # The stem's mean position between its slides gives the offset of the whole band.
    band = stick_band(screening.S, screening.J, command, mv, curve)
    low, high = np.percentile(op, [1.0, 99.0])
    knots = np.array(curve.op)
    op_grid = np.unique(np.concatenate(([low], knots[(knots > low) & (knots < high)], [high])))
    line = np.column_stack((op_grid, curve.command(op_grid) + _zero(command, mv)))
    curve_sentence, proposal = curve.sentence(), curve.proposal()
    if proposal:
        curve_sentence += f" In the plant file: {proposal}"
    return LoopShapes(curve=line, band=band, caption=curve_sentence)


def _zero(command: Floats, mv: Floats) -> float:
    """Half-way between the two slides, whichever of them the stem spent longer on."""
    return 0.5 * float(np.sum(np.percentile(mv - command, [2.0, 98.0])))


def _turns(command: Floats, S: float) -> tuple[float, float]:
    """Where the command usually turns round, below and above, percent: the medians of its turns of
    at least ``S``. A few large moves in a long record say nothing of the loops between them; where
    it hardly turns, the ends of its swing."""
    low, high = (float(end) for end in np.percentile(command, [1.0, 99.0]))
    if not S > 0.0:
        return low, high
    turning_points = reversals(command, S)
    if turning_points.size < FEWEST_TURNS:
        return low, high
    turns = command[turning_points]
    is_top = turns > command[np.concatenate((turning_points[1:], [command.size - 1]))]
    if is_top.all() or not is_top.any():
        return low, high
    bottom, top = float(np.median(turns[~is_top])), float(np.median(turns[is_top]))
    return (bottom, top) if top - bottom > S else (low, high)


def stick_band(
    of_S: Estimate,
    of_J: Estimate,
    command: Floats,
    mv: Floats,
    curve: StrokeCurve | None = None,
) -> Floats | None:
    """(m, 2) corners of the loop that S and J describe between the usual turns of OP, percent.

    The stem slides at ``command - (S - J) / 2`` upwards and ``command + (S - J) / 2`` downwards;
    after a turn it rests until the command has moved S, and then jumps J to the other side.
    ``None`` where S or J is not known or OP's swing is too small to leave the band.
    """
    S, J = finite(of_S.value), finite(of_J.value)
    if S is None or J is None:
        return None
    scale = 1.0 if curve is None else abs(curve.slope)
    S, J = scale * S, scale * J
    low, high = _turns(command, S)
    if not 0.0 < S < high - low:
        return None
    zero, slide = _zero(command, mv), 0.5 * (S - J)
    top, bottom = high + zero - slide, low + zero + slide
    if curve is None:
        return np.asarray(
            (
                (high, top),
                (high - S, top),
                (high - S, top - J),
                (low, bottom),
                (low + S, bottom),
                (low + S, bottom + J),
            )
        )
    down, up = np.linspace(high - S, low, SLIDE_POINTS), np.linspace(low + S, high, SLIDE_POINTS)
    commands = np.concatenate(([high, high - S], down, [low + S], up))
    stem = np.concatenate(([top, top], down + zero + slide, [bottom], up + zero - slide))
    return np.column_stack((_op_of(curve, commands), stem))


def _op_of(curve: StrokeCurve, command: Floats) -> Floats:
    """(n,) OP at which the curve asks for ``command``, percent; beyond its ends along its chord."""
    op, travel = np.array(curve.op), np.array(curve.travel)
    if curve.slope < 0.0:
        op, travel = op[::-1], travel[::-1]
    inside_range = np.interp(command, travel, op)
    outside_range = command - np.clip(command, travel[0], travel[-1])
    return np.asarray(inside_range + outside_range / curve.slope)
