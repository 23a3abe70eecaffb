"""Every law of the package, its generated file, and its machine code.

A mechanism gives its laws when it has a drawing, an effect when it has a mechanism; those of an
arm, or of a cable robot, differ from machine to machine. So the laws are those of the robots in
`config/`, of arms of two to seven joints and of a point on cables.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path

import numpy as np

from delta_calibration.effects import Effect, catalogue
from delta_calibration.effects.base import law_for
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.signals import Places
from delta_calibration.effects.unexplained import DIRECTION, JOINT, POSITION, Unexplained
from delta_calibration.mechanisms import MECHANISMS, CableDimensions, CableRobot, Mechanism
from delta_calibration.mechanisms.cable_dimensions import CableTolerances
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmDimensions, ArmTolerances, Link
from delta_calibration.model.law import Law
from delta_calibration.model.library import GENERATED
from delta_calibration.robot import Robot, known_robots, load_robot

_PACKAGE = "delta_calibration."
_ARMS = range(2, 8)  # joints


def every_law() -> tuple[Law, ...]:
    """The laws of the package, each once, by name."""
    laws: dict[str, Law] = {}
    for law in _laws():
        same = laws.setdefault(law.name, law)
        assert same.layout == law.layout, f"two laws are named {law.name}"
    return tuple(laws[name] for name in sorted(laws))


def folder() -> Path:
    """Where the generated files of the package are."""
    return Path(str(import_module(GENERATED).__file__)).parent


def write(laws: Iterable[Law], into: Path) -> tuple[Path, ...]:
    """Write the generated file of each law into a folder, and remove those of no law.

    Returns:
        What is new, changed or gone.
    """
    wanted = {into / f"{law.name}.py": law.source() for law in laws}
    found = {path for path in into.glob("*.py") if path.name != "__init__.py"}
    changed = []
    for path, text in wanted.items():
        if path not in found or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            changed.append(path)
    for path in sorted(found - set(wanted)):
        path.unlink()
        changed.append(path)
    return tuple(changed)


def prepare(laws: Iterable[Law]) -> int:
    """Compile the laws whose machine code is not kept yet; how many laws there are."""
    return sum(law.compiled.size > 0 for law in laws)


def _laws() -> Iterator[Law]:
    for robot, mechanism in _machines():
        yield from mechanism.laws
        for effect in _effects(robot, mechanism):
            terms = tuple(effect.terms(Places.of(mechanism, ())))
            yield from (law_for(effect, term) for term in terms[:1])


def _machines() -> Iterator[tuple[Robot, Mechanism]]:
    """A machine of each kind that has laws of its own, and a robot that may stand for its own."""
    robots = {name: load_robot(name) for name in known_robots()}
    own = [kind for kind in MECHANISMS.values() if kind.__module__.startswith(_PACKAGE)]
    for robot in robots.values():
        for kind in own:
            if isinstance(robot.dimensions, kind.Dimensions):
                yield robot, robot.model(kind.name)
    for count in _ARMS:
        arm = ArmDimensions((_LINK,) * count, np.zeros(3), np.zeros(count), np.zeros(3))
        yield robots["ur10"], SerialArm(arm, ArmTolerances(*np.ones(5).tolist()))
    yield robots["cdpr8"], CableRobot(_POINT, CableTolerances(1.0, 1.0, 1.0))


def _effects(robot: Robot, mechanism: Mechanism) -> Iterator[Effect]:
    """All that a machine can have: the catalogue, a curve of each joint, and maps of all forms."""
    every = catalogue(robot, mechanism)
    yield from (effect for effect in every if type(effect).__module__.startswith(_PACKAGE))
    here, size = (0.0,) * mechanism.joints, mechanism.joint_size
    yield JointCurve(robot, mechanism, lower=here, upper=(size,) * mechanism.joints)
    yield Unexplained(robot, mechanism, DIRECTION)
    for family in (POSITION, JOINT):
        yield Unexplained(robot, mechanism, family, width=size, centres=here)


_LINK = Link(0.0, 0.0, 0.0)
_POINT = CableDimensions(
    anchors=np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, 2.0]]),
    joints=np.zeros((4, 3)),
    drum_radius=np.ones(4),
    gear=np.ones(4),
    tackle=np.ones(4),
    home_place=np.array([0.0, 0.0, 1.0]),
    pretension=1.0,
)
