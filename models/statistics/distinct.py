"""How many different values a signal has, where only a few would matter.

Sorting a day of samples to count its values takes longer than to look at the first of them, of
which an analog signal has more than a few at once.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats


@compiled()
def distinct(values: Floats, most: int) -> int:
    """How many different ``values`` (n,), without NaN, there are; ``most + 1`` where more."""
    found, count = np.empty(most + 1), 0
    for k in range(values.size):
        i = 0
        while i < count and found[i] != values[k]:
            i += 1
        if i == count:
            found[count] = values[k]
            count += 1
            if count > most:
                break
    return count
