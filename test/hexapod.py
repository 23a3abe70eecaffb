"""A hexapod: as a user's mechanism with masses, and as a machine that shares no code with it.

Six legs of variable length carry a platform. The machine is measured where its legs bring it: its
joints follow from distances between points in space, loads from the balance of forces and moments.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from delta_calibration.data import Poses, Rejected
from delta_calibration.mechanisms import Mechanism
from delta_calibration.mechanisms.base import Limb
from delta_calibration.model.symbols import norm, rotation, square
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import load_robot
from delta_calibration.sections import length, mass, place, tolerance

Array = NDArray[np.float64]

LEGS = 6
HEIGHT, KILOGRAMS, GRAVITY = 0.65, 8.0, 9.80665
JOINT, LEG = 0.2e-3, 0.3e-3  # [m] tolerances
REPEATABILITY, NOISE, TURN_NOISE = 3e-6, 8e-6, 20e-6  # [m], [m], [rad]
TURN, PLACE = Rotation.from_rotvec([0.02, -0.03, 1.1]), np.array([-2.1, 1.6, 0.3])  # the tracker


def _ring(radius: float, apart: float, first: float) -> Array:
    """Three pairs of points on a circle in the plane z = 0, (6, 3) [m]."""
    middle = first + 2 * np.pi / 3 * np.repeat(np.arange(3), 2)
    angle = middle + apart * np.tile([-1.0, 1.0], 3)
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


BASE, PLATFORM = _ring(0.5, 0.26, 0.0), _ring(0.25, 0.87, 0.0)
STRUT = float(np.linalg.norm(PLATFORM[0] + [0, 0, HEIGHT] - BASE[0]))


class Hexapod(Mechanism):
    """Closure of leg i: |p + R b_i - a_i|^2 = (l_i + q_i)^2; parameters a, b, l of each leg."""

    @dataclass(frozen=True)
    class Dimensions:
        base: Array = place(shape=(LEGS, 3))
        platform: Array = place(shape=(LEGS, 3))
        height: float = length()
        leg: float = length()

    @dataclass(frozen=True)
    class Tolerances:
        joint: float = tolerance()
        leg: float = tolerance()

    @dataclass(frozen=True)
    class Masses:
        on_platform: float = mass(key="platform_kg")

    name, joint_unit, joint_size = "hexapod", "m", 0.3
    joints = pose_size = task_size = LEGS
    home = np.zeros(LEGS)
    limbs = tuple(Limb((i,), tuple(range(7 * i, 7 * i + 7)), (i,)) for i in range(LEGS))

    def __init__(self, dimensions, tolerances):
        d, t = dimensions, tolerances
        self.height = d.height
        ends = ("base_joint_position", d.base), ("platform_joint_position", d.platform)
        self.parameters = ParameterSet(
            tuple(
                item
                for i in range(LEGS)
                for item in (
                    *(
                        Parameter(
                            f"{cause[:4]}_{axis}_{i + 1}",
                            "m",
                            float(at[i][k]),
                            t.joint,
                            cause,
                            f"joint_{i + 1}",
                        )
                        for cause, at in ends
                        for k, axis in enumerate("xyz")
                    ),
                    Parameter(f"leg_{i + 1}", "m", d.leg, t.leg, "arm_length", f"joint_{i + 1}"),
                )
            )
        )

    @property
    def home_pose(self):
        return np.array([0.0, 0.0, self.height, 0.0, 0.0, 0.0])

    @staticmethod
    def equation(q, x, g, c):
        return square(x[0:3] + rotation(x[3:6]) @ g[3:6] - g[0:3]) - (g[6] + q) ** 2

    @staticmethod
    def reaching(x, g, c):
        return norm(x[0:3] + rotation(x[3:6]) @ g[3:6] - g[0:3]) - g[6]


def write_robot(path: Path) -> None:
    """Robot file of the hexapod; sections that do not matter are those of a linear Delta."""
    data = YAML(typ="safe").load(Path(load_robot("linear_delta").source))
    data |= {
        "name": "hexapod",
        "mechanism": "hexapod",
        "geometry": {
            "base_mm": (1e3 * BASE).tolist(),
            "platform_mm": (1e3 * PLATFORM).tolist(),
            "height_mm": 1e3 * HEIGHT,
            "leg_mm": 1e3 * STRUT,
        },
        "tolerances": {"joint_mm": 1e3 * JOINT, "leg_mm": 1e3 * LEG},
        "masses": {"platform_kg": KILOGRAMS},
        "workspace": {"centre_mm": [0, 0, 1e3 * HEIGHT], "size_mm": [200, 200, 120]},
    }
    data["joints"] |= {
        "names": [f"leg_{i + 1}" for i in range(LEGS)],
        "lower_mm": [-250.0] * LEGS,
        "upper_mm": [250.0] * LEGS,
        "gear_ratio_turns_per_m": 100.0,
        "repeatability_um": 1e6 * REPEATABILITY,
    }
    data["tracker"] |= {
        "measures": "pose",
        "radial_um": 1e6 * NOISE,
        "transverse_um": 1e6 * NOISE,
        "transverse_um_per_m": 0.0,
        "turn_urad": 1e6 * TURN_NOISE,
        "reflector_offset_mm": [0.0, 0.0, 0.0],
        "reflector_offset_prior_mm": 5.0,
    }
    YAML().dump(data, path)


class Machine:
    """Dimensions scatter; `give` [m/N] of each leg, `growth` [1/K] of the base."""

    def __init__(self, rng, give=0.0, growth=0.0, longer=(0.0,) * LEGS):
        self.base = BASE + JOINT * rng.standard_normal((LEGS, 3))
        self.platform = PLATFORM + JOINT * rng.standard_normal((LEGS, 3))
        self.leg = STRUT + LEG * rng.standard_normal(LEGS) + longer
        self.give, self.growth = give, growth

    def measured(self, rng, places=60, payloads=(0.0,), hours=1.0) -> Poses:
        """Poses at the same places with each payload, in random order, while the base warms."""
        want = rng.uniform(-1, 1, (places, LEGS)) * [0.1, 0.1, 0.06, *3 * (0.12,)]
        want[:, 2] += HEIGHT
        on = PLATFORM @ np.swapaxes(Rotation.from_rotvec(want[:, 3:]).as_matrix(), 1, 2)
        q = np.linalg.norm(want[:, None, :3] + on - BASE, axis=2) - STRUT
        order = rng.permutation(places * len(payloads))
        q, want = (np.tile(v, (len(payloads), 1))[order] for v in (q, want))
        load = np.repeat(payloads, places)[order]
        time = np.linspace(0.0, 3600.0 * hours, len(q))
        warm = 12.0 * (1 - np.exp(-time / 2000.0))
        true = np.array(
            [
                self._pose(a + REPEATABILITY * rng.standard_normal(LEGS), kg, k, near)
                for a, kg, k, near in zip(q, load, warm, want, strict=True)
            ]
        )
        point = TURN.apply(true[:, :3]) + PLACE + NOISE * rng.standard_normal((len(q), 3))
        noise = Rotation.from_rotvec(TURN_NOISE * rng.standard_normal((len(q), 3)))
        turned = noise * TURN * Rotation.from_rotvec(true[:, 3:])
        return _poses(q, point, turned.as_quat(), time, load)

    def _pose(self, q, kg, kelvin, near):
        """Position and rotation vector of the platform, (6,), its legs pressed by the load."""
        base, length = self.base * (1 + self.growth * kelvin), self.leg + q
        x, weight = np.array(near), -GRAVITY * (KILOGRAMS + kg)
        for _ in range(30):
            arm = Rotation.from_rotvec(x[3:]).apply(self.platform)
            legs = x[:3] + arm - base
            now = np.linalg.norm(legs, axis=1)
            along = legs / now[:, None]
            by_motion = np.concatenate([along, np.cross(arm, along)], axis=1)
            pressed = np.linalg.solve(by_motion.T, [0.0, 0.0, weight, 0.0, 0.0, 0.0])
            step = np.linalg.solve(by_motion, length + self.give * pressed - now)
            x[:3] += step[:3]
            x[3:] = (Rotation.from_rotvec(step[3:]) * Rotation.from_rotvec(x[3:])).as_rotvec()
            if np.abs(step).max() < 1e-13:
                return x
        raise AssertionError("the platform does not come to rest")


def _poses(q: Array, point: Array, quaternion: Array, time: Array, payload: Array) -> Poses:
    n = len(q)
    _, place_of = np.unique(q, axis=0, return_inverse=True)
    _, repeat = np.unique(np.column_stack([q, payload]), axis=0, return_inverse=True)
    return Poses(
        source="made",
        start_ns=0,
        time=time,
        joint=q.copy(),
        command=q.copy(),
        point=point,
        quaternion=quaternion,
        count=np.full(n, 1),
        scatter=np.full((n, 3, 3), np.nan),
        direction=np.ones_like(q),
        travel=np.full_like(q, np.inf),
        payload=payload,
        payload_centre=np.zeros((n, 3)),
        temperature_parts=(),
        temperature=np.zeros((n, 0)),
        place=place_of.reshape(-1),
        repeat=repeat.reshape(-1),
        readings=n,
        duration=float(time[-1]),
        rejected=Rejected(),
        notes=(),
    )
