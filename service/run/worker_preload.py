"""Imports the modules that every worker needs, in the server process that workers are forked from.

Loaded by the fork server of ``process_lifecycle.worker_context`` only for this effect. Importing
takes seconds; a worker that is forked afterwards starts at once and shares the memory.
"""

from __future__ import annotations

import gc
import signal
from importlib import import_module

from stemwatch.service.executors.executor import one_thread

# This process ends with its parent, so SIGTERM to the whole group is held back. It is blocked and
# not ignored, because a worker forked from here must receive it once it has its handlers.
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
one_thread()  # before numpy is loaded, since its libraries read the environment only once
# What is imported here is never garbage: looking for it took a fifth of the time, and would have
# each worker copy the memory that it shares with this process.
gc.disable()
for _module in (
    "stemwatch.models.screening.screen",
    "stemwatch.models.narx.training",
    "stemwatch.service.run.task",
):
    import_module(_module)
gc.freeze()
gc.enable()
