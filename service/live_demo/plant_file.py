"""``demo_toml``: the plant file of the live demo."""

from __future__ import annotations

import json
from collections.abc import Sequence

from stemwatch.models.studies.simulator import PlantLoop
from stemwatch.service.live_demo.folder import REPORTS, SPOOL
from stemwatch.service.live_demo.loops import STROKES
from stemwatch.service.live_demo.timing import DemoTiming
from stemwatch.service.modbus_plant import plant_toml

_BASELINE_RATIO = 4.0
MAILBOX = "maintenance@demo.invalid"
_HEAD = """\
# Written by `stemwatch demo --live` at each start. The times suit a demonstration: wear that takes
# months takes minutes here. A plant would poll once a second, screen each night, and look at a day:
# every_s = 1.0, cron = "30 2 * * *", window_s = 86400.0, and no [limits] of its own.

"""


def demo_toml(
    loops: Sequence[PlantLoop],
    timing: DemoTiming,
    *,
    modbus_port: int,
    mail_port: int,
    pages_port: int = 0,
) -> str:
    """The ``plant.toml`` of the demo: simulated device, valves, a schedule, a mail notifier.

    The plant's name, which every page shows, says that it is simulated and how fast. Mails have
    links to the pages only where ``pages_port`` is not 0.
    """
    fast = "" if timing.speed == 1.0 else f", {timing.speed:g} times as fast as the clock"
    plant = plant_toml(
        loops,
        host="127.0.0.1",
        port=modbus_port,
        every_s=timing.every_s,
        name=f"Live demo (simulated{fast})",
        strokes=STROKES,
    )
    return _HEAD + plant + _service(timing, mail_port, pages_port)


def _service(timing: DemoTiming, mail_port: int, pages_port: int) -> str:
    address = f"http://127.0.0.1:{pages_port}/" if pages_port else ""
    return f"""
[limits]
min_duration_s = {timing.shortest_s}
# A baseline of minutes covers less than one of a day, so a somewhat larger ratio is normal.
baseline_ratio_watch = {_BASELINE_RATIO}

[service]
address = {json.dumps(address)}
spool = {json.dumps(SPOOL)}
reports = {json.dumps(REPORTS)}
window_s = {timing.window_s}
workers = 1

[alerts]
raise_after_runs = 2
of_runs = 3

[[schedules]]
name = "all valves, every {timing.schedule_s:g} s"
every_s = {timing.schedule_s}
window_s = {timing.window_s}

[[notifiers]]
name = "maintenance"
kind = "mail"
host = "127.0.0.1"
port = {mail_port}
security = "none"
sender = "stemwatch@demo.invalid"
to = [{json.dumps(MAILBOX)}]
"""
