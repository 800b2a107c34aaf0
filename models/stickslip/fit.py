"""Fit S and J, and the dead time, lag and speed limit that would otherwise bias them.

An unmodelled dead time or actuator lag makes the fitted J vanish and S too wide. So S and J are
always taken from the simplest of three hypotheses (``hypotheses``) that the recording does not
reject in favour of the richest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.signals.forensics import repeat_share
from stemwatch.models.signals.op_in_steps import set_in_steps
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.advantage import Advantage, advantage
from stemwatch.models.stickslip.breakaways import Breakaways
from stemwatch.models.stickslip.evaluator import ALWAYS, ONLY_WHEN_TURNING, StickSlipEvaluator
from stemwatch.models.stickslip.events import SlipEvents, events_of
from stemwatch.models.stickslip.first_look import FirstLook, first_look, loss_scale
from stemwatch.models.stickslip.fitted_slips import is_late, least_jump, slips_of, with_slips
from stemwatch.models.stickslip.hypotheses import fit_each, polish, search, sticking_grid
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.search import SearchResult, best_of

# A richer hypothesis must lower the held-out loss, block by block. The limits are looser than those
# for naming an effect: an unneeded ``both`` costs a little precision of S and J, while ``sticking``
# on a valve with a lag makes them wrong.
MIN_GAIN = 0.03
MIN_T = 0.5
# Share of repeated commands, from which a command that seems held may only be coarsely recorded
COARSE_COMMAND = 0.05
CLEARLY = 0.97  # share of the canonical reading's loss that another reading must reach


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
    trained = fit_each(evaluator, train, base)
    of_actuator, of_sticking = _heldout_gains(evaluator, trained, ~train)
    needs_actuator = of_actuator.mean >= MIN_GAIN and of_actuator.t >= MIN_T
    trained_hypothesis = "both" if needs_actuator else "sticking"
    all_blocks = np.ones(problem.n_blocks, dtype=bool)
    final = polish(evaluator, all_blocks, trained[trained_hypothesis].candidate, trained_hypothesis)
    naive = polish(evaluator, all_blocks, trained["sticking"].candidate, "sticking")
    chosen = with_slips(evaluator, all_blocks, trained_hypothesis, final, naive)
    in_steps = set_in_steps(problem.op[problem.scored], problem.mv[problem.scored])
    if in_steps and chosen.slips is None:
        chosen = chosen._replace(fitted=least_jump(evaluator, chosen.fitted))
    friction_alone = None
    if is_late(evaluator, chosen.fitted):
        friction_alone = slips_of(evaluator, naive.candidate)
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
    return replace(
        readings[best], delta=min(evaluator.delta, loss_scale(evaluator.problem, simulated))
    )


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
