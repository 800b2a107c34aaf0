"""The collector in a process of its own, so that pages and fits do not delay polls."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import signal
import threading
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from stemwatch.connectors.modbus import SampleBatch
from stemwatch.connectors.modbus.device_state import DeviceState
from stemwatch.service.collector import Collector, SinkRefused, Spool, collect
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.logs import set_up_logs
from stemwatch.service.process_lifecycle import starting_quietly, take_signals
from stemwatch.service.serve.plant_secrets import hide_secrets
from stemwatch.service.store.errors import StoreError, Unstorable
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.samples.tables import instant_of
from stemwatch.service.store.store import Store, open_store

log = logging.getLogger(__name__)

STATES_S = 5.0  # between two updates of the devices' states in the store
_RESTART_S = 5.0
_END_S = 20.0


class StoreWhenReady:
    """A ``SampleSink`` that opens the store on first use and retries while it is not available;
    samples wait in the spool meanwhile."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._store: Store | None = None
        self._guard = threading.Lock()

    def store(self) -> Store:
        """The store. Raises ``StoreError`` while it is not available."""
        with self._guard:
            if self._store is None:
                # The spool removes what is stored, so it must be on the disk by then.
                store = open_store(self._plant.storage, synced=True)
                for device in self._plant.devices.values():
                    units = {register.tag: register.unit for register in device.registers}
                    store.samples.describe(device.name, units)
                self._store = store
            return self._store

    def write(self, batch: SampleBatch) -> None:
        """Store the samples. Raises ``SinkRefused`` for a batch that can never be stored, and
        ``StoreError`` while the store is not available."""
        try:
            self.store().samples.write(batch)
        except Unstorable as error:
            raise SinkRefused(str(error)) from None


class CollectorProcess:
    """Starts the collector's process, and restarts it when it ends."""

    def __init__(self, plant_file: Path, *, logs_as_json: bool = False) -> None:
        self._file, self._json = plant_file, logs_as_json
        self.restarts = 0

    def watch(self, stop: threading.Event) -> None:
        """Start the process, restart it when it ends, and end it when ``stop`` is set."""
        context = multiprocessing.get_context("spawn")
        while not stop.is_set():
            our_end, theirs = context.Pipe()
            process = context.Process(
                target=run_collector, args=(self._file, theirs, self._json), name="collector"
            )
            with starting_quietly():
                process.start()
            theirs.close()
            _until_over(process, stop)
            our_end.close()  # the signal to end
            process.join(timeout=_END_S)
            if process.is_alive():
                log.error("the collector did not end in %g s and is killed", _END_S)
                process.kill()
                process.join()
            if not stop.is_set():
                self.restarts += 1
                log.error("the collector ended with status %s and is restarted", process.exitcode)
                stop.wait(_RESTART_S)


def run_collector(plant_file: Path, parent: Connection, logs_as_json: bool) -> None:
    """The main function of the collector's process: collect until the parent closes its end of the
    pipe or dies."""
    take_signals(ignore=(signal.SIGINT, signal.SIGTERM))  # the parent decides when to end
    set_up_logs(as_json=logs_as_json, process="collector")
    plant = load_plant(plant_file)
    hide_secrets(plant)
    sink = StoreWhenReady(plant)
    stop = threading.Event()
    threading.Thread(target=_until_closed, args=(parent, stop), daemon=True).start()
    spool = Spool(plant.beside(plant.service.spool))
    try:
        collector = Collector(plant.devices.values(), sink, spool)
        threading.Thread(target=_report_states, args=(collector, sink, stop), daemon=True).start()
        collect(collector, stop)
    finally:
        spool.close()


def state_of(device: DeviceState, collector: Collector) -> SourceState:
    """A device's state as it is stored."""
    figures: dict[str, float] = {
        "polls": device.polls,
        "good": device.good,
        "bad": device.bad,
        "missed": device.missed,
        "reconnects": device.reconnects,
        "refused_tags": len(device.refused),
        "dropped": collector.dropped,
        "store_refused": collector.store.refused,
    }
    for name, value in (("late_p99_s", device.lateness_s()), ("poll_p99_s", device.duration_s())):
        if value is not None:
            figures[name] = round(value, 4)
    last = device.last_good_us
    return SourceState(
        source=device.name,
        kind="modbus",
        address=device.link,
        updated=datetime.now(UTC),
        last_good=None if last is None else instant_of(last),
        connected=device.connected,
        fault=device.fault,
        figures=figures,
    )


def _until_over(process: BaseProcess, stop: threading.Event) -> None:
    while process.is_alive() and not stop.wait(0.2):
        pass


def _until_closed(parent: Connection, stop: threading.Event) -> None:
    with contextlib.suppress(EOFError, OSError):
        parent.recv()
    stop.set()


def _report_states(collector: Collector, sink: StoreWhenReady, stop: threading.Event) -> None:
    while not stop.wait(STATES_S):
        try:
            store = sink.store()
            for device in collector.states:
                store.sources.note(state_of(device, collector))
        except StoreError as error:
            log.warning("the states of the devices could not be stored: %s", error)
