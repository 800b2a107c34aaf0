"""From devices to the store: samples are polled, written to disk at once, and stored in batches.

``Collector`` runs the pollers of all devices, a ``Spool`` on disk, and a ``SampleSink``, which the
store implements. Every sample goes through the spool, so that polling does not depend on the store
and a killed process loses at most the poll in progress.
"""

from stemwatch.service.collector.collector import Collector as Collector
from stemwatch.service.collector.collector import collect as collect
from stemwatch.service.collector.forwarder import SampleSink as SampleSink
from stemwatch.service.collector.forwarder import SinkRefused as SinkRefused
from stemwatch.service.collector.spool import Spool as Spool
from stemwatch.service.collector.spool import SpoolError as SpoolError
