"""When what is screened, and a run from its place in the queue to its end.

``Planner`` queues a run for each instant that a schedule is due; ``Alarm`` wakes it (APScheduler);
``Runner`` takes runs from the queue and works on them with ``WorkerPool``; ``Finisher`` raises
alerts and makes the report. What is to be kept is in the store alone: a process that dies at any
moment leaves a queue from which the next one goes on.
"""

from stemwatch.service.scheduler.alarm import Alarm as Alarm
from stemwatch.service.scheduler.planner import Planner as Planner
from stemwatch.service.scheduler.runner import Runner as Runner
