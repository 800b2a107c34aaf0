"""The live demo: a simulated plant, a service that watches it, a catcher for its mails.

Nothing in it is staged: a valve wears in the physics of the plant, is polled over Modbus, screened
on schedule, raises an alert, and is repaired when somebody records the work.
"""

from stemwatch.service.live_demo.demo import LiveDemo as LiveDemo
from stemwatch.service.live_demo.folder import DemoFolder as DemoFolder
from stemwatch.service.live_demo.mail_catcher import MailCatcher as MailCatcher
from stemwatch.service.live_demo.technician import Technician as Technician
from stemwatch.service.live_demo.technician import (
    repair_what_is_recorded as repair_what_is_recorded,
)
from stemwatch.service.live_demo.timing import DemoTiming as DemoTiming
