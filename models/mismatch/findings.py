"""The result types of a mismatch analysis: what was found where simulation and recording differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import exp
from typing import Any

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.preparation.fit_window import on_whole_clock
from stemwatch.models.recording import PERCENT, Floats, Recording, Role
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

NO_TOP_SPEED = 99.0  # %/s; a top speed from here on means that there is no limit


class Finding(StrEnum):
    """What can be said of a recording's mismatch, in one word."""

    NAMED = "named"  # what is named explains it, and nothing else does as well
    CANDIDATES = "candidates"  # effects that this recording cannot tell apart
    UNKNOWN = "unknown"  # systematic, and nothing in the catalogue explains it
    NONE = "none"  # S and J explain the recording, scatter of the breakaways included
    NOT_TESTABLE = "not_testable"  # the recording could not have shown anything


@dataclass(frozen=True, kw_only=True)
class EffectEvidence:
    """What speaks for an effect: its gain on blocks of time that it was not fitted to.

    ``mean`` is the mean log ratio of the robust losses without and with it, ``t`` its t-like
    value (see ``stickslip.advantage``); ``share`` the share of the squared held-out residual
    that it removes, 0 to 1; ``note`` a sentence with the evidence against its neighbours.
    """

    mean: float
    t: float
    share: float
    strength: float = 1.0  # how far beyond the limits, 1 at the limits
    likelihood_gain: float = 0.0  # of the whole record, that showed it; 0 where the residual did
    events_z: float = 0.0  # normal score of the breakaways that showed it; 0 where the residual did
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Gain:
    """How much better unseen blocks of time are predicted: mean log ratio of the robust losses, and
    its t-like value (see ``stickslip.advantage``)."""

    mean: float
    t: float

    @property
    def lower(self) -> float:
        """The share of the error that goes, ``1 - exp(-mean)``; below 0 where it grows."""
        return 1.0 - exp(-self.mean)


class TriedOutcome(StrEnum):
    """What became of an effect that was tried."""

    NAMED = "named"
    AS_GOOD = "as good"  # explains it as well as what is named: this recording cannot separate them
    ADDS_NOTHING = "adds nothing"  # it helps alone, but not beside what is named
    TOO_SMALL = "too small"  # present, but too small to need work
    CHANCE = "no more than chance"  # gains no more than on recordings with nothing hidden
    NOT_HELD = "does not hold"  # accepted, but unseen samples are predicted no better


@dataclass(frozen=True, kw_only=True)
class TriedEffect:
    """One effect that was tried: its gain alone over S and J, and on top of all that was named,
    ``None`` where that was not tried."""

    slug: str
    alone: Gain
    beside: Gain | None
    outcome: TriedOutcome


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One effect that was left out, accepted and refitted together with S and J."""

    slug: str
    members: tuple[str, ...]  # slugs that this recording cannot separate from it, its own first
    sentence: str  # for a maintenance engineer
    where: str  # where in the record it shows
    check: str  # what to look at in the field
    decide: str  # the test that would separate the members; empty where there is only one
    parameters: Mapping[str, Estimate]
    evidence: EffectEvidence
    inherent: bool = False  # how such a machine is made or may be: see ``Term.inherent``


@dataclass(frozen=True, kw_only=True)
class EffectScore:
    """What one effect would gain on unseen blocks, on top of all that was named beside it.

    ``mean``, ``t`` and ``strength`` as in ``EffectEvidence``. It is there for every effect that the
    recording could have shown, named or not: other recordings of the valve may confirm it.
    """

    slug: str
    mean: float
    t: float
    strength: float


@dataclass(frozen=True, kw_only=True)
class RecordEffect:
    """What recorder and archive did to the numbers; found before any physics is named."""

    slug: str
    sentence: str
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Untestable:
    """An effect that this recording could not have shown, and why not."""

    slug: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One place of a residual map.

    ``share`` of the squared residual, ``weight`` share of the samples, ``mean`` and ``rms`` of the
    residual in percent of span; ``z`` how far the share lies above the weight, by a block
    bootstrap; ``bias_z`` how far the mean lies from zero, by the same.
    """

    facet: str  # "phase", "direction", "rest", "travel", "speed", "time"
    label: str
    samples: int
    weight: float
    share: float
    mean: float
    rms: float
    z: float
    bias_z: float


@dataclass(frozen=True, kw_only=True)
class HotPlace:
    """A cell that holds significantly more residual than its size, in one sentence."""

    facet: str
    label: str
    share: float
    z: float
    sentence: str


@dataclass(frozen=True, kw_only=True)
class ResidualMap:
    """Where the residual is large: cells by facet, and travel (rows) against phase (columns)."""

    cells: tuple[Cell, ...] = ()
    hot: tuple[HotPlace, ...] = ()
    travel_edges: tuple[float, ...] = ()  # percent of MV, rows + 1
    columns: tuple[str, ...] = ()
    grid: tuple[tuple[float | None, ...], ...] = ()  # rms in percent of span; None: no samples


@dataclass(frozen=True, kw_only=True)
class HeldOutFit:
    """The fit before and after on data that the fit did not see.

    Errors in percent of span, fits ``100 (1 - rmse / std(MV))``; ``None`` where too few samples are
    left to compute one. ``gain_low`` and ``gain_high`` are the 95 % interval of ``fit_extended -
    fit_naive``, by a block bootstrap. ``slip_by_slip``: both models let go where the stem was seen
    to, else they run freely. ``alternate_blocks``: unseen are the blocks of time between those that
    were fitted, each by the fit that did not see it; else it is the last part of the record.
    """

    rmse_naive: float | None = None
    rmse_extended: float | None = None
    rmse_ceiling: float | None = (
        None  # of the NARX network: how much of the residual is systematic at all
    )
    noise_floor: float | None = None
    fit_naive: float | None = None
    fit_extended: float | None = None
    gain_low: float | None = None
    gain_high: float | None = None
    slip_by_slip: bool = False
    alternate_blocks: bool = False

    @property
    def improves(self) -> bool:
        """Whether the extended model is at least as good on unseen data; true where there are too
        few samples to decide.
        """
        if self.rmse_naive is None or self.rmse_extended is None:
            return True
        return self.rmse_extended <= self.rmse_naive

    def of_naive_alone(self) -> HeldOutFit:
        """The same where S and J alone are published: no gain and no loss."""
        gain = None if self.fit_naive is None else 0.0
        return replace(
            self,
            rmse_extended=self.rmse_naive,
            fit_extended=self.fit_naive,
            gain_low=gain,
            gain_high=gain,
        )


@dataclass(frozen=True, kw_only=True)
class Stiction:
    """S and J in percent of OP span. ``by_likelihood``: those by which the whole record is most
    likely, of which each slip may have come early or late."""

    S: Estimate
    J: Estimate
    by_likelihood: bool = False


@dataclass(frozen=True, kw_only=True)
class FreeRuns:
    """(n,) free runs of MV in percent: S and J alone, and with what was named. Where the fit is
    ``HeldOutFit.slip_by_slip``, both let go where the stem was seen to; where it is of
    ``alternate_blocks``, each sample is by the fit that did not see its block.

    ``heldout_from`` is the first sample that neither was fitted to. ``position`` (n,) is what they
    follow where MV is no position but a flow that was read as one, NaN where the flow tells
    nothing; ``None`` where it is MV itself.
    """

    naive: Floats
    extended: Floats
    heldout_from: int
    position: Floats | None = None

    def followed(self, recording: Recording) -> Recording:
        """The recording with the position that the runs follow, percent, as its MV."""
        if self.position is None or recording.mv is None:
            return recording
        signal = replace(recording.mv, values=self.position, unit=PERCENT)
        return replace(recording, signals={**recording.signals, Role.MV: signal})

    @property
    def stretch(self) -> tuple[int, int]:
        """The first sample (inclusive) and the last (exclusive) that a model was run over; all of
        them where it was run over none."""
        finite = np.flatnonzero(np.isfinite(self.naive))
        return (int(finite[0]), int(finite[-1]) + 1) if finite.size else (0, self.naive.size)

    def part(self, first: int, last: int) -> FreeRuns:
        """The runs of samples ``first`` (inclusive) to ``last`` (exclusive), copied, so that the
        others can be let go."""
        return FreeRuns(
            naive=self.naive[first:last].copy(),
            extended=self.extended[first:last].copy(),
            heldout_from=max(self.heldout_from - first, 0),
            position=None if self.position is None else self.position[first:last].copy(),
        )

    def within(self, first: int, samples: int) -> FreeRuns:
        """The runs on the clock of a recording of ``samples`` samples, of which they begin at
        ``first``; NaN outside."""
        return FreeRuns(
            naive=on_whole_clock(self.naive, first, samples),
            extended=on_whole_clock(self.extended, first, samples),
            heldout_from=first + self.heldout_from,
            position=None
            if self.position is None
            else on_whole_clock(self.position, first, samples),
        )


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """All that is known of the difference between model and recording."""

    finding: Finding
    sentence: str
    naive: Stiction
    restated: Stiction
    effects: tuple[Effect, ...] = ()  # in order of work: see ``describe_effect.in_order_of_work``
    record_effects: tuple[RecordEffect, ...] = ()
    not_testable: tuple[Untestable, ...] = ()
    heldout: HeldOutFit = field(default_factory=HeldOutFit)
    before: ResidualMap = field(default_factory=ResidualMap)
    after: ResidualMap = field(default_factory=ResidualMap)
    runs: FreeRuns | None = None
    # Every effect that was tried term by term, the largest gain first; and what is named, together.
    tried: tuple[TriedEffect, ...] = ()
    together: Gain | None = None
    # How probable as strong an effect is on a valve with nothing hidden; None where none was named.
    p_value: float | None = None
    scores: tuple[EffectScore, ...] = ()  # of the effects that this recording could have shown
    stroke_curve: StrokeCurve | None = None  # where OP is not percent for percent of travel
    open_question: OpenQuestion | None = (
        None  # the models that a planned test would have to separate
    )
    seconds: float = 0.0

    @staticmethod
    def unknown(sentence: str, reason: str = "", **known: Any) -> Mismatch:
        """The mismatch of a recording that cannot be analysed: why in a ``sentence``, and as the
        ``reason`` of S and J; ``known`` are the fields that are known all the same.
        """
        reason = reason or sentence
        none = Stiction(S=Estimate.unknown(reason, "%"), J=Estimate.unknown(reason, "%"))
        return Mismatch(
            finding=Finding.NOT_TESTABLE, sentence=sentence, naive=none, restated=none, **known
        )

    @property
    def defects(self) -> tuple[Effect, ...]:
        """The effects that are something to mend, what needs work first at the front."""
        return tuple(effect for effect in self.effects if not effect.inherent)
