"""``Scheduler`` queues a run for each instant at which a schedule is due.

``instants`` computes these instants, identically in every process; cron expressions are evaluated
by APScheduler's trigger (``config.cron``). ``run.queue_worker`` processes the queued runs.
"""

from stemwatch.service.scheduler.scheduler import Scheduler as Scheduler
