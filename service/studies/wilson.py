"""The interval of a share that was counted."""

from __future__ import annotations

import numpy as np

from stemwatch.models.estimate import NORMAL_95


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of the share ``hits`` of ``total``: Wilson (1927).

    doi:10.1080/01621459.1927.10502953. Nothing counted is 0 to 1.
    """
    if total == 0:
        return 0.0, 1.0
    z, share = NORMAL_95, hits / total
    middle = share + z * z / (2 * total)
    half = z * float(np.sqrt(share * (1 - share) / total + z * z / (4 * total * total)))
    return max((middle - half) / (1 + z * z / total), 0.0), min(
        (middle + half) / (1 + z * z / total), 1.0
    )
