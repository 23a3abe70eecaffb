"""The machine as bodies, joints and constraints: a MuJoCo model, written as its XML.

    base ( - soft mount) - motor, arm (hinges on one axis) - rod (ball joint) ... platform (free)

A drive joins motor and arm, which otherwise turn freely on the same axis: rigidly (their angles
are equal), with backlash (their difference has two stops), or by a spring, which with backlash is
slack between the stops. A rod is tied to the part at its other end by a common point; if that
joint is worn the point slides along the rod, by the clearance to either side. Constraints are as
stiff as the engine allows: under these loads they yield by some nanometres.
"""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
from numpy.typing import NDArray

from physics.machine import (
    ARM,
    ARM_CENTRE,
    ARM_KG,
    ELBOW_END,
    HALF,
    PLATFORM,
    PLATFORM_KG,
    RADIUS,
    ROD,
    ROD_KG,
    SIDES,
    Machine,
)

Array = NDArray[np.float64]

GRAVITY = 9.80665  # [m/s^2]
CENTRE = (0.0, 0.0, -0.03)  # [m] of a payload, in the platform's frame
STEP = 5e-4  # [s]

_HARD = "0.9999 0.9999 0.001 0.5 2"  # of a constraint: the stiffest that the engine allows
_THIN = 2e-6  # [kg m^2] of a rod about its own axis
_ARM_INERTIA = 0.283 - ARM_CENTRE**2  # of kg m^2: a tapered bar with this centre of mass
_BASE_KG, _BASE_INERTIA = 60.0, 2.0  # [kg], [kg m^2]
FOOT = 0.25  # [m] of each foot of the base from its centre, in both directions
_RATIO = 0.1  # of critical damping
_SLIPPERY = 1e-4  # [N m s/rad] of a ball joint
_SLUGGISH = 0.5  # [kg] armature for a stable spring at this step; without weight
_PIN = 0.5  # [kg] armature for a pin to reach its end without a jump; without weight
_GREASE = 50.0  # [N s/m] between pin and socket


def model_of(machine: Machine, payload: float) -> mujoco.MjModel:
    """Model of the machine with a payload [kg] on its platform."""
    return mujoco.MjModel.from_xml_string(Xml.tostring(_xml(machine, payload), encoding="unicode"))


def _xml(machine: Machine, payload: float) -> Xml.Element:
    root = Xml.Element("mujoco")
    _add(root, "compiler", angle="radian", autolimits="true")
    option = _add(root, "option", timestep=STEP, gravity=(0, 0, -GRAVITY))
    option.attrib |= {"integrator": "implicitfast", "tolerance": "1e-14", "iterations": "50"}
    default = _add(root, "default")
    _add(default, "equality", solref=(2 * STEP, 1), solimp=_HARD)
    joint = _add(default, "joint", solreflimit=(2 * STEP, 1), solimplimit=_HARD)
    joint.attrib |= {"solreffriction": _text((2 * STEP, 1)), "solimpfriction": _HARD}
    _add(default, "tendon", solreflimit=(2 * STEP, 1), solimplimit=_HARD)
    world = _add(root, "worldbody")
    base = _base(world, machine)
    platform = _platform(world, machine, payload)
    equality, tendon = _add(root, "equality"), _add(root, "tendon")
    for leg in range(3):
        arm = _leg(base, machine, leg)
        _drive(equality, tendon, machine, leg)
        for side in range(2):
            _rod(arm, platform, machine, leg, side)
            _socket(equality, machine, f"{leg}{side}")
    return root


def _base(world: Xml.Element, machine: Machine) -> Xml.Element:
    base = _add(world, "body", name="base")
    if np.isfinite(machine.mount):
        _add(base, "inertial", pos=(0, 0, 0), mass=_BASE_KG, diaginertia=3 * (_BASE_INERTIA,))
        turning = machine.mount * FOOT**2
        swinging = _BASE_INERTIA + _BASE_KG * machine.feet**2
        stiff = {"slide": (machine.mount, _BASE_KG), "hinge": (turning, swinging)}
        for kind, (k, inertia) in stiff.items():
            for axis in np.eye(3):
                spring = {"stiffness": k, "damping": 2 * _RATIO * np.sqrt(k * inertia)}
                _add(base, "joint", type=kind, axis=axis, pos=(0, 0, -machine.feet), **spring)
    return base


def _platform(world: Xml.Element, machine: Machine, payload: float) -> Xml.Element:
    platform = _add(world, "body", name="platform", pos=(0, 0, -_height()))
    _add(platform, "freejoint")
    _add(platform, "inertial", pos=(0, 0, 0), mass=PLATFORM_KG, diaginertia=(2e-3, 2e-3, 4e-3))
    _add(platform, "site", name="reflector", pos=(0, 0, 0))
    if payload:
        load = _add(platform, "body", pos=CENTRE)
        _add(load, "inertial", pos=(0, 0, 0), mass=payload, diaginertia=3 * (1e-3 * payload,))
    return platform


def _leg(base: Xml.Element, machine: Machine, leg: int) -> Xml.Element:
    """Add motor and arm on their axis; return the arm."""
    outward, along = _directions(leg)
    frame = {"pos": outward * RADIUS + _placed(machine.hinge[leg], leg)}
    frame["xyaxes"] = (*outward, *along)
    motor = _add(base, "body", name=f"motor_{leg}", **frame)
    _add(motor, "joint", name=f"motor_{leg}", axis=(0, 1, 0), armature=1e6)
    _add(motor, "inertial", pos=(0, 0, 0), mass=1e-3, diaginertia=3 * (1e-6,))
    arm = _add(base, "body", name=f"arm_{leg}", **frame)
    _add(arm, "joint", name=f"arm_{leg}", axis=(0, 1, 0), frictionloss=machine.friction[leg])
    inertia = ARM_KG * _ARM_INERTIA * machine.arm[leg] ** 2
    centre = (ARM_CENTRE * machine.arm[leg], 0, 0)
    _add(arm, "inertial", pos=centre, mass=ARM_KG, diaginertia=(1e-3, inertia, inertia))
    for side in range(2):
        _add(arm, "site", name=f"elbow_{leg}{side}", pos=machine.elbow(leg, side))
    return arm


def _drive(equality: Xml.Element, tendon: Xml.Element, machine: Machine, leg: int) -> None:
    zero, gap, k = machine.zero[leg], machine.gap[leg], machine.drive[leg]
    names = {"joint1": f"arm_{leg}", "joint2": f"motor_{leg}"}
    if not np.isfinite(k) and not gap:
        _add(equality, "joint", polycoef=(zero, 1, 0, 0, 0), **names)
        return
    stops = (zero - gap / 2, zero + gap / 2)
    limits = {"springlength": stops, "stiffness": k} if np.isfinite(k) else {"range": stops}
    damping = 2 * _RATIO * np.sqrt((k if np.isfinite(k) else 2.5e4) * 0.15)
    drive = _add(tendon, "fixed", name=f"drive_{leg}", damping=damping, **limits)
    _add(drive, "joint", joint=names["joint1"], coef=1)
    _add(drive, "joint", joint=names["joint2"], coef=-1)


def _rod(arm: Xml.Element, platform: Xml.Element, machine: Machine, leg: int, side: int) -> None:
    """Add a rod on a ball joint at its sound end, pointing at the other as in the home pose."""
    outward, along = _directions(leg)
    reach = RADIUS + machine.arm[leg] - PLATFORM
    way = np.array([-reach, 0.0, -_height()]) / np.hypot(reach, _height())
    ball = outward * PLATFORM + _placed(machine.ball[leg], leg) + along * SIDES[side] * HALF
    name, length = f"{leg}{side}", machine.rod[leg, side]
    _add(platform, "site", name=f"ball_{name}", pos=ball)
    if machine.clearance and machine.worn == ELBOW_END:
        back = -(outward * way[0] + np.array([0, 0, way[2]]))
        frame = {"pos": ball, "xyaxes": (*back, *along)}
        parent = platform
    else:
        frame = {"pos": machine.elbow(leg, side), "xyaxes": (*way, 0, 1, 0)}
        parent = arm
    rod = _add(parent, "body", name=f"rod_{name}", **frame)
    _add(rod, "joint", type="ball", damping=_SLIPPERY)
    if not np.isfinite(machine.rod_spring):
        _bar(rod, ROD_KG, length)
        _end(rod, machine, name, length)
        return
    _bar(rod, ROD_KG / 2, length / 2)
    other = _add(rod, "body", pos=(length / 2, 0, 0))
    damping = 2 * _RATIO * np.sqrt(machine.rod_spring * 0.3)
    spring = {"stiffness": machine.rod_spring, "damping": damping, "armature": _SLUGGISH}
    _add(other, "joint", type="slide", axis=(1, 0, 0), **spring)
    _bar(other, ROD_KG / 2, length / 2)
    _end(other, machine, name, length / 2)


def _end(rod: Xml.Element, machine: Machine, name: str, length: float) -> None:
    """Add the end of a rod: if its joint is worn, a pin that slides along it by the clearance."""
    end = _add(rod, "body", pos=(length, 0, 0)) if machine.clearance else rod
    place = (0, 0, 0) if machine.clearance else (length, 0, 0)
    _add(end, "site", name=f"end_{name}", pos=place)
    if machine.clearance:
        slack = (-machine.clearance, machine.clearance)
        sliding = {"damping": _GREASE, "armature": _PIN, "range": slack}
        _add(end, "joint", type="slide", axis=(1, 0, 0), **sliding)
        _add(end, "inertial", pos=(0, 0, 0), mass=1e-6, diaginertia=3 * (1e-9,))


def _bar(body: Xml.Element, kg: float, length: float) -> None:
    across = kg * length**2 / 12
    _add(body, "inertial", pos=(length / 2, 0, 0), mass=kg, diaginertia=(_THIN, across, across))


def _socket(equality: Xml.Element, machine: Machine, name: str) -> None:
    """Tie the end of a rod to the part that it is not fixed to by its own ball joint."""
    at_elbow = machine.clearance > 0 and machine.worn == ELBOW_END
    socket = f"elbow_{name}" if at_elbow else f"ball_{name}"
    _add(equality, "connect", site1=f"end_{name}", site2=socket)


def _directions(leg: int) -> tuple[Array, Array]:
    """Directions outward and along the motor's axis of a leg."""
    angle = 2 * np.pi / 3 * leg
    return np.array([np.cos(angle), np.sin(angle), 0]), np.array(
        [-np.sin(angle), np.cos(angle), 0]
    )


def _placed(shift: Array, leg: int) -> Array:
    """A shift in a leg's directions, (3,) -> (3,) [m]."""
    outward, along = _directions(leg)
    return outward * shift[0] + along * shift[1] + np.array([0, 0, shift[2]])


def _height() -> float:
    """Distance of the platform below the base with arms level [m]."""
    return float(np.sqrt(ROD**2 - (RADIUS + ARM - PLATFORM) ** 2))


def _add(parent: Xml.Element, tag: str, **attributes: object) -> Xml.Element:
    return Xml.SubElement(parent, tag, {name: _text(value) for name, value in attributes.items()})


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    return " ".join(repr(float(number)) for number in np.atleast_1d(np.asarray(value)))
