"""The reflector, or the tool that carries it, was knocked, and sits elsewhere on the platform.

do = s h(time)          in the platform's axes

On a platform that never turns this cannot be distinguished from a shift of the tracker, so only
machines whose platform turns have it. A tool that was knocked moves the place that the robot works
at; a reflector that was knocked moves only the readings. The readings are the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.data import Conditions
from delta_calibration.effects.base import Effect, Setting, Stage
from delta_calibration.effects.remedy import MEASURE, Remedy
from delta_calibration.effects.signals import TIME
from delta_calibration.effects.time_course import Drift, course
from delta_calibration.model.symbols import Symbol
from delta_calibration.parameters import Parameter, ParameterSet

_KNOCKED, _FARTHEST = 0.3e-3, 20e-3  # [m]; farther is a mistake that `delta-cal check` finds
_USUAL = 1800.0  # [s]
_ASIDE = 0.02  # of a joint's size: a joint's distance from home at which the platform is seen
_TURNS = 0.05  # [rad] a platform that turns less per joint size does not turn


@dataclass(frozen=True)
class ReflectorShift(Drift):
    """Shift of the reflector in the platform; a session is searched for steps only."""

    cause: ClassVar[str] = "reflector_shift"
    called: ClassVar[str] = "reflector that was knocked"
    remedy: ClassVar[Remedy] = Remedy(
        MEASURE,
        "reflector",
        "fasten tool and reflector, and measure the session again",
        "repeat three of the first poses, at which the platform is turned differently: their "
        "readings have changed by unlike vectors",
    )
    kind: ClassVar[str] = "measurement"
    stage: ClassVar[Stage] = Stage.REFLECTOR
    outside: ClassVar[str] = "measure the place of the reflector on the tool again"
    takes: ClassVar[tuple[str, ...]] = (TIME,)

    @property
    def suits(self) -> bool:
        """Whether the platform turns as the joints move."""
        model = self.mechanism
        aside = model.joint_size * _ASIDE * np.eye(model.joints)
        x = model.forward(np.vstack([model.home, model.home + aside]), model.parameters.nominal)
        turned = model.rotation(x[np.isfinite(x).all(axis=1)])
        return bool(np.abs(turned - turned[:1]).max(initial=0.0) > _TURNS * _ASIDE)

    @property
    def unsuited(self) -> str:
        """Reason why the effect does not suit the mechanism."""
        return (
            f"the platform of robot {self.robot.name} does not turn: a shift of the reflector is "
            "the same as one of the tracker"
        )

    @property
    def parameters(self) -> ParameterSet:
        """s [m] in the platform's axes."""
        size = 0.0, _KNOCKED, self.cause, None, -_FARTHEST, _FARTHEST
        return ParameterSet(tuple(Parameter(f"shift_{axis}", "m", *size) for axis in "xyz"))

    def usual(self, thermometers: Collection[str]) -> dict[str, Setting]:
        """A knock in the first hour."""
        del thermometers
        return {"step_at": _USUAL}

    def shapes(self, at: Conditions) -> Iterator[Effect]:
        """Knocks between stops and in motions."""
        yield from (shape for shape in super().shapes(at) if shape.settings["step_at"] != -1.0)

    @staticmethod
    def law(s: Symbol, v: Symbol, c: Symbol) -> Symbol:
        """s h(time)."""
        return v[0:3] * course(s[0], c[0], c[1], c[2], c[3])
