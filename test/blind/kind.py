"""What the generator asks of a machine; everything else is written once, for all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Way = Callable[[Array], Array]  # times (n,) [s] -> what the plan commands (n, k)
Anything = TypeVar("Anything", bound=Any)
Span = tuple[float, float]

_CONFIG = Path(__file__).resolve().parents[2] / "config"


class Stand(Protocol):
    """Where a machine stands at n samples."""

    place: Array  # (n, 3) [m] of the platform

    def point(self, local: Array) -> Array:
        """A point fixed to the platform, (3,) -> (n, 3) [m]."""

    def take(self, rows: Index) -> Any:
        """Some of the samples."""


@dataclass(frozen=True)
class More:
    """What is added to parts of a build, sample by sample: (n, *shape of the part), or n = 1."""

    parts: Mapping[str, Array]

    def plus(self, part: str, by: Array) -> More:
        """The same with `by` more of a part."""
        return More({**self.parts, part: self.parts.get(part, 0.0) + by})

    def of(self, part: str) -> Array | float:
        """Of a part; 0 where it is as built."""
        return self.parts.get(part, 0.0)

    def take(self, rows: Index) -> More:
        """Some of the samples."""
        return More({k: v if len(v) == 1 else v[rows] for k, v in self.parts.items()})


class Kind(ABC):
    """A kind of machine: its geometry, its masses, what may be commanded, how it warms.

    A build is a frozen dataclass of arrays, one of them `zero`, of the joints. Plans are written
    in coordinates u (n, k) that the controller moves along smoothly: joints where nothing else is
    said, a pose where the joints cannot be moved one by one.
    """

    robot: str  # name of the robot's file
    joints: tuple[str, ...]
    size: float = 1.0  # of the joints' unit, that does what one radian does on a Delta
    rest: float  # [joint unit] where a joint comes to rest, one draw a move
    encoder: float  # [joint unit]
    centre: Array = np.array([0.0, 0.0, -0.03])  # [m] of the payload, in the platform
    heavy: float = 2.0  # [kg] the second payload
    rise: Mapping[str, Span]  # [K] how far parts warm
    constant: Mapping[str, Span]  # [s] how fast
    sensors: tuple[str, ...]  # parts with a thermometer
    far: Span = (2.6, 3.2)  # [m] of the tracker
    offset: float = 0.05  # [m] how far from the drawing the reflector is expected
    noise: Span | None = None  # [m] an axis, at rest and in motion; by its sources where None
    # [m], [rad] how far off each dimension is expected to be
    expected: Mapping[str, Any]
    home: Array  # (k,) of u
    beside: Array  # (k,) of u where the slow approach to a stop begins

    @abstractmethod
    def drawing(self) -> Any:
        """The machine as drawn."""

    def manufactured(self, rng: np.random.Generator, scatter: float) -> Any:
        """A machine as built: every part off by `scatter` times its tolerance."""
        d = self.drawing()
        off = {
            f.name: getattr(d, f.name)
            + scatter * self.expected[f.name] * rng.standard_normal(getattr(d, f.name).shape)
            for f in fields(d)
        }
        return replace(d, **off)

    def nothing(self) -> Any:
        """Nothing that differs from the build."""
        return More({})

    @abstractmethod
    def assemble(self, q: Array, build: Any, changed: Any = None, near: Any = None) -> Any:
        """Where it stands at joint angles q, (n, m); a start `near` may help."""

    @abstractmethod
    def masses(self, stand: Any, build: Any, payload: Array, centre: Array) -> tuple[Array, Array]:
        """Masses (n, k) [kg] of what moves, and where they are (n, k, 3) [m]."""

    def pulls(
        self, q: Array, build: Any, changed: Any, payload: Array, centre: Array, near: Any
    ) -> Array:
        """Tension of rods or cables [N]."""
        raise NotImplementedError(f"{self.robot} has neither rods nor cables")

    def pulls_of_motion(self, moved: Any) -> Array | float:
        """More tension of them where masses are moved (`weight.Moved`) [N]."""
        del moved
        return 0.0

    @abstractmethod
    def reflector(self, rng: np.random.Generator) -> Array:
        """Where it sits on the platform, (3,) [m]."""

    # --- what is commanded

    def command(self, u: Array) -> Array:
        """Joints (n, m) for what the plan wants."""
        return u

    @abstractmethod
    def places(self, rng: np.random.Generator, count: int) -> Array:
        """Stops all over the workspace, (count, k) of u."""

    @abstractmethod
    def at(self, points: Array) -> Array:
        """What to command for points of a circle, (n, 3) [m] -> (n, k) of u."""

    @abstractmethod
    def ring(self, angle: Array, radius: float, level: float) -> Array:
        """Points of a circle, (n, 3) [m]."""

    circle: Span = (0.14, -0.70)  # [m] radius and level that are measured
    others: tuple[Span, Span] = ((0.11, -0.74), (0.11, -0.74))  # those that are held out
    sweep: Array  # (s, k) of u, to either side of home


def read(robot: str) -> dict[str, Any]:
    """The robot's file."""
    with (_CONFIG / f"{robot}.yaml").open(encoding="utf-8") as file:
        return dict(yaml.safe_load(file))


def at(build: Anything, part: str, where: tuple[int, ...], size: float) -> Anything:
    """The same build with one number of a part more by `size`."""
    values = getattr(build, part).copy()
    values[where] += size
    return replace(build, **{part: values})
