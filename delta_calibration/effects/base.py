"""What an effect is: one stage of the chain of measurement that a geometric model leaves out.

An effect adds to what a stage hands on, in proportion to its parameters v:

    shift = columns(conditions) @ v

at the joint angles behind the encoders (DRIVE), at the mechanism's geometry (STRUCTURE) or at the
tracker's reading (MEASUREMENT). What does not enter in proportion (a frequency, a time constant,
the moment of a step) is a field of the effect: `shapes` gives the ones worth trying. The columns
are so the derivative as well, and simulator, fit, verdict and compensator share them.

One file each; a line in `catalogue.py` makes an effect known everywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]
Setting = float | str | tuple[float, ...]
Limits = Mapping[str, tuple[float, float]]
Interval = tuple[str, float, float]

SPREAD = 5.0  # an effect may well be so many times its typical size, twenty are not to be expected


class Stage(Enum):
    """Where in the chain an effect adds, and the shape of its columns for n samples."""

    DRIVE = "joint angle"  # (n, m, k)
    STRUCTURE = "geometry"  # (n, p, k)
    MEASUREMENT = "reading"  # (n, 3, k)


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects; its fields after `mechanism` are its shape."""

    cause: ClassVar[str]  # by the fixed names
    kind: ClassVar[str]  # drive, structure or measurement, as reported
    stage: ClassVar[Stage]
    needs: ClassVar[tuple[str, ...]] = ()  # conditions without which it cannot be evaluated
    limits: ClassVar[Limits] = {}  # of settings that are numbers
    # what no more of the same cell's own motion can part it from, and what would
    outside: ClassVar[str] = ""

    robot: Robot
    mechanism: Mechanism

    @property
    @abstractmethod
    def parameters(self) -> ParameterSet:
        """What it is measured by: unit, expected size as prior about zero, physical bounds."""

    @abstractmethod
    def columns(self, at: Conditions) -> Array:
        """d(stage)/d(parameters) at each sample, (n, size of the stage, k)."""

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """The same effect with each shape that such data could tell; itself alone by default."""
        del at
        yield self

    def columns_kept(self, at: Conditions) -> Array:
        """The columns, computed once for these conditions where no shape is searched."""
        if self.settings or self.stage is Stage.MEASUREMENT:
            return self.columns(at)
        return at.kept(self.cause, (self.robot, self.mechanism), lambda: self.columns(at))

    def intervals(self) -> tuple[Interval, ...]:
        """Searched fields, and the bounds within which the best shape lies about this one."""
        return ()

    def refined(self, values: Array) -> Effect:
        """The same effect with the shape that these values of its parameters (k,) go with."""
        del values
        return self

    def doubt(self) -> Effect | None:
        """What a standard deviation of what its conditions leave open moves, a value a parameter.

        None where they are known well enough. It widens stated intervals (GUM, type B).
        """
        return None

    @property
    def suits(self) -> bool:
        """Whether the mechanism has what it acts on."""
        return True

    @property
    def settings(self) -> dict[str, Setting]:
        """The fields that are its shape, as a file holds them."""
        own = [f.name for f in fields(self) if f.name not in ("robot", "mechanism")]
        return {name: getattr(self, name) for name in own}

    def wrong(self) -> str:
        """What its shape cannot be: setting, value, what is allowed; empty where it can be."""
        for name, (low, high) in self.limits.items():
            value = self.settings[name]
            if not (isinstance(value, float) and low <= value <= high):
                return f"{name}: {value} is not allowed; {low:g} to {high:g}"
        return ""

    def missing(self, at: Conditions) -> str:
        """Why these conditions do not do to evaluate it; empty where they do."""
        known = np.isfinite(at.payload).all() and np.isfinite(at.payload_centre).all()
        if "payload" in self.needs and not known:
            return "the payload is not known"
        if "direction" in self.needs and not (at.direction != 0).any():
            return "the direction of the last motion is not known"
        return ""

    @property
    def bound_to_session(self) -> bool:
        """Whether it goes by the clock of the session it was found in, and ends with it."""
        return False

    def each_joint(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter a joint, `name` with the joint's number.

        What is given in radians is of a joint that turns; of another as much as does the same.
        """
        unit, size = self._of_joints(unit)
        limb = self.mechanism.limb
        each = (size * prior, self.cause), (size * lower, size * upper)
        return ParameterSet(
            tuple(
                Parameter(f"{name}_{j}", unit, 0.0, *each[0], f"{limb}_{j}", *each[1])
                for j in range(1, self.mechanism.joints + 1)
            )
        )

    def _of_joints(self, unit: str) -> tuple[str, float]:
        """The unit for these joints, and how many of it do what one radian does."""
        if not unit.startswith("rad"):
            return unit, 1.0
        return unit.replace("rad", self.mechanism.joint_unit, 1), self.mechanism.joint_size

    def shared(
        self, name: str, unit: str, prior: float, lower: float = -np.inf, upper: float = np.inf
    ) -> ParameterSet:
        """One parameter for the whole machine."""
        return ParameterSet((Parameter(name, unit, 0.0, prior, self.cause, None, lower, upper),))


def diagonal(values: Array) -> Array:
    """Each joint moved by its own parameter: (n, m) -> (n, m, m)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))
