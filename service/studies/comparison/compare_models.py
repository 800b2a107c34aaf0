"""``compare``: fit every model to one recording and mark them all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.studies.literature.fit import ModelFit, fit_model
from stemwatch.models.studies.literature.model import ValveModel
from stemwatch.models.studies.literature.networks.network import Network, fit_network
from stemwatch.models.studies.literature.networks.product_network import PRODUCT
from stemwatch.models.studies.literature.networks.table_one import FEEDFORWARD_PAPER, NARX_PAPER
from stemwatch.models.studies.literature.scores import FitScore

OnProgress = Callable[[str, int, int], None]  # model, done, of
NETWORKS: tuple[Network, ...] = (FEEDFORWARD_PAPER, NARX_PAPER, PRODUCT)


@dataclass(frozen=True, kw_only=True)
class ModelRow:
    """One model's result; ``outcome`` is why there is none, or what to doubt about it."""

    model: str
    kind: str  # "data-driven", "force balance" or "network"
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    training: FitScore | None = None
    heldout: FitScore | None = None
    seconds: float = 0.0
    outcome: str = ""
    simulated: Floats | None = None

    def as_json(self) -> dict[str, Any]:
        """Everything but the trace, with nothing that JSON cannot hold."""
        return {
            "model": self.model,
            "kind": self.kind,
            "parameters": {name: asdict(parameter) for name, parameter in self.parameters.items()},
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
    rows: tuple[ModelRow, ...]

    def ranked(self) -> list[ModelRow]:
        """Best first on the held-out part, or on the training part where nothing is held out."""
        return sorted(self.rows, key=_rank)


def _rank(row: ModelRow) -> float:
    mark = row.heldout or row.training
    return float("inf") if mark is None else mark.rmse


def compare(
    recording: Recording,
    train_until: int,
    models: Sequence[ValveModel] = EVERY,
    *,
    network: bool = True,
    on_progress: OnProgress = lambda *_: None,
) -> Comparison:
    """Fit each of ``models`` and the three networks to the samples before ``train_until``.

    Raises ``ValueError`` where ``train_until`` is not within the recording. A model that cannot be
    fitted is a row with an outcome.
    """
    networks = NETWORKS if network else ()
    total = len(models) + len(networks)
    rows, element = [], None
    for finished, model in enumerate(models):
        on_progress(model.name, finished, total)
        fit = fit_model(model, recording, train_until)
        element = fit if model is CANONICAL else element
        rows.append(_of_fit(fit, "data-driven" if model in DATA_DRIVEN else "force balance"))
    for finished, entry in enumerate(networks, start=len(models)):
        on_progress(entry.name, finished, total)
        rows.append(_of_fit(fit_network(entry, recording, train_until, element), "network"))
    return Comparison(recording=recording, train_until=train_until, rows=tuple(rows))


def _of_fit(fit: ModelFit, kind: str) -> ModelRow:
    return ModelRow(
        model=fit.model,
        kind=kind,
        parameters=fit.parameters,
        training=fit.training,
        heldout=fit.heldout,
        seconds=fit.seconds,
        outcome=fit.outcome,
        simulated=fit.simulated,
    )
