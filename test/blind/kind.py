"""Interface of a machine of the generator; everything else is written once for all machines."""

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
Way = Callable[[Array], Array]  # times (n,) [s] -> plan coordinates (n, k)
Anything = TypeVar("Anything", bound=Any)
Span = tuple[float, float]

_CONFIG = Path(__file__).resolve().parents[2] / "config"


class Stand(Protocol):
    """Position of a machine at n samples."""

    place: Array  # (n, 3) [m] of the platform

    def point(self, local: Array) -> Array:
        """A point fixed to the platform, (3,) -> (n, 3) [m]."""

    def take(self, rows: Index) -> Any:
        """A subset of the samples."""


@dataclass(frozen=True)
class More:
    """Additions to parts of a build, sample by sample: (n, *shape of the part), or n = 1."""

    parts: Mapping[str, Array]

    def plus(self, part: str, by: Array) -> More:
        """The same with `by` added to a part."""
        return More({**self.parts, part: self.parts.get(part, 0.0) + by})

    def of(self, part: str) -> Array | float:
        """Addition to a part; 0 if it is as built."""
        return self.parts.get(part, 0.0)

    def take(self, rows: Index) -> More:
        """A subset of the samples."""
        return More({k: v if len(v) == 1 else v[rows] for k, v in self.parts.items()})


class Kind(ABC):
    """A kind of machine: geometry, masses, possible commands, warming.

    A build is a frozen dataclass of arrays, one of them `zero`, of the joints. Plans are written
    in coordinates u (n, k) along which the controller moves smoothly: joints unless stated
    otherwise, a pose where the joints cannot be moved one by one.
    """

    robot: str  # name of the robot file
    joints: tuple[str, ...]
    size: float = 1.0  # joint unit equivalent to one radian on a Delta
    rest: float  # [joint unit] error at rest, drawn once per move
    encoder: float  # [joint unit]
    centre: Array = np.array([0.0, 0.0, -0.03])  # [m] of the payload, in the platform
    heavy: float = 2.0  # [kg] the second payload
    rise: Mapping[str, Span]  # [K] temperature rise of the parts
    constant: Mapping[str, Span]  # [s] time constant of the rise
    sensors: tuple[str, ...]  # parts with a temperature sensor
    far: Span = (2.6, 3.2)  # [m] of the tracker
    offset: float = 0.05  # [m] expected deviation of the reflector from the drawing
    noise: Span | None = None  # [m] per axis, at rest and in motion; from its sources if None
    # [m], [rad] expected deviation of each dimension
    expected: Mapping[str, Any]
    home: Array  # (k,) of u
    beside: Array  # (k,) of u at the start of the slow approach to a stop

    @abstractmethod
    def drawing(self) -> Any:
        """The nominal machine."""

    def manufactured(self, rng: np.random.Generator, scatter: float) -> Any:
        """A machine as built: every part deviates by `scatter` times its tolerance."""
        d = self.drawing()
        off = {
            f.name: getattr(d, f.name)
            + scatter * self.expected[f.name] * rng.standard_normal(getattr(d, f.name).shape)
            for f in fields(d)
        }
        return replace(d, **off)

    def nothing(self) -> Any:
        """No difference from the build."""
        return More({})

    @abstractmethod
    def assemble(self, q: Array, build: Any, changed: Any = None, near: Any = None) -> Any:
        """Position at joint angles q, (n, m); a solution `near` may serve as start."""

    @abstractmethod
    def masses(self, stand: Any, build: Any, payload: Array, centre: Array) -> tuple[Array, Array]:
        """Masses (n, k) [kg] of the moving parts, and their positions (n, k, 3) [m]."""

    def pulls(
        self, q: Array, build: Any, changed: Any, payload: Array, centre: Array, near: Any
    ) -> Array:
        """Tension of rods or cables [N]."""
        raise NotImplementedError(f"{self.robot} has neither rods nor cables")

    def pulls_of_motion(self, moved: Any) -> Array | float:
        """Additional tension of rods or cables by the motion of masses (`weight.Moved`) [N]."""
        del moved
        return 0.0

    @abstractmethod
    def reflector(self, rng: np.random.Generator) -> Array:
        """Position of the reflector on the platform, (3,) [m]."""

    # --- commands

    def command(self, u: Array) -> Array:
        """Joint commands (n, m) for plan coordinates."""
        return u

    @abstractmethod
    def places(self, rng: np.random.Generator, count: int) -> Array:
        """Stops distributed over the workspace, (count, k) of u."""

    @abstractmethod
    def at(self, points: Array) -> Array:
        """Plan coordinates for points of a circle, (n, 3) [m] -> (n, k) of u."""

    @abstractmethod
    def ring(self, angle: Array, radius: float, level: float) -> Array:
        """Points of a circle, (n, 3) [m]."""

    circle: Span = (0.14, -0.70)  # [m] radius and level of the measured circles
    others: tuple[Span, Span] = ((0.11, -0.74), (0.11, -0.74))  # the same of the held-out circles
    sweep: Array  # (s, k) of u, to either side of home


def read(robot: str) -> dict[str, Any]:
    """The robot's file."""
    with (_CONFIG / f"{robot}.yaml").open(encoding="utf-8") as file:
        return dict(yaml.safe_load(file))


def at(build: Anything, part: str, where: tuple[int, ...], size: float) -> Anything:
    """The same build with `size` added to one number of a part."""
    values = getattr(build, part).copy()
    values[where] += size
    return replace(build, **{part: values})
