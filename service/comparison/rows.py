"""``compare``: fit every model to one recording and mark them all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.zoo.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.zoo.fit import ModelFit, fit_model, score_run
from stemwatch.models.zoo.model import ValveModel
from stemwatch.models.zoo.scores import Score

Tell = Callable[[str, int, int], None]  # model, done, of
NETWORK = "narx"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One model's result; ``outcome`` is why there is none, or what to doubt about it."""

    model: str
    kind: str  # "data-driven", "force balance" or "network"
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    training: Score | None = None
    heldout: Score | None = None
    seconds: float = 0.0
    outcome: str = ""
    simulated: Floats | None = None

    def as_json(self) -> dict[str, Any]:
        """Everything but the trace, with nothing that JSON cannot hold."""
        return {
            "model": self.model,
            "kind": self.kind,
            "parameters": {name: asdict(one) for name, one in self.parameters.items()},
            "training": None if self.training is None else asdict(self.training),
            "heldout": None if self.heldout is None else asdict(self.heldout),
            "seconds": round(self.seconds, 3),
            "outcome": self.outcome,
        }


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """All rows of one recording; samples from ``train_until`` on only judged."""

    recording: Recording
    train_until: int
    rows: tuple[Row, ...]

    def ranked(self) -> list[Row]:
        """Best first on the held-out part, or on the training part where nothing is held out."""
        return sorted(self.rows, key=_rank)


def _rank(row: Row) -> float:
    mark = row.heldout or row.training
    return float("inf") if mark is None else mark.rmse


def compare(
    recording: Recording,
    train_until: int,
    models: Sequence[ValveModel] = EVERY,
    *,
    network: bool = True,
    tell: Tell = lambda *_: None,
) -> Comparison:
    """Fit each of ``models`` and the NARX network to the samples before ``train_until``.

    Raises ``ValueError`` where ``train_until`` is not within the recording. A model that cannot be
    fitted is a row with an outcome.
    """
    of = len(models) + network
    rows = []
    for done, model in enumerate(models):
        tell(model.name, done, of)
        rows.append(_of_fit(model, fit_model(model, recording, train_until)))
    if network:
        tell(NETWORK, len(models), of)
        rows.append(_of_network(recording, train_until))
    return Comparison(recording=recording, train_until=train_until, rows=tuple(rows))


def _of_fit(model: ValveModel, fit: ModelFit) -> Row:
    return Row(
        model=fit.model,
        kind="data-driven" if model in DATA_DRIVEN else "force balance",
        parameters=fit.parameters,
        training=fit.training,
        heldout=fit.heldout,
        seconds=fit.seconds,
        outcome=fit.outcome,
        simulated=fit.simulated,
    )


def _of_network(recording: Recording, train_until: int) -> Row:
    from stemwatch.models.narx.example import NarxExample
    from stemwatch.models.narx.training import train  # torch takes two seconds to import

    if recording.mv is None:
        reason = "the recording has no valve position (MV) to train on"
        return Row(model=NETWORK, kind="network", outcome=reason)
    example = NarxExample(
        valve=recording.valve,
        op=recording.op.values,
        mv=recording.mv.values,
        usable=recording.usable,
        train_until=train_until,
        interval_s=recording.interval_s,
    )
    (fit,) = train([example])
    if fit.simulated is None:
        return Row(model=NETWORK, kind="network", outcome=fit.reason or "", seconds=fit.seconds)
    training, heldout = score_run(recording, fit.simulated, train_until)
    return Row(
        model=NETWORK,
        kind="network",
        training=training,
        heldout=heldout,
        seconds=fit.seconds,
        simulated=fit.simulated,
    )
