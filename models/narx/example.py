"""Input and result of training: one record and one fit for each valve, and the settings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.narx.architecture import ELEMENT_UNITS, StickSlipStart
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.recording import Bools, Floats, Recording


@dataclass(frozen=True, kw_only=True)
class NarxExample:
    """One valve's record: ``op`` (n,) percent, ``mv`` (n,) in any unit, ``usable`` (n,).

    Samples before ``train_until`` are trained on, the rest are held out. ``start`` is the
    stick-slip element fitted to the same samples, for a grey-box start of some seeds; without one
    all seeds start from random weights. Raises ``ValueError`` on unequal lengths, a ``train_until``
    outside the record, or an interval that is not positive.
    """

    valve: str
    op: Floats
    mv: Floats
    usable: Bools
    train_until: int
    interval_s: float
    start: StickSlipStart | None = None

    def __post_init__(self) -> None:
        for name, kind in (("op", np.float64), ("mv", np.float64), ("usable", np.bool_)):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=kind))
        shapes = {self.op.shape, self.mv.shape, self.usable.shape}
        if len(shapes) != 1 or self.op.ndim != 1:
            raise ValueError(
                f"{self.valve}: op, mv and usable of one length expected, received shapes {shapes}"
            )
        if not 0 <= self.train_until <= self.op.size:
            raise ValueError(
                f"{self.valve}: train_until between 0 and {self.op.size} expected, "
                f"received {self.train_until}"
            )
        if not (np.isfinite(self.interval_s) and self.interval_s > 0):
            raise ValueError(f"{self.valve}: interval_s must be positive: {self.interval_s}")

    @classmethod
    def of(
        cls, recording: Recording, train_until: int, start: StickSlipStart | None = None
    ) -> NarxExample:
        """The example of a recording; raises ``ValueError`` where it has no position."""
        if recording.mv is None:
            raise ValueError(f"{recording.valve}: a network needs the valve position (MV)")
        return cls(
            valve=recording.valve,
            op=recording.op.values,
            mv=recording.mv.values,
            usable=recording.usable,
            train_until=train_until,
            interval_s=recording.interval_s,
            start=start,
        )


@dataclass(frozen=True, kw_only=True)
class NarxSettings:
    """The settings of training; the defaults were tuned on simulated stick-slip and on a real
    valve.

    Training goes through ``horizons`` samples of free run (1 is series-parallel, the network fed
    the measurement), with at most so many Levenberg-Marquardt ``steps`` each. ``damping`` is each
    stage's first lambda, ``decay`` the weight decay in units of ``se^2 / weights``. Of ``seeds``
    networks at most three in four are kept, those that follow the training part best, and none that
    is much worse than the best. Where an example has a ``start``, ``fitted_seeds`` of them begin
    from it; with 0 all begin from random weights. The last ``watched_share`` of the training part
    is not trained on: a stage ends for a network when its free run there has not improved for
    ``patience`` steps, and the network returns to its best weights.

    ``device`` is where the least squares are solved: "cpu", a device of torch such as "cuda", or
    "auto" (see ``training.device_for``). On a GPU sums are added in another order, so that the last
    digits of the weights differ from those of a CPU.
    """

    hidden: int = 5
    seeds: int = 8
    fitted_seeds: int = 2
    horizons: tuple[int, ...] = (1, 20, 300)
    steps: tuple[int, ...] = (10, 8, 8)
    damping: float = 0.1
    decay: float = 1e-5
    watched_share: float = 0.1
    patience: int = 6
    seed: int = 0
    valves_per_batch: int = 32
    reference_horizon: int = 100
    device: str = "auto"

    def __post_init__(self) -> None:
        counts = (self.hidden, self.seeds, self.patience, self.valves_per_batch)
        if min(*counts, self.reference_horizon, *self.horizons, *self.steps) < 1:
            raise ValueError(f"counts, horizons and steps of at least 1 expected: {self}")
        if self.fitted_seeds < 0:
            raise ValueError(f"fitted_seeds of 0 or more expected, received {self.fitted_seeds}")
        if not self.horizons or len(self.horizons) != len(self.steps):
            raise ValueError(
                f"as many steps as horizons expected, received {self.steps} and {self.horizons}"
            )
        if not (0 <= self.watched_share <= 0.5 and self.damping > 0 and self.decay > 0):
            raise ValueError(f"watched_share in 0..0.5, damping and decay above 0 expected: {self}")

    @property
    def fitted(self) -> int:
        """How many members begin from an example's ``start``: none with fewer than five units."""
        return min(self.fitted_seeds, self.seeds) if self.hidden >= ELEMENT_UNITS else 0

    @property
    def kept(self) -> int:
        """How many members an ensemble has at most."""
        return self.seeds - self.seeds // 4


@dataclass(frozen=True, kw_only=True)
class StageLog:
    """One stage of one valve: for each member in it the root mean square error it ended with on
    the trained and on the watched samples (MV's unit, restarted every ``horizon`` samples; ``None``
    where nothing was watched) and the accepted steps. The members that start from a fitted element
    have a stage of their own, the last."""

    horizon: int
    trained_rmse: tuple[float, ...]
    watched_rmse: tuple[float, ...] | None
    steps: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class HeldOutErrors:
    """The ensemble on samples it was not trained on, restarted only at gaps.

    ``rmse`` and ``one_step_rmse`` in MV's unit; ``normalised`` = rmse / std(MV) there.
    """

    rmse: float
    one_step_rmse: float
    normalised: float
    samples: int

    @property
    def fit_percent(self) -> float:
        """100 (1 - ||y - yhat|| / ||y - mean(y)||)."""
        return 100.0 * (1.0 - self.normalised)


@dataclass(frozen=True, kw_only=True)
class NarxFit:
    """A trained network and how good it is, or ``None`` and the reason why there is none.

    ``simulated`` (n,) is the free run over the whole record, in MV's unit, started from the
    measurement at its beginning, after each gap, and at ``train_until``; NaN at unusable samples.
    ``seconds`` is the batch's time divided by the valves in it, ``device`` where it was trained.
    """

    valve: str
    network: NarxNetwork | None = None
    reason: str | None = None
    heldout: HeldOutErrors | None = None
    simulated: Floats | None = None
    log: tuple[StageLog, ...] = ()
    seconds: float = 0.0
    device: str = "cpu"

    def in_seconds(self, unit_s: float) -> NarxFit:
        """The fit, made on a clock with units of ``unit_s`` seconds, its network in seconds."""
        if self.network is None:
            return self
        return replace(self, network=self.network.in_seconds(unit_s))

    def __post_init__(self) -> None:
        if (self.network is None) == (self.reason is None):
            raise ValueError(f"{self.valve}: a NarxFit has either a network or a reason")
