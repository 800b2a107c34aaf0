"""When what is screened: ``Scheduler`` queues a run for each instant that a schedule is due.

``instants`` says which those are, the same for every process; APScheduler's cron trigger tells the
readings of the clock on the wall (``plantfile.cron``). Runs are worked on by ``run.queue_worker``.
"""

from stemwatch.service.scheduler.scheduler import Scheduler as Scheduler
