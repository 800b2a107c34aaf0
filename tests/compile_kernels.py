"""Compile the kernels that most tests need: ``make test`` does it beside the type checks.

Test processes that begin together would each compile all of them, half a minute of a core each.
"""

from __future__ import annotations

from stemwatch.models.studies.simulator import demo_plant, simulate_loop
from stemwatch.service.executors.compile_ahead import Kernels, compile_kernels

if __name__ == "__main__":
    compile_kernels(list(Kernels))
    simulate_loop(demo_plant(1)[0], 1)
