"""Constants of the compiled chain, for its loops and for those who call them.

What an effect may take of a sample are named numbers in one row (`effects/signals.py`). Of most of
them the chain knows nothing; it has to find those of `NAMES`. Their places in the row are handed
to it as `Stages.at`, in this order: `at[POSE]` is where the pose begins.
"""

from __future__ import annotations

NAMES = (
    "joint",
    "rate",
    "acceleration",
    "gravity",
    "inertia",
    "pull",
    "pull_home",
    "pose",
    "geometry",
    "load",
    "reaction",
    "carried",
    "tightness",
    "payload",
    "centre",
    "reading",
    "reading_rate",
)
(
    JOINT,
    RATE,
    ACCELERATION,
    GRAVITY,
    INERTIA,
    PULL,
    PULL_HOME,
    POSE,
    GEOMETRY,
    LOAD,
    REACTION,
    CARRIED,
    TIGHTNESS,
    PAYLOAD,
    CENTRE,
    READING,
    READING_RATE,
) = range(len(NAMES))

# Loads are asked for by a sum of these.
OF_WEIGHT, OF_INERTIA, OF_PULLS, OF_DIMENSIONS, OF_REACTION = 1, 2, 4, 8, 16
OF_CARRIED, OF_TIGHTNESS = 32, 64

# Of what derivatives are asked for.
NOTHING, READINGS, POSES = range(3)

FREE_FALL = 9.80665  # [m/s^2] standard acceleration (ISO 80000-3)
MOMENT = 5e-3  # [s] over which a motion is differenced
STEPS = 25  # of Newton's method
SIDES = 12  # that may be derived at once: a place of a tool that is turned has as many
ROUNDS = 12  # of effects at the pose that they lead to, and of poses that are aimed at
STRAY = 1e-9  # a closure larger than this [m^2] after the last step is no solution
SETTLED_STEP = 1e-11  # [m, rad] last of Newton's; what is left is of the order of its square
LEFT = 1e-14  # [m, rad] that a step, or a round of effects, leaves where it is the last one
SMALL_STEP = 1e-7  # [m, rad] from which on what is left is known by the step before
ON_THE_WAY = 0.1  # of the way: a step after which a pose is near enough to lead on to the next
LEADS_ON = 0.01  # of the way to a pose: what a step leaves of it that leads there
SETTLED_POSE = 1e-12  # [m, rad] by which a round moves a pose
AIMED = 1e-9  # [m] by which a tool may miss its target after the last step, effects and all
SAME_POSE = 1e-6  # [m, rad] by which poses that are one differ at most
JOINED = 1e-9  # [rad, m] by which joints that are brought to a pose still move
