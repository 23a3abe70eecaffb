"""Constants of the compiled chain, for its loops and their callers.

Effects read the signals of a sample, named numbers in one row (`effects/signals.py`). The chain
itself uses only those of `NAMES`. Their places in the row are passed to it as `Stages.at`, in this
order: `at[POSE]` is where the pose begins.
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
    "reading_acceleration",
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
    READING_ACCELERATION,
) = range(len(NAMES))

# Flags of the loads to evaluate; their sum is passed as `asked`.
OF_WEIGHT, OF_INERTIA, OF_PULLS, OF_DIMENSIONS, OF_REACTION = 1, 2, 4, 8, 16
OF_CARRIED, OF_TIGHTNESS = 32, 64

# Which derivatives to compute: none, of readings, of poses.
NOTHING, READINGS, POSES = range(3)

FREE_FALL = 9.80665  # [m/s^2] standard acceleration (ISO 80000-3)
MOMENT = 5e-3  # [s] time step of the finite differences along a motion
STEPS = 25  # largest number of Newton steps
SIDES = 12  # most outputs differentiated at once: a tool place with rotation has as many
ROUNDS = 12  # most rounds of the effects at a pose, and most steps of a pose to its target
STRAY = 1e-9  # a closure larger than this [m^2] after the last step is no solution
SETTLED_STEP = 1e-11  # [m, rad] last Newton step; the error left is of the order of its square
LEFT = 1e-14  # [m, rad] estimated error left, at which a step or a round of effects is the last
SMALL_STEP = 1e-7  # [m, rad] smaller steps: the error left is estimated from the step before
ON_THE_WAY = 0.1  # of the way: a step this small ends an intermediate stage (`kernels.lead`)
LEADS_ON = 0.01  # of the distance to a pose: a step that leaves no more converges to that pose
SETTLED_POSE = 1e-12  # [m, rad] a round that moves the pose no more than this is the last
AIMED = 1e-9  # [m] largest miss of a tool's target after the last step, effects included
ASIDE = 1e-6  # [m, rad] step of the finite differences by the pose
SAME_POSE = 1e-6  # [m, rad] poses that differ by no more are the same
JOINED = 1e-9  # [rad, m] last step of joints that are solved for a pose
