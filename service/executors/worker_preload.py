"""What every worker needs, imported once: workers are forked from the process that did.

Imported for its effect alone, by the fork server of ``children.worker_context``. Importing takes
seconds of a core; a worker that is forked afterwards begins at once, and shares the memory.
"""

from __future__ import annotations

import signal
from importlib import import_module

from stemwatch.service.executors.executor import one_thread

# What is told to the whole group is the parent's to answer; this process ends with it. It is kept
# waiting, not ignored: a worker that is told to end before it looks must hear it then.
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
one_thread()  # before numpy is loaded: its libraries look once
for _module in ("stemwatch.models.screening", "stemwatch.models.narx.training"):
    import_module(_module)
import_module("stemwatch.service.run.task")
