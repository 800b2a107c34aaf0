"""``/metrics``: how the service is doing, in the text format of Prometheus.

Everything is read when it is asked for, from the store and the spool's folder, so that one page
speaks for all processes. Labels are devices, notifiers and fixed words; valves and tags are none,
so that the number of series does not grow with the plant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime

from fastapi import APIRouter, Response
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import CollectorRegistry

from stemwatch.models.verdict import Verdict
from stemwatch.service import __version__
from stemwatch.service.collector.spool import backlog
from stemwatch.service.presenter.work_decision import NE107_OF, Ne107
from stemwatch.service.store.administration.figures import StoreFigures, figures_of
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.screenings.ranking import NOT_SCREENED
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.web.dependencies import Dependencies, Deps

PREFIX = "stemwatch_"
DELIVERY_STATES = ("waiting", "failing", "sent", "given_up")
_OVER = (RunState.DONE, RunState.CANCELLED, RunState.FAILED, RunState.SKIPPED)
_GOING = (RunState.WAITING, RunState.RUNNING)
# (figure of the source, name of the metric, what it is); counts begin anew with the collector.
_DEVICE_COUNTS = (
    ("polls", "device_polls", "Polls made since the collector started"),
    ("missed", "device_polls_missed", "Instants that were not polled in time"),
    ("reconnects", "device_reconnects", "Connections opened again"),
)
_DEVICE_GAUGES = (
    ("late_p99_s", "device_lateness_p99_seconds", "From an instant to its last answer, p99"),
    ("poll_p99_s", "device_poll_p99_seconds", "What a poll takes, p99"),
    ("refused_tags", "device_refused_tags", "Tags that the device does not hand out"),
)

router = APIRouter(tags=["health"])


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(deps: Deps) -> Response:
    """The state of the service for Prometheus. While the database is not available, its metrics are
    left out and ``stemwatch_database_up`` is 0."""
    return Response(metrics_text(deps), media_type=CONTENT_TYPE_LATEST)


def metrics_text(deps: Dependencies) -> bytes:
    """All metrics of the service in the text format of Prometheus."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collected(list(all_metrics(deps))))
    return generate_latest(registry)


class _Collected:
    """Metrics that are known already, as a registry wants them."""

    def __init__(self, known: list[Metric]) -> None:
        self._known = known

    def collect(self) -> Iterable[Metric]:
        """What the registry of prometheus_client asks for at each scrape."""
        return self._known


def all_metrics(deps: Dependencies) -> Iterator[Metric]:
    """Every metric, as it stands now."""
    yield _gauge("info", "The version that runs", [({"version": __version__}, 1.0)])
    try:
        states = deps.store.sources.states()
        figures = figures_of(deps.store)
    except StoreError:
        yield _single_gauge("database_up", "1 where the database answers", 0.0)
    else:
        yield _single_gauge("database_up", "1 where the database answers", 1.0)
        yield from _of_devices(_known_devices(deps, states), deps.now)
        yield from _of_runs(figures)
        yield from _of_alerts(deps, figures)
    yield from _of_parts(deps)
    yield from _of_spool(deps)


def _known_devices(deps: Dependencies, states: list[SourceState]) -> list[SourceState]:
    """The devices that the plant file names now; devices of earlier plant files have no series."""
    plant = deps.site.plant
    return [
        state
        for state in states
        if state.kind != "folder" and (plant is None or state.source in plant.devices)
    ]


def _of_devices(devices: list[SourceState], now: datetime) -> Iterator[Metric]:
    samples = _counter("samples", "Samples polled since the collector started, by quality")
    for device in devices:
        for quality in ("good", "bad"):
            _add(
                samples,
                {"device": device.source, "quality": quality},
                device.figures.get(quality, 0),
            )
    yield samples
    for key, name, help_text in _DEVICE_COUNTS:
        counter = _counter(name, help_text)
        for device in devices:
            _add(counter, {"device": device.source}, device.figures.get(key, 0))
        yield counter
    for key, name, help_text in _DEVICE_GAUGES:
        devices_with_key = [device for device in devices if key in device.figures]
        yield _gauge(
            name,
            help_text,
            [({"device": state.source}, state.figures[key]) for state in devices_with_key],
        )
    up = [
        ({"device": device.source}, float(device.connected and not device.fault))
        for device in devices
    ]
    yield _gauge("device_up", "1 where the device answers without a fault", up)
    ages = [(device.source, device.last_good) for device in devices]
    yield _gauge(
        "device_last_good_age_seconds",
        "Since the last poll with a good sample",
        [
            ({"device": name}, _age_s(last_time, now))
            for name, last_time in ages
            if last_time is not None
        ],
    )
    heard = [({"device": device.source}, _age_s(device.updated, now)) for device in devices]
    yield _gauge("device_heard_age_seconds", "Since the collector spoke of the device", heard)
    dropped = max((device.figures.get("dropped", 0.0) for device in devices), default=0.0)
    refused = max((device.figures.get("store_refused", 0.0) for device in devices), default=0.0)
    yield _counter("samples_dropped", "Samples that neither disk nor memory held", dropped)
    yield _counter("samples_refused", "Samples that the store refused for good", refused)


def _of_runs(figures: StoreFigures) -> Iterator[Metric]:
    runs = _counter("runs", "Runs that are over, by outcome")
    for state in _OVER:
        _add(runs, {"outcome": state.value}, figures.runs.get(state.value, 0))
    yield runs
    going = [({"state": state.value}, float(figures.runs.get(state.value, 0))) for state in _GOING]
    yield _gauge("queue_runs", "Runs that wait or go on", going)
    yield _single_gauge("queue_valves", "Valves that these still have to do", figures.valves_to_do)
    yield _counter("valves_set_aside", "Valves of all runs without a result", figures.set_aside)
    words = (*(verdict.value for verdict in Verdict), NOT_SCREENED)
    counts = [({"verdict": word}, float(figures.verdicts.get(word, 0))) for word in words]
    yield _gauge("valves", "Valves by the verdict of their latest screening", counts)
    yield _gauge("valves_ne107", "Valves by state of NAMUR NE 107", _ne107_counts(figures))
    last = figures.last_run
    if last is None:
        return
    yield _single_gauge("last_run_seconds", "What the run finished last took", last.seconds)
    yield _single_gauge("last_run_finished_timestamp_seconds", "When it ended", last.finished_s)
    valve_s = [({"stat": "mean"}, last.valve_mean_s), ({"stat": "max"}, last.valve_max_s)]
    yield _gauge("last_run_valve_seconds", "Work on one valve in that run", valve_s)


def _ne107_counts(figures: StoreFigures) -> list[tuple[dict[str, str], float]]:
    """Valves by state; those without a verdict have none and are not counted."""
    counts = dict.fromkeys(Ne107, 0)
    for verdict, state in NE107_OF.items():
        counts[state] += figures.verdicts.get(verdict.value, 0)
    return [({"state": state.value}, float(count)) for state, count in counts.items()]


def _of_alerts(deps: Dependencies, figures: StoreFigures) -> Iterator[Metric]:
    counts = [
        (
            {"kind": kind.value, "severity": severity.value},
            float(figures.alerts.get((kind.value, severity.value), 0)),
        )
        for kind in AlertKind
        for severity in AlertSeverity
    ]
    yield _gauge("alerts_open", "Open alerts without the false ones", counts)
    plant = deps.site.plant
    names = sorted({name for name, _ in figures.deliveries} if plant is None else plant.notifiers)
    states = [
        ({"notifier": name, "state": state}, float(figures.deliveries.get((name, state), 0)))
        for name in names
        for state in DELIVERY_STATES
    ]
    yield _gauge("deliveries", "Messages by what became of them", states)


def _of_parts(deps: Dependencies) -> Iterator[Metric]:
    """The vital parts as ``/ready`` sees them."""
    parts = [({"part": check.name}, float(check.ok)) for check in deps.site.checks() if check.vital]
    yield _gauge("part_up", "1 where a vital part of the service works", parts)


def _of_spool(deps: Dependencies) -> Iterator[Metric]:
    plant = deps.site.plant
    if plant is None or not plant.devices:
        return
    waits = backlog(plant.beside(plant.service.spool))
    yield _single_gauge("spool_bytes", "What waits on disk for the store", waits.size_bytes)
    yield _gauge(
        "spool_age_seconds", "How long the oldest has waited", [({}, waits.age_s(deps.now))]
    )
    yield _counter("spool_lost_samples", "Samples that a full spool dropped", waits.lost_samples)


def _age_s(instant: datetime, now: datetime) -> float:
    return max(0.0, (now - instant).total_seconds())


def _gauge(name: str, help_text: str, values: Iterable[tuple[dict[str, str], float]]) -> Metric:
    family = GaugeMetricFamily(PREFIX + name, f"{help_text}.")
    for labels, value in values:
        _add(family, labels, value)
    return family


def _single_gauge(name: str, help_text: str, value: float) -> Metric:
    return _gauge(name, help_text, [({}, value)])


def _counter(name: str, help_text: str, value: float | None = None) -> Metric:
    family = CounterMetricFamily(PREFIX + name, f"{help_text}.")
    if value is not None:
        _add(family, {}, value)
    return family


def _add(family: Metric, labels: dict[str, str], value: float) -> None:
    suffix = "_total" if family.type == "counter" else ""
    family.add_sample(family.name + suffix, labels, float(value))
