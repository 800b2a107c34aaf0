"""The limits a verdict is measured against, each of which ``plant.toml`` may set."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a screening, each with the unit in its name.

    ``watch_S_percent`` and ``sticky_S_percent`` are compared with the interval of S, not with its
    value: a valve is called sticky when even the low end of S reaches the limit. A dead band and
    resolution of about 1 % together is what specifications for good control valves ask for
    (EnTech Control Valve Dynamic Specification 3.0, quoted from memory).
    """

    watch_S_percent: float = 0.75
    sticky_S_percent: float = 1.5
    min_reversals: float = 4.0  # reversals of OP larger than its noise
    min_samples_per_cycle: float = 6.0  # samples per cycle of the OP's own movement
    # Seconds that a recording must last. 0: as long as ``validity_checks.LEAST_SAMPLES`` samples,
    # because the information for a fit depends on the number of samples.
    min_duration_s: float = 0.0
    min_samples: float = 200.0
    max_bad_share: float = 0.3  # share of OP, MV pairs that may be unusable
    max_interpolated_share: float = 0.35  # share of samples that a historian interpolated
    # A record of more than twice as many samples is fitted on this many, those with the most
    # movement: the cost grows with the samples, the precision hardly does (see
    # ``models.preparation.fit_window``).
    fitted_samples: float = 3600.0
    min_fit_percent: float = 40.0  # held-out fit, below which S and J do not describe the valve
    # How much worse than in its baseline window a valve may follow its baseline network before it
    # is watched. Chosen with a margin above the values that `stemwatch drift` prints: a loop that
    # is merely operated differently must not raise an alarm.
    baseline_ratio_watch: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.watch_S_percent <= self.sticky_S_percent:
            raise ValueError(
                "expected 0 < watch_S_percent <= sticky_S_percent, received "
                f"{self.watch_S_percent} and {self.sticky_S_percent}"
            )
        if not self.fitted_samples >= self.min_samples:
            raise ValueError(
                "expected fitted_samples of at least min_samples, received "
                f"{self.fitted_samples} and {self.min_samples}"
            )
