"""Local times of an archive, put into UTC by the zone that the user gave."""

from __future__ import annotations

from stemwatch.connectors.historian.notes import Notes
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.timefields import Ints
from stemwatch.connectors.historian.times import Instants, undated
from stemwatch.connectors.historian.zones import to_utc
from stemwatch.models.recording import Bools


def local_instants(ns: Ints, ok: Bools, options: ReadOptions, notes: Notes) -> Instants:
    """Instants of local times, (n,) nanoseconds, of one tag in the order of the archive.

    Without a zone in ``options`` they are on a clock of unknown date.
    """
    if options.zone is None:
        return undated(ns, ok, notes)
    ns, ok = to_utc(
        ns,
        ok,
        options.zone,
        ambiguous_hour=options.ambiguous_hour,
        missing_hour=options.missing_hour,
        groups=[None],
        notes=notes,
    )
    sentence = f"Times without offset are local times of {options.zone}."
    notes.decide(sentence)
    return Instants(ns=ns, ok=ok, known=True, zone=sentence)
