"""The robot of a cell, as its YAML file describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from delta_calibration.documents import content_hash, read_document
from delta_calibration.errors import ConfigError
from delta_calibration.mechanisms import MECHANISMS, Mechanism
from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Joints:
    """The actuated joints."""

    names: tuple[str, ...]  # (m,), the order of every joint vector of this robot
    lower: Array  # (m,) [rad]
    upper: Array  # (m,) [rad]
    repeatability: float  # [rad] standard deviation of where a joint comes to rest
    encoder: float  # [rad] standard deviation of a reading of the encoders
    speed: float  # [rad/s] fastest motion of a measurement plan
    gear_ratio: float


@dataclass(frozen=True)
class Masses:
    """What moves."""

    platform: float  # [kg]
    arm: float  # [kg]
    arm_centre: float  # of the arm's length, from the motor axis
    rod: float  # [kg], each


@dataclass(frozen=True)
class Tracker:
    """What measures: noise along the beam and, a + b d at distance d, across it."""

    measures: str  # "position" or "pose"
    radial: float  # [m]
    transverse: float  # a [m]
    transverse_per_metre: float  # b [m/m]
    reflector_offset: Array  # (3,) [m] in the platform's frame
    reflector_offset_prior: float  # [m]

    def sigmas(self, distance: Array) -> tuple[Array, Array]:
        """Standard deviations of one reading along and across the beam, each (n,) [m]."""
        along = np.full_like(distance, self.radial)
        return along, self.transverse + self.transverse_per_metre * distance


@dataclass(frozen=True)
class Limits:
    """What the compensation may do."""

    correction: float  # [rad] largest correction of a joint
    condition: float  # largest condition of the mechanism, see Mechanism.condition
    region_margin: float  # [m] how far outside the calibrated region


@dataclass(frozen=True)
class Robot:
    """A robot: its drawing, what its parts may deviate by, its joints, tracker and limits.

    `hash` is that of the file's content: a calibration says by it for which robot it was made.
    """

    name: str
    hash: str
    source: str
    mechanism: str
    dimensions: DeltaDimensions
    tolerances: DeltaTolerances
    joints: Joints
    masses: Masses
    tool_offset: Array  # (3,) [m] in the platform's frame
    tracker: Tracker
    limits: Limits

    def model(self, mechanism: str | None = None) -> Mechanism:
        """The mechanism with this robot's drawing and tolerances; by default the file's own.

        Raises:
            ConfigError: no mechanism of that name.
        """
        name = mechanism or self.mechanism
        if name not in MECHANISMS:
            raise ConfigError(f"no mechanism {name!r}; there are: {', '.join(MECHANISMS)}")
        return MECHANISMS[name](self.dimensions, self.tolerances)


def load_robot(path_or_name: str | Path) -> Robot:
    """Read a robot from a YAML file, or by name from the files that come with the package.

    Raises:
        ConfigError: not there, or an entry is missing, unknown or out of range.
    """
    path = _find(path_or_name)
    data = read_document(path, "robot")
    joints = data["joints"]
    limits = zip(joints["names"], joints["lower_deg"], joints["upper_deg"], strict=True)
    for name, low, high in limits:
        if low >= high:
            raise ConfigError(
                f"{path}: joints: {name} has lower_deg {low} not below upper_deg {high}"
            )
    return _build(data, str(path))


def known_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    folder = resources.files("delta_calibration").joinpath("config")
    files = folder.iterdir() if folder.is_dir() else ()
    return tuple(sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml")))


def _find(path_or_name: str | Path) -> Path:
    path = Path(path_or_name)
    if path.suffix in (".yaml", ".yml") or path.is_file():
        return path
    if str(path_or_name) in known_robots():
        folder = resources.files("delta_calibration").joinpath("config")
        return Path(str(folder.joinpath(f"{path_or_name}.yaml")))
    raise ConfigError(
        f"no robot {str(path_or_name)!r}: neither a YAML file nor one of: "
        f"{', '.join(known_robots())}"
    )


def _build(data: Mapping[str, Any], source: str) -> Robot:
    geometry, tolerances = _si(data["geometry"]), _si(data["tolerances"])
    joints, tracker = _si(data["joints"]), _si(data["tracker"])
    masses, limits = _si(data["masses"]), _si(data["limits"])
    return Robot(
        name=data["name"],
        hash=content_hash(data),
        source=source,
        mechanism=data["mechanism"],
        dimensions=DeltaDimensions(**geometry),
        tolerances=DeltaTolerances(
            joint_position=tolerances["joint_position"],
            arm=tolerances["arm"],
            rod=tolerances["rod"],
            mismatch=tolerances["rod_mismatch"],
            zero=tolerances["joint_zero"],
            hinge_tilt=tolerances["hinge_tilt"],
            half_width=tolerances["half_width"],
            line_tilt=tolerances["line_tilt"],
        ),
        joints=Joints(
            names=tuple(data["joints"]["names"]),
            lower=joints["lower"],
            upper=joints["upper"],
            repeatability=joints["repeatability"],
            encoder=joints["encoder"],
            speed=joints["speed"],
            gear_ratio=joints["gear_ratio"],
        ),
        masses=Masses(**masses),
        tool_offset=_si(data["tool"])["offset"],
        tracker=Tracker(**tracker),
        limits=Limits(**limits),
    )


_SI = {
    "_mm": 1e-3,
    "_um": 1e-6,
    "_um_per_m": 1e-6,
    "_deg": np.pi / 180,
    "_deg_per_s": np.pi / 180,
    "_mrad": 1e-3,
    "_urad": 1e-6,
    "_kg": 1.0,
}
_RENAMED = {"transverse_um_per_m": "transverse_per_metre"}


def _si(section: Mapping[str, Any]) -> dict[str, Any]:
    """A section of the file in SI: the unit at the end of each key is taken off and applied."""
    result: dict[str, Any] = {}
    for key, value in section.items():
        unit = next((u for u in sorted(_SI, key=len, reverse=True) if key.endswith(u)), "")
        name = _RENAMED.get(key, key.removesuffix(unit) if unit else key)
        factor = _SI.get(unit, 1.0)
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        vector = isinstance(value, list) and all(isinstance(v, int | float) for v in value)
        if numeric:
            result[name] = float(value) * factor
        elif vector:
            result[name] = np.array(value, dtype=float) * factor
        else:
            result[name] = cast(Any, value)
    return result
