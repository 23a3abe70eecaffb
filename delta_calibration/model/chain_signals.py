"""Signals of a sample that the compiled chain itself reads or fills in, and the loads among them.

What an effect may take of a sample are named numbers in one row (`effects/signals.py`). Of most of
them the chain knows nothing; it has to find those below. Their places in the row are handed to it
as `Stages.at`, in the order of `NAMES`: `at[POSE]` is where the pose begins.
"""

from __future__ import annotations

NAMES = (
    "joint", "rate", "acceleration", "gravity", "inertia", "pull", "pull_home",
    "pose", "geometry", "load", "payload", "centre", "reading", "reading_rate",
)  # fmt: skip
(
    JOINT, RATE, ACCELERATION, GRAVITY, INERTIA, PULL, PULL_HOME,
    POSE, GEOMETRY, LOAD, PAYLOAD, CENTRE, READING, READING_RATE,
) = range(len(NAMES))  # fmt: skip

# Loads are asked for by a sum of these.
OF_WEIGHT, OF_INERTIA, OF_PULLS = 1, 2, 4
