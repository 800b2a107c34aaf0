"""Fit S and J, and the dead time, lag and speed limit that would otherwise bias them.

Three hypotheses share one kernel and nest in one another:

- ``sticking``: S, J alone,
- ``actuator``: dead time, lag and speed limit without any friction,
- ``both``.

An unmodelled dead time or actuator lag makes the fitted J vanish and S too wide. So S and J are
always taken from the simplest hypothesis that the recording does not reject in favour of ``both``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.signals.forensics import repeat_share
from stemwatch.models.signals.op_in_steps import set_in_steps
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.breakaways import (
    LEAST_J,
    SLOW_SAMPLES,
    Breakaways,
    breakaways,
    seen_breakaways,
)
from stemwatch.models.stickslip.events import SlipEvents, events_of
from stemwatch.models.stickslip.parameters import Bounds, bounds, to_kernel
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.stickslip.search import Loss, SearchResult, best_of, refine

SEED = 20051
# A richer hypothesis must lower the held-out loss, block by block. The limits are looser than those
# for naming an effect: an unneeded ``both`` costs a little precision of S and J, while ``sticking``
# on a valve with a lag makes them wrong.
MIN_GAIN = 0.03
MIN_T = 0.5

# When a moving stem sticks again, %/s of the actuator.
CANONICAL, ALWAYS, ONLY_WHEN_TURNING = 0.0, np.inf, -1e-9
# Share of repeated commands, from which a command that seems held may only be coarsely recorded
COARSE_COMMAND = 0.05
# Loss of a search that began at the S and J of the slips, as a share of the fit's, up to which the
# slips decide which of the two is right.
AS_GOOD = 1.1
LESS = np.linspace(1.0, 0.0, 21)  # shares by which a jump is tried smaller, none at last
NO_WORSE = 1.01  # times the loss of the fit, up to which another is as good
CLEARLY = 0.97  # share of the canonical reading's loss that another reading must reach


@dataclass(frozen=True)
class FreeCoordinates:
    """A named set of free coordinates."""

    name: str
    free: tuple[int, ...]


STICKING = FreeCoordinates("sticking", coordinate.STICKING)
BOTH = FreeCoordinates("both", coordinate.STICKING + coordinate.ACTUATOR)


@dataclass(frozen=True)
class StickSlipEvaluator:
    """The problem with the settings that every search on it shares."""

    problem: FitProblem
    bounds: Bounds
    delta: float  # scale of the robust loss, percent
    restick: float  # %/s, see the kernel
    free_gain: bool

    def loss(self, blocks: Bools) -> Loss:
        """The mean robust loss over the chosen blocks as a function of candidates."""

        chosen = replace(self, problem=self.problem.only(blocks))

        def value(candidates: Floats) -> Floats:
            losses, counts = chosen.block_losses(candidates)
            return np.asarray(losses[:, blocks].sum(axis=1) / max(counts[blocks].sum(), 1.0))

        return value

    def block_losses(self, candidates: Floats) -> tuple[Floats, Floats]:
        """Robust losses (m, n_blocks) of candidates (m, 9), and the samples (n_blocks,) in them."""
        return self.problem.losses(to_kernel(candidates, self.restick), self.delta)

    def simulate(self, candidate: Floats, *, resynced: bool = False) -> Floats:
        """(n,) MV in percent of a ``candidate`` (9,) by a free run.

        ``resynced``: reset to the measurement at the start of each block of time, as in the fit.
        """
        q = to_kernel(candidate, self.restick)[0]
        return self.problem.simulate(q, resynced=resynced)

    def spread(self, free: tuple[int, ...], scale: float) -> Floats:
        """(9,) widths of a search over the free coordinates and the reading's own."""
        full = (self.bounds.high - self.bounds.low) * scale
        width = np.zeros(coordinate.N_COORDINATES)
        coordinates = [*free, *coordinate.READING, *((coordinate.GAIN,) if self.free_gain else ())]
        width[coordinates] = full[coordinates]
        return width


def _reading(problem: FitProblem) -> tuple[float, float]:
    """First guess of (gain - 1, zero) from the axes of the OP-MV loop."""
    op, mv = problem.op[problem.scored], problem.mv[problem.scored]
    if problem.mv_is_percent:
        # Friction holds the stem within a band that is as wide above the command as below. Medians
        # would be biased by a stem that rests long on one side of it.
        low, high = np.percentile(mv - op, (2.0, 98.0))
        return 0.0, float(low + high) / 2.0
    span = float(np.ptp(np.percentile(op, (2.0, 98.0))))
    gain = float(np.ptp(np.percentile(mv, (2.0, 98.0)))) / span if span > 0 else 1.0
    if op.std() > 0.0 and mv.std() > 0.0 and np.corrcoef(op, mv)[0, 1] < 0:
        gain = -gain
    return gain - 1.0, float(np.median(mv) - gain * np.median(op))


def sticking_grid(evaluator: StickSlipEvaluator, base: Floats) -> Floats:
    """(m, 9) candidates over S, J/S and the reading's zero, around ``base``."""
    # Widths below the swing matter most, and a valve with a wide swing may have a small S.
    widths = evaluator.bounds.high[coordinate.S_PERCENT] * np.linspace(0.0, 1.0, 23) ** 1.6
    ratios = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3])
    zeros = evaluator.problem.swing * np.array([-0.06, 0.0, 0.06, 0.0])
    if evaluator.problem.mv_is_percent:
        zeros[3] = -base[coordinate.ZERO]  # a reading without an offset is tried as well
    grid = np.array(np.meshgrid(widths, ratios, zeros, indexing="ij")).reshape(3, -1).T
    candidates = np.tile(base, (grid.shape[0], 1))
    candidates[:, coordinate.S_PERCENT] = grid[:, 0]
    candidates[:, coordinate.RATIO] = grid[:, 1]
    candidates[:, coordinate.ZERO] += grid[:, 2]
    return candidates


def actuator_grid(evaluator: StickSlipEvaluator, base: Floats) -> Floats:
    """(m, 9) candidates over dead time, lag and slowness in each direction."""
    dt = evaluator.problem.interval_s
    dead_times = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0]) * max(dt, 1.0)
    lags = np.array([0.0, 0.7, 1.5, 3.0, 6.0]) * max(dt, 1.0)
    slow = np.array([0.0, 0.1, 0.35, 1.0])
    grid = np.array(np.meshgrid(dead_times, lags, slow, slow, indexing="ij")).reshape(4, -1).T
    candidates = np.tile(base, (grid.shape[0], 1))
    candidates[:, coordinate.DEAD_TIME_S] = grid[:, 0]
    candidates[:, coordinate.LAG_UP_S] = candidates[:, coordinate.LAG_DOWN_S] = grid[:, 1]
    candidates[:, coordinate.SLOW_UP] = grid[:, 2]
    candidates[:, coordinate.SLOW_DOWN] = grid[:, 3]
    return evaluator.bounds.clip(candidates)


def search(
    evaluator: StickSlipEvaluator,
    loss: Loss,
    starts: list[SearchResult],
    free: tuple[int, ...],
    scale: float,
    rounds: int,
) -> SearchResult:
    """The best candidate that seeded searches over ``free`` find from ``starts``.

    ``scale`` is the width of the first round as a share of the bounds.
    """
    rng = np.random.default_rng(SEED)
    spread = evaluator.spread(free, scale)
    fits = [
        refine(loss, start.candidate, spread, evaluator.bounds, rng, rounds=rounds)
        for start in starts
    ]
    return min(fits, key=lambda fit: fit.loss)


def _joint_grid(evaluator: StickSlipEvaluator, sticking: Floats) -> Floats:
    """(m, 9) candidates that replace part of the sticking by a lag and a dead time."""
    unit = max(evaluator.problem.interval_s, 1.0)
    widths = sticking[coordinate.S_PERCENT] * np.array([0.5, 0.75, 1.0])
    ratios = np.array([0.0, 0.2, 0.5, 1.0])
    lags = unit * np.array([0.7, 1.5, 3.0, 6.0])
    dead_times = unit * np.array([0.0, 1.0, 2.0])
    grid = np.array(np.meshgrid(widths, ratios, lags, dead_times, indexing="ij")).reshape(4, -1).T
    candidates = np.tile(sticking, (grid.shape[0], 1))
    candidates[:, coordinate.S_PERCENT] = grid[:, 0]
    candidates[:, coordinate.RATIO] = grid[:, 1]
    candidates[:, coordinate.LAG_UP_S] = candidates[:, coordinate.LAG_DOWN_S] = grid[:, 2]
    candidates[:, coordinate.DEAD_TIME_S] = grid[:, 3]
    return evaluator.bounds.clip(candidates)


def _both_starts(
    sticking: SearchResult, actuator: SearchResult, loss: Loss, evaluator: StickSlipEvaluator
) -> list[SearchResult]:
    """Starts for the joint search: each part alone, and each with a grid over the other."""
    over_actuator = sticking_grid(evaluator, actuator.candidate)[1::4]  # with its own zero only
    over_sticking = _joint_grid(evaluator, sticking.candidate)
    return [
        sticking,
        actuator,
        *best_of(loss, over_actuator, keep=2),
        *best_of(loss, over_sticking, keep=2),
    ]


def _fit_all(evaluator: StickSlipEvaluator, blocks: Bools, base: Floats) -> dict[str, SearchResult]:
    """The best candidate of each hypothesis on the chosen blocks."""
    loss = evaluator.loss(blocks)
    starts = best_of(loss, sticking_grid(evaluator, base), keep=4)
    sticking = search(evaluator, loss, starts, coordinate.STICKING, 0.06, 7)
    starts = best_of(loss, actuator_grid(evaluator, base), keep=2)
    actuator = search(evaluator, loss, starts, coordinate.ACTUATOR, 0.08, 8)
    starts = _both_starts(sticking, actuator, loss, evaluator)
    both = search(evaluator, loss, starts, BOTH.free, 0.06, 9)
    both = search(evaluator, loss, [both], BOTH.free, 0.02, 9)
    # For a fair comparison the simpler hypothesis restarts from the S and J of the richer one.
    of_sticking = [coordinate.S_PERCENT, coordinate.RATIO, coordinate.ZERO]
    candidate = sticking.candidate.copy()
    candidate[of_sticking] = both.candidate[of_sticking]
    restart = [SearchResult(candidate, np.inf)]
    restarted = search(evaluator, loss, restart, coordinate.STICKING, 0.03, 6)
    sticking = min(sticking, restarted, key=lambda fit: fit.loss)
    return {"sticking": sticking, "actuator": actuator, "both": both}


@dataclass(frozen=True)
class Advantage:
    """How much better a richer model is on the blocks it was not fitted to."""

    mean: float  # mean log ratio of the block losses
    t: float  # mean / (standard error + 0.01)


def advantage(
    simple: Floats, rich: Floats, counts: Floats, delta: float, op_open: float = 0.0
) -> Advantage:
    """Compare two models block by block on what neither was fitted to.

    ``l = clip(log((simple + fl) / (rich + fl)), -2, 2)`` per block with ``fl = 1e-3 delta^2 +
    op_open^2``; neither one missed slip nor the uncertainty of OP from its recorder (``op_open``,
    percent) can dominate. With fewer than three filled blocks the result is (0, 0).
    """
    filled = counts > 0
    floor = 1e-3 * delta * delta + op_open * op_open
    ratio = (simple[filled] / counts[filled] + floor) / (rich[filled] / counts[filled] + floor)
    log = np.clip(np.log(ratio), -2.0, 2.0)
    if log.size < 3:
        return Advantage(0.0, 0.0)
    mean = float(log.mean())
    return Advantage(mean, float(mean / (log.std(ddof=1) / np.sqrt(log.size) + 0.01)))


def S_and_J(candidate: Floats) -> tuple[float, float]:
    """S and J of a candidate (9,), percent of OP span."""
    S = float(candidate[coordinate.S_PERCENT])
    return S, S * float(candidate[coordinate.RATIO])


@dataclass(frozen=True)
class StickSlipFit:
    """The chosen model of a valve and the evidence for it.

    ``candidate`` (9,) is fitted to the whole record, ``trained`` (9,) to the first part only;
    ``of_actuator`` and ``of_sticking`` are the gains on the held-out part from either half of
    ``both``.
    """

    evaluator: StickSlipEvaluator
    hypothesis: str
    candidate: Floats
    trained: Floats
    of_actuator: Advantage
    of_sticking: Advantage
    naive: Floats  # (9,) S and J alone, on the whole record
    first_heldout: int  # first sample of the held-out part
    breakaways: Breakaways | None = None
    # Jumps that are seen although the run is best without one: they may be those of a stem that
    # creeps with its command.
    unneeded: Breakaways | None = None
    # Those of friction alone, where a lag may have taken the place of part of it.
    alone: Breakaways | None = None
    # OP was set in steps and the stem moved at each of them, as in a stroke test.
    in_steps: bool = False

    @property
    def S(self) -> float:
        """Dead band plus stick band, percent of OP span: that of the mean breakaway where there are
        enough slips, else the candidate's.
        """
        return self.breakaways.S if self.breakaways else S_and_J(self.candidate)[0]

    @property
    def J(self) -> float:
        """Slip jump, percent of OP span; as ``S``."""
        return self.breakaways.J if self.breakaways else S_and_J(self.candidate)[1]

    @property
    def events(self) -> SlipEvents:
        """The slips of the recording, measured against its way and its command."""
        return events_of(self.evaluator.problem, self.candidate)

    def heldout(self, *, resynced: bool = False) -> Floats:
        """(n,) free run of MV with the parameters of the training part.

        ``resynced``: reset to the measurement at the start of each block of time, as in the fit.
        """
        return self.evaluator.simulate(self.trained, resynced=resynced)


def _scaled(problem: FitProblem, base: Floats, delta: float) -> StickSlipEvaluator:
    """The evaluator with bounds about ``base`` (9,) and a loss of scale ``delta``, percent."""
    free_gain = not problem.mv_is_percent
    limits = bounds(problem.swing, problem.interval_s, float(base[coordinate.ZERO]), free_gain)
    if free_gain:
        gain = float(base[coordinate.GAIN]) + 1.0
        limits.low[coordinate.GAIN], limits.high[coordinate.GAIN] = sorted(
            (0.6 * gain - 1.0, 1.7 * gain - 1.0)
        )
        reach = abs(gain) * 0.5 * problem.swing
        limits.low[coordinate.ZERO] = base[coordinate.ZERO] - reach
        limits.high[coordinate.ZERO] = base[coordinate.ZERO] + reach
    return StickSlipEvaluator(
        problem=problem, bounds=limits, delta=delta, restick=CANONICAL, free_gain=free_gain
    )


def _scale(problem: FitProblem, simulated: Floats) -> float:
    """Scale of the robust loss: three times the noise, or the bulk of the residual."""
    residual = (problem.mv - simulated)[problem.scored]
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return max(3.0 * problem.sigma, spread, 0.05)


def first_look(problem: FitProblem) -> tuple[StickSlipEvaluator, Floats]:
    """An evaluator scaled by a first look, and the base candidate (neutral but for the reading)."""
    base = np.zeros(coordinate.N_COORDINATES)
    base[coordinate.GAIN], base[coordinate.ZERO] = _reading(problem)
    spread = float(np.std(problem.mv[problem.scored]))
    evaluator = _scaled(problem, base, max(3.0 * problem.sigma, 0.1 * spread, 0.05))
    all_blocks = np.ones(problem.n_blocks, dtype=bool)
    best = best_of(evaluator.loss(all_blocks), sticking_grid(evaluator, base))[0]
    delta = _scale(problem, evaluator.simulate(best.candidate))
    return _scaled(problem, base, min(delta, evaluator.delta * 3.0)), base


@dataclass(frozen=True)
class FirstLook:
    """The common start of all fits of one recording in percent of travel: an evaluator of its
    problem, and the base candidate (9,).
    """

    evaluator: StickSlipEvaluator
    base: Floats

    @classmethod
    def of(cls, recording: Recording) -> FirstLook | None:
        """``None`` where OP does not move, or nothing can be scored."""
        if recording.mv is None:
            return None
        problem = make_problem(recording)
        if not problem.scored.any() or problem.swing <= 0.0:
            return None
        return cls(*first_look(problem))


def _resticking(evaluator: StickSlipEvaluator, base: Floats, blocks: Bools) -> StickSlipEvaluator:
    """Choose when a moving stem sticks again: the canonical element, unless another reading of the
    model is clearly better on the training part.

    The scale of the loss is then that of the chosen reading's residual.
    """
    readings = [evaluator, replace(evaluator, restick=ALWAYS)]
    if repeat_share(evaluator.problem.op) >= COARSE_COMMAND:
        readings.append(replace(evaluator, restick=ONLY_WHEN_TURNING))
    fits = []
    for reading in readings:
        loss = reading.loss(blocks)
        starts = best_of(loss, sticking_grid(reading, base), keep=2)
        fits.append(search(reading, loss, starts, coordinate.STICKING, 0.06, 5))
    best = int(np.argmin([fit.loss for fit in fits]))
    if fits[best].loss >= CLEARLY * fits[0].loss:
        best = 0
    simulated = readings[best].simulate(fits[best].candidate, resynced=True)
    return replace(readings[best], delta=min(evaluator.delta, _scale(evaluator.problem, simulated)))


def fit_stickslip(
    recording: Recording, unsure_degree: int = 0, first: FirstLook | None = None
) -> StickSlipFit:
    """Fit the three hypotheses and choose; raises ``ValueError`` without MV or usable samples.

    The choice is made on the held-out part: ``both`` is kept only where it beats ``sticking``
    (then the actuator matters) and ``actuator`` (then friction matters) block by block.
    ``unsure_degree`` is that of the curve through which OP was read (``StrokeCurve``), ``first``
    the first look at this recording where there was one.
    """
    evaluator, base = _start(recording, unsure_degree, first)
    problem = evaluator.problem
    train = problem.training_blocks()
    evaluator = _resticking(evaluator, base, train)
    trained = _fit_all(evaluator, train, base)
    of_actuator, of_sticking = _heldout_gains(evaluator, trained, ~train)
    needs_actuator = of_actuator.mean >= MIN_GAIN and of_actuator.t >= MIN_T
    trained_hypothesis = "both" if needs_actuator else "sticking"
    all_blocks = np.ones(problem.n_blocks, dtype=bool)
    final = _polish(
        evaluator, all_blocks, trained[trained_hypothesis].candidate, trained_hypothesis
    )
    naive = _polish(evaluator, all_blocks, trained["sticking"].candidate, "sticking")
    chosen = _with_slips(evaluator, all_blocks, trained_hypothesis, final, naive)
    in_steps = set_in_steps(problem.op[problem.scored], problem.mv[problem.scored])
    if in_steps and chosen.slips is None:
        chosen = chosen._replace(fitted=_least_jump(evaluator, chosen.fitted))
    friction_alone = None
    if _is_late(evaluator, chosen.fitted):
        friction_alone = _breakaways(evaluator, naive.candidate)
    return StickSlipFit(
        evaluator=evaluator,
        hypothesis=chosen.hypothesis,
        candidate=chosen.fitted.candidate,
        trained=trained[chosen.hypothesis].candidate,
        of_actuator=of_actuator,
        of_sticking=of_sticking,
        naive=naive.candidate,
        first_heldout=int(np.ceil(problem.op.size * train.sum() / problem.n_blocks)),
        breakaways=chosen.slips,
        unneeded=chosen.unneeded,
        alone=friction_alone,
        in_steps=in_steps,
    )


def _start(
    recording: Recording, unsure_degree: int, first: FirstLook | None
) -> tuple[StickSlipEvaluator, Floats]:
    """The evaluator and the base candidate (9,) from which all hypotheses are fitted."""
    problem = make_problem(recording) if first is None else first.evaluator.problem
    problem = replace(problem, unsure_degree=unsure_degree)
    if not problem.scored.any():
        raise ValueError(f"{recording.valve}: no usable pair of OP and MV to fit to")
    if first is None:
        return first_look(problem)
    return replace(first.evaluator, problem=problem), first.base


def _heldout_gains(
    evaluator: StickSlipEvaluator, trained: dict[str, SearchResult], heldout: Bools
) -> tuple[Advantage, Advantage]:
    """What ``both`` gains on the held-out blocks over ``sticking``, by the actuator, and over
    ``actuator``, by friction.
    """
    names = list(trained)
    losses, counts = evaluator.block_losses(np.array([trained[name].candidate for name in names]))
    heldout_losses = {name: losses[i, heldout] for i, name in enumerate(names)}

    def gain_over(simple: str) -> Advantage:
        return advantage(
            heldout_losses[simple], heldout_losses["both"], counts[heldout], evaluator.delta
        )

    return gain_over("sticking"), gain_over("actuator")


class _Chosen(NamedTuple):
    """The hypothesis that is published, fitted to the whole record; its ``slips``, and slips that
    are seen although it needs none.
    """

    hypothesis: str
    fitted: SearchResult
    slips: Breakaways | None
    unneeded: Breakaways | None = None


def _with_slips(
    evaluator: StickSlipEvaluator,
    all_blocks: Bools,
    hypothesis: str,
    final: SearchResult,
    naive: SearchResult,
) -> _Chosen:
    """The slips of the ``final`` fit of ``hypothesis``; another fit where the slips show it.

    ``naive`` is that of S and J alone.
    """
    slips = _breakaways(evaluator, final.candidate)
    if S_and_J(final.candidate)[1] < LEAST_J:
        slips_of_jumps = _breakaways_of_jumps(evaluator, naive.candidate)
        if slips_of_jumps is not None:
            return _Chosen("sticking", naive, slips_of_jumps)
    if slips is None and hypothesis == "sticking":
        return _Chosen(hypothesis, *_begun_at_slips(evaluator, all_blocks, final))
    return _Chosen(hypothesis, final, slips)


def _is_late(evaluator: StickSlipEvaluator, fitted: SearchResult) -> bool:
    """Whether the fitted dead time and lag add up to a sample or more."""
    return _late_s(fitted.candidate) >= SLOW_SAMPLES * evaluator.problem.interval_s


def _late_s(candidate: Floats) -> float:
    """The dead time and the mean lag of a candidate (9,), in the recording's unit of time."""
    lag_s = 0.5 * (candidate[coordinate.LAG_UP_S] + candidate[coordinate.LAG_DOWN_S])
    return float(candidate[coordinate.DEAD_TIME_S] + lag_s)


def _breakaways(evaluator: StickSlipEvaluator, candidate: Floats) -> Breakaways | None:
    """The slips of the recording, read as a candidate (9,) does; ``None`` where they are few."""
    gain, zero = 1.0 + float(candidate[coordinate.GAIN]), float(candidate[coordinate.ZERO])
    if gain == 0.0:
        return None
    S, J = S_and_J(candidate)
    without_friction = candidate.copy()
    without_friction[list(coordinate.STICKING)] = 0.0
    unhindered = evaluator.simulate(without_friction)
    return breakaways(evaluator.problem, gain, zero, S, J, _late_s(candidate), unhindered)


def _breakaways_of_jumps(evaluator: StickSlipEvaluator, candidate: Floats) -> Breakaways | None:
    """The breakaways where the stem is seen to rest and jump although the best fit has no jump:
    where it slips every few minutes only, a run that misses some slips has the least loss without
    any.
    """
    events = events_of(evaluator.problem, candidate)
    gain, zero = 1.0 + float(candidate[coordinate.GAIN]), float(candidate[coordinate.ZERO])
    if not events.evident or gain == 0.0:
        return None
    S, J = S_and_J(candidate)[0], events.size / abs(gain)
    return breakaways(evaluator.problem, gain, zero, S, J)


def _least_jump(evaluator: StickSlipEvaluator, fitted: SearchResult) -> SearchResult:
    """The smallest S and J with the same dead band S - J that are as good as the ``fitted`` ones:
    a step moves the stem as far whatever smaller breakaway level it has exceeded.
    """
    S, J = S_and_J(fitted.candidate)
    jumps = J - min(S, J) * LESS
    candidates = np.tile(fitted.candidate, (jumps.size, 1))
    widths = S - J + jumps
    candidates[:, coordinate.S_PERCENT] = widths
    candidates[:, coordinate.RATIO] = jumps / np.maximum(widths, 1e-9)
    candidates = evaluator.bounds.clip(candidates)
    losses, counts = evaluator.block_losses(candidates)
    means = losses.sum(axis=1) / max(counts.sum(), 1.0)
    best = int(np.flatnonzero(means <= NO_WORSE * means[-1])[0])
    return SearchResult(candidates[best], float(means[best]))


def _begun_at_slips(
    evaluator: StickSlipEvaluator, blocks: Bools, fitted: SearchResult
) -> tuple[SearchResult, Breakaways | None, Breakaways | None]:
    """The fit of a search that begins at the S and J of the slips, with these, where their level is
    not the ``fitted`` one and this fit is about as good; else ``fitted``, and the slips that it
    does not need where it has no jump.

    Where a slip comes some samples late or early by chance, a run with another S and J may have the
    least loss, or the search may end there: the slips do not depend on a run.
    """
    S, J = S_and_J(fitted.candidate)
    gain, zero = 1.0 + float(fitted.candidate[coordinate.GAIN]), fitted.candidate[coordinate.ZERO]
    if gain == 0.0:
        return fitted, None, None
    seen = seen_breakaways(evaluator.problem, gain, zero, max(J, LEAST_J))
    if seen is None and J >= LEAST_J:
        # A fitted jump larger than all that are seen leaves none of them.
        size = events_of(evaluator.problem, fitted.candidate).size / abs(gain)
        if LEAST_J <= size < J:
            seen = seen_breakaways(evaluator.problem, gain, zero, size)
    if seen is None or (J >= LEAST_J and seen.near(0.5 * (S + J))):
        return fitted, None, None
    start = fitted.candidate.copy()
    start[list(coordinate.STICKING)] = seen.S, seen.J / max(seen.S, 1e-9)
    other = _polish(evaluator, blocks, evaluator.bounds.clip(start), "sticking")
    slips = _breakaways(evaluator, other.candidate)
    if slips is not None and other.loss <= AS_GOOD * fitted.loss:
        return other, slips, None
    return fitted, None, seen if J < LEAST_J and seen.near(0.5 * (S + J)) else None


def _polish(
    evaluator: StickSlipEvaluator, blocks: Bools, start: Floats, hypothesis: str
) -> SearchResult:
    """Refit a chosen hypothesis to more blocks, starting from ``start``."""
    free = BOTH.free if hypothesis == "both" else coordinate.STICKING
    loss = evaluator.loss(blocks)
    searches = [
        search(evaluator, loss, [SearchResult(start, np.inf)], free, scale, 7)
        for scale in (0.05, 0.01)
    ]
    return min(searches, key=lambda fit: fit.loss)
