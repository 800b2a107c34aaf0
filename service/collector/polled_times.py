"""``PolledTimes``: finds instants that occur a second time, because the computer's clock was set
back.

Of two samples of one tag with the same time, one was taken at another time. Nobody knows which: the
clock may have run ahead before, or have been set back without need. So neither sample stays good.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stemwatch.connectors.modbus.sample_batch import CAME_TWICE, SampleBatch
from stemwatch.models.recording import Quality

_HOLE_US = 3_600_000_000  # a longer gap separates two stretches
_STRETCHES = 8  # that are remembered for each device

Stretches = dict[str, list[list[int]]]


class PolledTimes:
    """The stretches of time that were polled, by device: first and last instant in microseconds
    since 1970.

    In each stretch the clock runs forward; a clock that is set back, or ahead by more than an hour,
    begins another. ``stretches_of_device`` are those that an earlier process recorded.
    """

    def __init__(
        self, stretches_of_device: Mapping[str, Sequence[Sequence[int]]] | None = None
    ) -> None:
        self.stretches: Stretches = {
            device: [[int(first), int(last)] for first, last in of_device]
            for device, of_device in (stretches_of_device or {}).items()
        }

    def checked(self, batch: SampleBatch) -> SampleBatch:
        """``batch``, the samples of one instant; all bad where this instant came before."""
        if not len(batch) or not self._came_before(batch.source, int(batch.at_us[0])):
            return batch
        return SampleBatch(
            source=batch.source,
            tags=batch.tags,
            at_us=batch.at_us,
            values=np.full(len(batch), np.nan),
            quality=np.full(len(batch), Quality.MISSING, dtype=np.uint8),
            reasons=(CAME_TWICE,) * len(batch),
        )

    def _came_before(self, device: str, at_us: int) -> bool:
        of_device = self.stretches.setdefault(device, [])
        # The last instant may occur again without a clock change: a process that follows another at
        # once may begin with it, and a batch that a full disk refused is written again.
        if of_device and 0 <= at_us - of_device[-1][1] <= _HOLE_US:
            of_device[-1][1] = at_us
        else:
            of_device.append([at_us, at_us])
            del of_device[:-_STRETCHES]
        return any(first <= at_us <= last for first, last in of_device[:-1])
