"""``stemwatch demo --live``: a simulated plant, the service that watches it, and a mail catcher.

The demo uses the product itself: a valve wears in the simulation, is polled over Modbus, screened
on schedule, raises an alert, and is repaired when maintenance is recorded.
"""

from stemwatch.service.live_demo.demo import LiveDemo as LiveDemo
from stemwatch.service.live_demo.folder import DemoFolder as DemoFolder
from stemwatch.service.live_demo.mail_catcher import MailCatcher as MailCatcher
from stemwatch.service.live_demo.recorded_maintenance import (
    RecordedMaintenance as RecordedMaintenance,
)
from stemwatch.service.live_demo.recorded_maintenance import (
    repair_recorded_valves as repair_recorded_valves,
)
from stemwatch.service.live_demo.timing import DemoTiming as DemoTiming
