"""Which recorded signal is the command of a position, and at which delay: judged by how much of the
position a sticking stem explains.

A few stick-slip elements are run over a command, resynchronised at the start of each block of time
as in a fit, and the least loss is divided by that of a stem that never moves. With the valve's own
command the ratio is 0.03 to 0.3, however much it sticks; with the command of another valve or
another hour it is near 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.statistics.cross_correlation import lagged_products
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.events import events_of
from stemwatch.models.stickslip.first_look import FirstLook
from stemwatch.models.stickslip.hypotheses import actuator_grid
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.rests import Rests

# Samples by which a command is shifted, positive towards earlier times. BEFORE keeps the stem
# behind its command; AFTER lets it move first by a little, as where only clocks differ.
BEFORE = (0.0, -1.0, -3.0, -5.0)
AFTER = (1.0, 3.0)
FAR = (20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 240.0, 300.0, 420.0, 600.0)
ABOUT = np.linspace(0.8, 1.25, 10)  # times the best shift, or the best S, of those tried
SHARES = np.linspace(0.0, 1.0, 12) ** 1.6  # of the widest S
RATIOS = (0.0, 0.3, 0.6, 1.0)  # J/S
# The most that a top speed leaves of the loss of a stem that never moves, where it explains the
# position: 44 of 48 windows of 12 simulated valves that vent slowly leave less (seeds 5151 to
# 9393). Of 16 kinds of wrong tags and clocks, 54 valves each (5151 to 9393), those of which
# friction leaves half and more leave 0.27 and more; a position that is 60 s late comes nearest.
TOP_SPEED_LEAVES = 0.24
LONG_LAGS = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0)  # samples
SLOWNESSES = np.geomspace(0.35, 5.0, 8)  # s per %, of a valve that has a low top speed
ZEROS = np.linspace(-0.6, 0.6, 13)  # percent
NEVER_MOVES = 50.0  # times the swing of OP


@dataclass(frozen=True)
class BestShift:
    """What is ``left`` of the loss of a stem that never moves, with the command brought forward by
    ``samples``, by an element of ``S`` percent."""

    left: float
    samples: float
    S: float = 0.0


@dataclass(frozen=True)
class Pairing:
    """A position with a command that may be its own."""

    evaluator: StickSlipEvaluator
    candidates: Floats
    still: float  # loss of a stem that never moves

    @classmethod
    def of(cls, recording: Recording, first_look: FirstLook | None = None) -> Pairing | None:
        """The pairing of a recording's OP and MV; ``None`` where one of the two hardly moves, or
        nothing can be scored. ``first_look`` saves time where it has been made already.
        """
        first_look = first_look or FirstLook.of(recording)
        if first_look is None or float(np.ptp(first_look.evaluator.problem.mv)) <= 0.0:
            return None
        evaluator, base = first_look.evaluator, first_look.base
        problem = evaluator.problem
        stuck = base.copy()
        stuck[coordinate.S_PERCENT] = NEVER_MOVES * problem.swing
        still_loss = _loss(evaluator, problem, stuck[None, :])
        return cls(evaluator, _elements(evaluator, base), still_loss) if still_loss > 0.0 else None

    @property
    def slips_to_its_command(self) -> bool:
        """Whether the slips alone show that the stem follows this command, and without a delay of
        minutes: it rests while the command goes on, and jumps towards it.
        """
        problem = self.evaluator.problem
        if not Rests.of(problem).of_position:
            return False
        return events_of(problem, self.candidates[0]).of_this_command

    def explained(self, samples: Sequence[float]) -> BestShift:
        """The best over commands shifted earlier by each of ``samples``."""
        problem = self.evaluator.problem
        shifts = [self._best_of_elements(_shifted(problem, shift), shift) for shift in samples]
        return min(shifts, key=lambda shift: shift.left)

    def _best_of_elements(self, problem: FitProblem, samples: float) -> BestShift:
        """The best of all elements, and then of those with an S near its own: between two S that
        are tried a stem with play and little noise explains next to nothing of its own movement.
        """
        losses = _losses(self.evaluator, problem, self.candidates)
        best = self.candidates[int(np.argmin(losses))]
        near = np.tile(best, (ABOUT.size, 1))
        near[:, coordinate.S_PERCENT] *= ABOUT
        near_losses = _losses(self.evaluator, problem, near)
        if near_losses.min() < losses.min():
            losses, best = near_losses, near[int(np.argmin(near_losses))]
        S = float(best[coordinate.S_PERCENT])
        return BestShift(float(losses.min()) / self.still, samples, S)

    def by_a_slow_actuator(self) -> float:
        """The share of the loss that is left by a dead time, a lag and a speed limit in place of
        friction, or by friction behind two equal long lags in series.
        """
        problem = self.evaluator.problem
        actuator_loss = _loss(
            self.evaluator, problem, actuator_grid(self.evaluator, self.candidates[0])
        )
        behind = (
            replace(problem, op=first_order_lag(first_order_lag(problem.op, lag), lag))
            for lag in LONG_LAGS
        )
        losses = (_loss(self.evaluator, lagged, self.candidates) for lagged in behind)
        return min(actuator_loss, *losses) / self.still

    @property
    def has_top_speed(self) -> bool:
        """Whether a low top speed alone shows that the stem follows this command: one whose exhaust
        is blocked is far from it for minutes, always on one side.
        """
        return self.by_a_top_speed() <= TOP_SPEED_LEAVES

    def by_a_top_speed(self) -> float:
        """The share of the loss that is left by a top speed in one direction or in both, in place
        of friction.
        """
        best = self._best(self._with_top_speeds(SLOWNESSES))
        finer = np.tile(best, (ABOUT.size, 1))
        finer[:, [coordinate.SLOW_UP, coordinate.SLOW_DOWN]] *= ABOUT[:, None]
        best = self._best(finer)
        # The middle of OP - MV was not the reading's zero.
        zeros = np.tile(best, (ZEROS.size, 1))
        zeros[:, coordinate.ZERO] += ZEROS
        return _loss(self.evaluator, self.evaluator.problem, zeros) / self.still

    def _best(self, candidates: Floats) -> Floats:
        """(9,) the best of ``candidates`` (m, 9), within the limits."""
        within = self.evaluator.bounds.clip(candidates)
        losses = _losses(self.evaluator, self.evaluator.problem, within)
        return np.asarray(within[int(np.argmin(losses))])

    def _with_top_speeds(self, slownesses: Floats) -> Floats:
        """(m, 9) candidates without friction, by direction and by the reading's zero: OP - MV lies
        on one side, so that its middle is not the zero.
        """
        problem, free = self.evaluator.problem, np.zeros(slownesses.size)
        off = (problem.mv - problem.op)[problem.scored]
        zeros = (float(self.candidates[0, coordinate.ZERO]), 0.0, float(np.median(off)))
        limited = []
        for zero in zeros:
            for up, down in ((slownesses, free), (free, slownesses), (slownesses, slownesses)):
                candidates = np.tile(self.candidates[0], (slownesses.size, 1))
                candidates[:, coordinate.SLOW_UP], candidates[:, coordinate.SLOW_DOWN] = up, down
                candidates[:, coordinate.ZERO] = zero
                limited.append(candidates)
        return np.vstack(limited)

    def far_away(self) -> BestShift:
        """The best over commands from 20 to 600 samples earlier or later."""
        problem = self.evaluator.problem
        furthest = problem.op.size / 3.0
        samples_tried = [
            shift for shift in (*FAR, *_where_moves_agree(problem)) if FAR[0] <= shift <= furthest
        ]
        if not samples_tried:
            return BestShift(np.inf, 0.0)
        best = self.explained(
            [direction * shift for shift in samples_tried for direction in (1.0, -1.0)]
        )
        return self.explained([best.samples, *np.round(best.samples * ABOUT)])


def paired(recording: Recording, command: Role, position: Role) -> Pairing | None:
    """The pairing with two of the recorded signals as command and position, in percent both."""
    first, second = recording.get(command), recording.get(position)
    if first is None or second is None:
        return None
    unit = recording.op.unit
    signals = {Role.OP: replace(first, unit=unit), Role.MV: replace(second, unit=unit)}
    wired = replace(recording, signals={**recording.signals, **signals})
    return Pairing.of(wired) if wired.usable.any() else None


def _elements(evaluator: StickSlipEvaluator, base: Floats) -> Floats:
    """(m, 9) over S and J/S, the first without either."""
    widths, ratios = np.meshgrid(
        evaluator.bounds.high[coordinate.S_PERCENT] * SHARES, RATIOS, indexing="ij"
    )
    elements = np.tile(base, (widths.size, 1))
    elements[:, coordinate.S_PERCENT] = widths.ravel()
    elements[:, coordinate.RATIO] = ratios.ravel()
    return elements


def _losses(evaluator: StickSlipEvaluator, problem: FitProblem, candidates: Floats) -> Floats:
    """(m,) mean losses."""
    losses, counts = replace(evaluator, problem=problem).block_losses(candidates)
    return np.asarray(losses.sum(axis=1) / max(counts.sum(), 1.0))


def _loss(evaluator: StickSlipEvaluator, problem: FitProblem, candidates: Floats) -> float:
    return float(_losses(evaluator, problem, candidates).min())


def _shifted(problem: FitProblem, samples: float) -> FitProblem:
    """The problem with its command shifted earlier; beyond the edge the last value is held."""
    if samples == 0.0:
        return problem
    shifted_index = np.clip(np.arange(problem.op.size) + round(samples), 0, problem.op.size - 1)
    return replace(problem, op=problem.op[shifted_index])


def _where_moves_agree(problem: FitProblem) -> tuple[float, ...]:
    """Samples, either way, by which the moves of command and position agree best."""
    furthest = int(min(FAR[-1], problem.op.size / 3.0))
    if furthest <= FAR[0]:
        return ()
    moves = [np.diff(values) for values in (problem.op, problem.mv)]
    near_shift = int(FAR[0])
    return tuple(
        float(near_shift + np.argmax(lagged_products(first, second, furthest)[near_shift:]))
        for first, second in (moves, moves[::-1])
    )
