"""From live devices to the store: polled, kept on disk at once, handed over in batches.

``Collector`` runs the pollers of all devices, a ``Spool`` on disk, and a ``SampleSink`` that the
store implements. Every sample goes through the spool, so that nothing hangs on the store being
there and a process that is killed loses at most the poll it was in the middle of.
"""

from stemwatch.service.collector.collector import Collector as Collector
from stemwatch.service.collector.collector import collect as collect
from stemwatch.service.collector.sample_sink import SampleSink as SampleSink
from stemwatch.service.collector.sample_sink import SinkRefused as SinkRefused
from stemwatch.service.collector.spool import Spool as Spool
from stemwatch.service.collector.spool import SpoolError as SpoolError
