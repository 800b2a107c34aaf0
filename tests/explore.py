"""Property tests with new random draws, round after round: what ``make explore`` runs.

Each round has a seed of its own, printed first; ``make explore SEED=...`` repeats a round.
"""

from __future__ import annotations

import argparse
import secrets
import signal
import subprocess
import sys
import time
from pathlib import Path

AGAIN = """
Found with seed {seed}. To see it again:

    make explore SEED={seed}

The failing example stands above. Mend the cause, and keep the example: write it as @example(...)
under the test's @given(...), so that every later run tries it.
"""
_INTERRUPTED = 2  # pytest's exit status when it was told to stop


def main() -> int:
    """Rounds until the time is over or something is found; returns pytest's status."""
    options = _options()
    end = time.monotonic() + options.seconds
    number = 0
    while True:
        number += 1
        seed = secrets.randbelow(2**32) if options.seed is None else options.seed
        print(f"Round {number}, seed {seed}", flush=True)
        left = None if options.seed is not None else end - time.monotonic()
        status = _round(seed, options.workers, left)
        if status not in (0, _INTERRUPTED):
            print(AGAIN.format(seed=seed), flush=True)
            return status
        if status or options.seed is not None or time.monotonic() >= end:
            return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="how long to go on")
    parser.add_argument("--seed", type=int, help="one round, with the draws of this seed")
    parser.add_argument("-n", "--workers", default="2", help="tests side by side")
    return parser.parse_args()


def _round(seed: int, workers: str, left: float | None) -> int:
    """All property tests once; after ``left`` seconds they are told to stop."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "hypothesis", "-n", workers]
    command += ["--hypothesis-profile=explore", f"--hypothesis-seed={seed}"]
    with subprocess.Popen(command, cwd=Path(__file__).parent.parent) as running:
        try:
            return running.wait(timeout=left)
        except subprocess.TimeoutExpired:
            print("The time is over.", flush=True)
            running.send_signal(signal.SIGINT)
            return running.wait()


if __name__ == "__main__":
    sys.exit(main())
