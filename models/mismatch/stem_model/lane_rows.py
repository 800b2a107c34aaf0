"""The rows of the array in which stems run side by side: ``s[row.X + i]`` is the place of the stem
in lane ``i``.

Percent of travel, of the recorded MV where it is the reading's. Symbols are those of ``stem``.
"""

from __future__ import annotations

import numpy as np

LANES = 32  # candidates that run side by side at most
COUNT = 39  # rows
_rows = (np.uint64(row * LANES) for row in range(COUNT))

# State of the stem.
X = next(_rows)  # its place
Z = next(_rows)  # the place that is read, behind the play
SIDE = next(_rows)  # of its last motion, 1 rising, -1 falling
MOVING = next(_rows)  # 1 while it moves, 0 at rest
FORCE_AFTER = next(_rows)  # the force on it that its motion in a sample has left
LET_GO_AT = next(_rows)  # the force, with its sign, at which it let go in this sample, else 0
RESTED = next(_rows)  # samples since it came to rest

# Constants of a run.
SHARE = next(_rows)  # of the gap, that it covers in a sample
LEAST_GAP = next(_rows)  # below which it sticks
CREEP = next(_rows)  # in a sample, at rest
STOP_LOW = next(_rows)
STOP_HIGH = next(_rows)
HALF_PLAY = next(_rows)  # between stem and reading

# Levels, and what they are made of.
HALF_S = next(_rows)
HALF_J = next(_rows)
ASYMMETRY = next(_rows)
GROWTH = next(_rows)  # in a sample
FS_UP = next(_rows)  # breakaway, rising
FS_DOWN = next(_rows)
FD_UP = next(_rows)  # sliding, rising
FD_DOWN = next(_rows)
FORCE = next(_rows)  # that depends on place

# Reading and loss.
GAIN = next(_rows)
OFFSET = next(_rows)  # of the reading, where the stem is at mid-travel
DRIFT = next(_rows)  # in a sample
WANDER = next(_rows)  # at this sample
PRODUCT = next(_rows)  # of the samples' loss factors since it was last settled

# What tables add.
FRICTION = next(_rows)  # to both levels, by place
BREAKAWAY = next(_rows)  # to the breakaway, by the rest before
LOOKED_UP_AT = next(_rows)  # the place at which friction and force were looked up

# A spring with inner friction: where its three elements are anchored (``inner_friction``).
SHORT_ANCHOR = next(_rows)
MIDDLE_ANCHOR = next(_rows)
LONG_ANCHOR = next(_rows)

# A stem with inertia.
SPEED = next(_rows)  # percent per second
HEAVY_LET_GO_AT = next(_rows)  # LET_GO_AT and FORCE_AFTER, kept until ``move`` has run
HEAVY_FORCE_AFTER = next(_rows)

# While ``slide`` runs.
GOING = next(_rows)  # the side of its motion, 0 at rest
RISES_FROM = next(_rows)  # the force beyond which a stem at rest breaks away
FALLS_FROM = next(_rows)
