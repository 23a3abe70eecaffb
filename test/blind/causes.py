"""All causes by name, and the syntax for requesting them.

`backlash` is in all joints, in each with its own size; `backlash@2` is in joint 2 alone.
`arm_length` is wrong in one chain drawn by the seed, `arm_length@3` in chain 3. `unknown` is
something in no catalogue whose kind the seed draws from the seven in `unknown`; `unknown:ripple`
is of this kind. The kinds in `unnamed` are requested by name.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from blind.cause import Cause, Draw
from blind.drives import DRIVES
from blind.geometry import GEOMETRY
from blind.kinds import KINDS, OTHERS
from blind.measurement import MEASUREMENT
from blind.structure import STRUCTURE
from blind.unknown import UNKNOWN
from blind.unnamed import UNNAMED

CAUSES: dict[str, Draw] = {**GEOMETRY, **MEASUREMENT, **DRIVES, **STRUCTURE}
IN_NO_CATALOGUE: dict[str, Draw] = {**UNKNOWN, **UNNAMED}


def draw(asked: str, strength: float, rng: np.random.Generator, robot: str = "srbd") -> Cause:
    """The cause that `asked` names, in a machine of this robot, with its sizes drawn.

    Raises:
        KeyError: there is no such cause.
    """
    name, _, leg = asked.partition("@")
    joints = len(KINDS[robot].joints)
    legs = np.ones(joints) if not leg else np.eye(joints)[int(leg) - 1]
    named, any_unknown, unknown = CAUSES, list(UNKNOWN), IN_NO_CATALOGUE
    if robot in OTHERS:
        named, unknown = OTHERS[robot]
        any_unknown = list(unknown)
    if name == "unknown":
        name = f"unknown:{rng.choice(any_unknown)}"
    kind = name.removeprefix("unknown:")
    drawn = (named if kind == name else unknown)[kind](rng, strength, legs)
    if leg and drawn.location is None:
        return replace(drawn, location=f"joint_{leg}")
    return drawn
