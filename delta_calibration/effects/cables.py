"""Base of the effects on a cable robot: cable lengths that differ from k theta.

    |a - P - R b| = l_0 + k theta + dl        dl = change(at) - change(home)

Any change of the length between anchor and platform acts as the angle dl / k behind the encoder,
so all these effects belong to the chain's first stage. The change at home is part of the
counter's zero. A drive that counts the other way reads -dl / k.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.signals import (
    GEOMETRY,
    JOINT,
    POSE,
    PULL,
    PULL_HOME,
    Places,
    Signals,
)
from delta_calibration.mechanisms import CableRobot
from delta_calibration.model.symbols import Symbol, norm, rotation, sqrt
from delta_calibration.model.terms import Term

_PULLS = 3  # signals of a cable before its pose: joint, pull and pull at home
WINCH = 4  # constants of a cable before its home pose: gear, tackle, sense and zero of its drive


@dataclass(frozen=True)
class CableEffect(Effect):
    """Base of the effects on cables, with one parameter shared by all cables or one each."""

    stage: ClassVar[Stage] = Stage.DRIVE
    gentle: ClassVar[bool] = True
    takes: ClassVar[tuple[str, ...]] = (JOINT, PULL, PULL_HOME, POSE, GEOMETRY)

    @property
    def suits(self) -> bool:
        """Whether the mechanism has cables."""
        return isinstance(self.mechanism, CableRobot)

    @property
    def cables(self) -> CableRobot:
        """The mechanism, which is a cable robot."""
        assert isinstance(self.mechanism, CableRobot)
        return self.mechanism

    @property
    def variant(self) -> str:
        """Variant of the mechanism: a point or a body."""
        return self.mechanism.variant

    def terms(self, places: Places) -> Iterator[Term]:
        """One term per cable: joint, pulls, pose, dimensions; constants of winch and home."""
        d, shared = self.cables.dimensions, len(self.parameters) == 1
        drives = self.mechanism.drives
        pose = range(places.begin(POSE), places.begin(POSE) + self.mechanism.pose_size)
        for i, limb in enumerate(self.mechanism.limbs):
            own = (places.begin(name) + i for name in (JOINT, PULL, PULL_HOME))
            known = [n for n in limb.dimensions if n < len(self.mechanism.parameters)]
            used = known[: self.mechanism.pose_size + 1]
            dimensions = [places.begin(GEOMETRY) + n for n in used]
            winch = (d.gear[i], d.tackle[i], drives.sense[i], drives.zero[i])
            constants = (*map(float, winch), *d.home.tolist())
            yield Term((*own, *pose, *dimensions), (0 if shared else i,), (i,), constants)

    def pulls(self, signals: Signals) -> Array:
        """Pull of each cable under platform and payload, (n, m) [N]."""
        return signals.of(PULL)


@dataclass(frozen=True)
class Cable:
    """Named signals and constants of a cable, in symbols."""

    angle: Symbol  # motor angle from home, positive where it lets out [rad]
    pull: Symbol  # [N]
    pull_home: Symbol  # [N]
    at: Symbol  # vector from anchor to platform joint [m]
    home: Symbol  # the same vector at home
    gain: Symbol  # k [m/rad] of the drive's reading, negative if that falls on letting out
    gear: Symbol
    tackle: Symbol


def cable(s: Symbol, c: Symbol) -> Cable:
    """Named quantities of a term's cable, from its signals s and constants c."""
    size = c.shape[0] - WINCH  # of the pose
    x, g = s[_PULLS : _PULLS + size], s[_PULLS + size :]
    here, home = (_end(pose, g) - g[0:3] for pose in (x, c[WINCH:]))
    gear, tackle, sense, zero = (c[i] for i in range(WINCH))
    angle = sense * (s[0] - zero)
    return Cable(angle, s[1], s[2], here, home, sense * g[size], gear, tackle)


def length(v: Symbol) -> Symbol:
    """Length of a vector [m]."""
    return norm(v)


def level(v: Symbol) -> Symbol:
    """Horizontal length of a vector [m]."""
    return sqrt(v[0] ** 2 + v[1] ** 2)


def _end(x: Symbol, g: Symbol) -> Symbol:
    """Position of the cable's end on the platform [m]."""
    return x[0:3] + rotation(x[3:6]) @ g[3:6] if x.shape[0] == 6 else x[0:3]
