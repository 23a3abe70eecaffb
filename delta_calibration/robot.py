"""The robot of a cell, as its YAML file describes it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from delta_calibration.documents import (
    Document,
    Schema,
    check_document,
    content_hash,
    read_document,
)
from delta_calibration.errors import ConfigError
from delta_calibration.geometry import Camera
from delta_calibration.lazy import cached_property
from delta_calibration.mechanisms import MECHANISMS, Drives, Mechanism
from delta_calibration.mechanisms.consistency import FREEDOMS, faults_told, require_consistent
from delta_calibration.sections import (
    angle,
    choice,
    key_of,
    part_of,
    place,
    quantity,
    schema_of,
    senses,
)
from delta_calibration.sections import names as texts

Array = NDArray[np.float64]

SCHEMA = 1
_SINGULAR = 1e3  # condition number at home from which the mechanism counts as singular there
_MACHINE = ("schema", "name", "mechanism", "geometry", "tolerances", "masses", "tool")
_GEARS = "gear_ratio"
_SHORT = 40  # characters; a message quotes only entries that are no longer
_NAME = "^[a-z][a-z0-9_]*$"
_NAMED = "a lower-case letter, then lower-case letters, digits and _,"


_AT_REST = "standard deviation of a joint's rest position"
_READING = "standard deviation of an encoder reading"
_FASTEST = "largest joint speed in a measurement plan"
_PERIODS = "0 or left out: not known"
_ZERO = "reading of each joint at the zero of the mechanism (docs/robot_file.md); left out: 0"


@dataclass(frozen=True)
class Joints:
    """The actuated joints, rotary here; see `SlidingJoints` for prismatic ones.

    The reading of a joint is sign * own + zero, with own the joint coordinate of the mechanism
    (mechanisms/drives.py). All other entries, and all joint values that the package reads and
    writes, are readings.
    """

    unit: ClassVar[str] = "rad"
    shown: ClassVar[tuple[str, float]] = ("degrees", 180 / np.pi)  # unit in messages, per SI unit

    names: tuple[str, ...] = texts(about="names of the joints, in the order of the legs or axes")
    lower: Array = quantity(
        "deg",
        least=-1e6,
        most=1e6,
        shape=(None,),
        about="smallest reading of each joint that the machine allows",
    )
    upper: Array = quantity(
        "deg",
        least=-1e6,
        most=1e6,
        shape=(None,),
        about="largest reading of each joint that the machine allows",
    )
    repeatability: float = quantity("urad", least=0.0, most=1e4, about=_AT_REST)
    encoder: float = quantity("urad", least=0.0, most=1e4, about=_READING)
    speed: float = quantity("deg_per_s", above=0.0, most=1e4, about=_FASTEST)
    gear_ratio: float = quantity(above=0.0, about="motor turns per turn of the joint")
    passed_through: tuple[str, ...] = texts(
        default=(),
        about="names of further axes in the commands and states that the model ignores and "
        "passes on",
    )
    sign: Array | None = senses(
        about="-1 for a joint that counts opposite to the mechanism's direction; left out: 1"
    )
    zero: Array | None = quantity(
        "deg", least=-1e6, most=1e6, shape=(None,), default=None, about=_ZERO
    )
    encoder_lines: float = quantity(
        least=0.0,
        default=0.0,
        about=f"periods of the encoder's signals per turn of the joint; {_PERIODS}",
    )

    def beyond(self, joint: Array) -> str:
        """Name the first of the joints (m,) that is beyond its limits, in words; else empty."""
        out = np.flatnonzero((joint < self.lower) | (joint > self.upper))
        if not out.size:
            return ""
        unit, factor = self.shown
        value, low, high = factor * np.array([joint, self.lower, self.upper])[:, out[0]]
        return f"{value:.2f} {unit} for {self.names[out[0]]}; allowed: {low:.1f} to {high:.1f}"


@dataclass(frozen=True)
class SlidingJoints(Joints):
    """The actuated joints of a mechanism whose joints are prismatic."""

    unit: ClassVar[str] = "m"
    shown: ClassVar[tuple[str, float]] = ("mm", 1e3)

    lower: Array = place(
        shape=(None,), about="smallest reading of each joint that the machine allows"
    )
    upper: Array = place(
        shape=(None,), about="largest reading of each joint that the machine allows"
    )
    repeatability: float = quantity("um", least=0.0, most=1e4, about=_AT_REST)
    encoder: float = quantity("um", least=0.0, most=1e4, about=_READING)
    speed: float = quantity("mm_per_s", above=0.0, most=1e5, about=_FASTEST)
    gear_ratio: float = quantity(
        "turns_per_m", above=0.0, about="motor turns per metre of joint travel"
    )
    zero: Array | None = place(shape=(None,), default=None, about=_ZERO)
    encoder_lines: float = quantity(
        "turns_per_m",
        least=0.0,
        default=0.0,
        key="encoder_periods_per_m",
        about=f"periods of the encoder's signals per metre of joint travel; {_PERIODS}",
    )


@dataclass(frozen=True)
class Tool:
    """The tool on the platform."""

    offset: Array = quantity(
        "mm",
        least=-2000.0,
        most=2000.0,
        shape=(3,),
        about="tool centre point in the platform's frame",
    )


@dataclass(frozen=True)
class Tracker:
    """The tracker: noise along the beam and, a + b d at distance d, across it; its reflector."""

    measures: str = choice(
        "position", "pose", about="position (a reflector) or pose (a 6-DoF probe)"
    )
    radial: float = quantity(
        "um", above=0.0, most=1e4, about="standard deviation of a reading along the beam"
    )
    transverse: float = quantity(
        "um",
        above=0.0,
        most=1e4,
        about="standard deviation across the beam is a + b d at distance d: a",
    )
    transverse_per_metre: float = quantity(
        "um_per_m",
        least=0.0,
        most=1e4,
        key="transverse_um_per_m",
        about="standard deviation across the beam is a + b d at distance d: b",
    )
    reflector_offset: Array = quantity(
        "mm",
        least=-2000.0,
        most=2000.0,
        shape=(3,),
        about="position of the reflector in the platform's frame",
    )
    reflector_offset_prior: float = quantity(
        "mm",
        above=0.0,
        most=1000.0,
        about="standard deviation of that position, before it is fitted",
    )
    turn: float | None = quantity(
        "urad",
        above=0.0,
        most=1e5,
        default=None,
        about="standard deviation of a pose's rotation about each axis; left out: rotations are "
        "not used",
    )

    def sigmas(self, distance: Array) -> tuple[Array, Array]:
        """Standard deviations of one reading along and across the beam, each (n,) [m]."""
        along = np.full_like(distance, self.radial)
        return along, self.transverse + self.transverse_per_metre * distance


@dataclass(frozen=True)
class Sight:
    """A camera that looks down on the workspace: pinhole model, noise and position."""

    focal: Array = quantity("px", above=0.0, shape=(2,), about="focal lengths of the camera")
    centre: Array = quantity("px", least=0.0, shape=(2,), about="image point on the optical axis")
    noise: float = quantity(
        "px", above=0.0, most=100.0, about="standard deviation of the mark's position in one image"
    )
    place: Array = place(shape=(3,), about="approximate position of the camera in the base frame")

    @property
    def camera(self) -> Camera:
        """The pinhole model of the camera."""
        return Camera(self.focal, self.centre)


_LARGEST = "largest correction of a joint that is ever sent"


@dataclass(frozen=True)
class Limits:
    """Limits of the compensation."""

    # the bound is large because the drum of a cable turns much farther than a joint of an arm
    correction: float = quantity("deg", above=0.0, most=7200.0, about=_LARGEST)
    # see Mechanism.condition
    condition: float = quantity(
        above=1.0, about="largest condition number at which commands are corrected"
    )
    region_margin: float = quantity(
        "mm",
        least=0.0,
        about="width of the margin around the calibrated region in which corrections fade out",
    )


@dataclass(frozen=True)
class Workspace:
    """The workspace: a box of tool points, and the largest rotation of the platform in it."""

    centre: Array = place(
        shape=(3,),
        about="centre of the box of tool points to measure in, in the base frame; without this "
        "section a Delta with arms is measured in the region of `srbd`",
    )
    size: Array = quantity("mm", least=0.0, most=1e4, shape=(3,), about="edge lengths of that box")
    turn: float = angle(
        default=0.0, about="largest rotation of the platform about each axis it can turn about"
    )


@dataclass(frozen=True)
class SlidingLimits(Limits):
    """Limits of the compensation of a mechanism whose joints are prismatic."""

    correction: float = quantity("mm", above=0.0, most=100.0, about=_LARGEST)


_JOINTS: Mapping[str, type[Joints]] = {"rad": Joints, "m": SlidingJoints}
_LIMITS: Mapping[str, type[Limits]] = {"rad": Limits, "m": SlidingLimits}


@dataclass(frozen=True)
class Robot:
    """A robot: nominal dimensions, tolerances, joints, tracker and limits.

    `dimensions`, `tolerances` and `masses` are classes of the mechanism. `hash` is that of the
    file's content, `machine_hash` that of the entries on which a calibration depends: a
    calibration stores it to identify its robot, and stays valid when noise, speeds, limits or the
    workspace are changed.
    """

    name: str
    hash: str
    machine_hash: str
    source: str
    mechanism: str
    dimensions: Any
    tolerances: Any
    masses: Any  # None if the mechanism needs none
    joints: Joints
    tool_offset: Array  # (3,) [m] in the platform's frame
    tracker: Tracker
    limits: Limits
    workspace: Workspace | None = None  # None: that of the Delta paper
    camera: Sight | None = None  # None: there is none

    def model(self, mechanism: str | None = None) -> Mechanism:
        """Build a mechanism, by default the file's own, with the robot's dimensions, tolerances.

        Raises:
            ConfigError: no mechanism of that name, or one that has other dimensions.
        """
        name = mechanism or self.mechanism
        if name not in MECHANISMS:
            raise ConfigError(f"no mechanism {name!r}; there are: {', '.join(MECHANISMS)}")
        kind = MECHANISMS[name]
        if not isinstance(self.dimensions, kind.Dimensions):
            fit = (n for n, k in MECHANISMS.items() if isinstance(self.dimensions, k.Dimensions))
            raise ConfigError(f"robot {self.name} is no {name}; possible models: {', '.join(fit)}")
        model = kind(self.dimensions, self.tolerances)
        joints = self.joints
        return model if joints.sign is None and joints.zero is None else model.driven(self.drives)

    @property
    def drives(self) -> Drives:
        """Signs and zeros of its joint readings."""
        joints, alike = self.joints, Drives.alike(len(self.joints.names))
        return Drives(
            alike.sense if joints.sign is None else joints.sign,
            alike.zero if joints.zero is None else joints.zero,
        )

    def place(self, joint: str) -> str:
        """Location of a joint as parameters and verdicts name it (`joint_2`), from its name here.

        Other texts are returned unchanged.
        """
        names = self.joints.names
        limb = MECHANISMS[self.mechanism].limb
        return f"{limb}_{names.index(joint) + 1}" if joint in names else joint

    def named(self, text: str) -> str:
        """The text with `joint_2` or `joint 2` replaced by the robot's own name of that joint."""
        names, limb = self.joints.names, MECHANISMS[self.mechanism].limb

        def name(found: re.Match[str]) -> str:
            number = int(found[1])
            return names[number - 1] if 0 < number <= len(names) else found[0]

        return re.sub(rf"\b{limb}[_ ](\d+)\b", name, text)

    @cached_property
    def commanded(self) -> Mechanism:
        """The model with which its controller computes joints from poses."""
        return self.model(MECHANISMS[self.mechanism].commanded or None)

    @cached_property
    def detailed(self) -> Mechanism:
        """The most detailed model of the mechanism."""
        return self.model(MECHANISMS[self.mechanism].detailed or None)


def load_robot(path_or_name: str | Path) -> Robot:
    """Read a robot from a YAML file, or by name from the files that come with the package.

    Raises:
        ConfigError: no such file, or an entry is missing, unknown or out of range.
    """
    path = _find(path_or_name)
    return _robot(read_document(path, _schema), str(path))


def robot_from(data: Document, source: str) -> Robot:
    """Build the robot from a document that was already read, and perhaps edited.

    Raises:
        ConfigError: an entry is missing, unknown or out of range; names `source`.
    """
    check_document(data, _schema(data), source)
    return _robot(data, source)


def robot_document(path_or_name: str | Path) -> tuple[Path, dict[str, Any]]:
    """Path and content of a robot file, which need not be valid.

    Raises:
        ConfigError: no such file, or no mapping of keys to values.
    """
    path = _find(path_or_name)
    return path, read_document(path, lambda _: {})


def _robot(data: Document, path: str) -> Robot:
    kind = MECHANISMS[data["mechanism"]]

    def section(name: str, of: type[Any] | None) -> Any:
        return None if of is None or name not in data else part_of(name, of, data[name])

    try:
        robot = Robot(
            name=data["name"],
            hash=content_hash(data),
            machine_hash=content_hash(_machine(data)),
            source=path,
            mechanism=kind.name,
            dimensions=section("geometry", kind.Dimensions),
            tolerances=section("tolerances", kind.Tolerances),
            masses=section("masses", kind.Masses),
            joints=section("joints", _JOINTS[kind.joint_unit]),
            tool_offset=section("tool", Tool).offset,
            tracker=section("tracker", Tracker),
            limits=section("limits", _LIMITS[kind.joint_unit]),
            workspace=section("workspace", Workspace),
            camera=section("camera", Sight),
        )
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    with faults_told(kind, path):
        _require_joints(robot, data["joints"])
        _require_consistent(robot)
        _require_home(robot, data)
    return robot


def _machine(data: Document) -> Document:
    """Entries on which a calibration depends: dimensions, tolerances, tool, masses, gears, drives.

    Signs of 1 and zeros of 0 are left out, because a file without them means the same.
    """
    joints = data["joints"]
    geared = {key: joints[key] for key in joints if key == "names" or key.startswith(_GEARS)}
    if any(sign != 1 for sign in joints.get("sign", ())):
        geared["sign"] = joints["sign"]
    for key in ("zero_deg", "zero_mm"):
        if any(joints.get(key, ())):
            geared[key] = joints[key]
    return {**{key: data[key] for key in _MACHINE if key in data}, "joints": geared}


def known_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    folder = resources.files("delta_calibration").joinpath("config")
    files = folder.iterdir() if folder.is_dir() else ()
    return tuple(sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml")))


def _find(path_or_name: str | Path) -> Path:
    path = Path(path_or_name)
    with suppress(OSError):  # a text too long for the name of a file
        if path.suffix in (".yaml", ".yml") or path.is_file():
            return path
    if str(path_or_name) in known_robots():
        folder = resources.files("delta_calibration").joinpath("config")
        return Path(str(folder.joinpath(f"{path_or_name}.yaml")))
    raise ConfigError(
        f"no robot {str(path_or_name)!r}: neither a YAML file nor one of: "
        f"{', '.join(known_robots())}"
    )


def _schema(data: Document) -> Schema:
    return robot_schema(str(data.get("mechanism")))


def robot_schema(mechanism: str) -> Schema:
    """Schema of a robot file of a mechanism; of an unknown one, the schema common to all."""
    kind = MECHANISMS.get(mechanism)
    needed = kind is None or kind.masses_needed
    parts: dict[str, Any] = {
        "schema": {"const": SCHEMA},
        "name": {"type": "string", "pattern": _NAME, "description": _NAMED},
        "mechanism": {"enum": list(MECHANISMS)},
    }
    sections: dict[str, type[Any] | None] = {"tool": Tool, "tracker": Tracker}
    if kind is not None:
        sections = {
            "geometry": kind.Dimensions,
            "tolerances": kind.Tolerances,
            "joints": _JOINTS[kind.joint_unit],
            "masses": kind.Masses,
            **sections,
            "limits": _LIMITS[kind.joint_unit],
        }
    parts |= {name: schema_of(part) for name, part in sections.items() if part is not None}
    return {
        "type": "object",
        "additionalProperties": kind is None,
        "required": [name for name in parts if needed or name != "masses"],
        "properties": {**parts, "workspace": schema_of(Workspace), "camera": schema_of(Sight)},
    }


def _require_joints(robot: Robot, section: Mapping[str, Any]) -> None:
    """Refuse joint entries of the wrong length, and lower limits that are not below the upper."""
    expected = robot.model().joints
    keys = {item.name: key_of(item) for item in fields(robot.joints)}
    for name in ("names", "lower", "upper", "sign", "zero"):
        values = getattr(robot.joints, name)
        found = expected if values is None else len(values)
        if found != expected:
            raise ConfigError(
                f"{robot.source}: joints.{keys[name]}: {found} values found, {expected} are "
                f"expected"
            )
    both = [name for name in robot.joints.passed_through if name in robot.joints.names]
    if both:
        raise ConfigError(
            f"{robot.source}: joints.passed_through: {both[0]} is not allowed; it is one of "
            "joints.names, which the model moves"
        )
    lower, upper = section[keys["lower"]], section[keys["upper"]]
    for name, low, high in zip(robot.joints.names, lower, upper, strict=True):
        if low >= high:
            raise ConfigError(
                f"{robot.source}: joints: {name} has {keys['lower']} {low} not below "
                f"{keys['upper']} {high}"
            )


def _require_consistent(robot: Robot) -> None:
    try:
        require_consistent(robot.model(), robot.masses)
    except ConfigError as error:
        raise ConfigError(f"{robot.source}: {error}") from error


def _require_home(robot: Robot, data: Document) -> None:
    """Refuse a robot whose home pose is beyond joint limits, singular or out of reach."""
    model, joints = robot.commanded, robot.joints
    home, (unit, factor) = model.home, joints.shown
    keys = {item.name: key_of(item) for item in fields(joints)}
    for name, q, low, high in zip(joints.names, home, joints.lower, joints.upper, strict=True):
        if not low <= q <= high:
            side, limit = ("lower", low) if q < low else ("upper", high)
            raise ConfigError(
                f"{robot.source}: joints: {name} is at {factor * q:.6g} {unit} at home "
                f"({model.home_is}), beyond {keys[side]} {factor * limit:.6g}"
            )
    x = model.forward(home[None], model.parameters.nominal)
    condition = float(model.condition(home[None], x, model.parameters.nominal)[0])
    if not condition < _SINGULAR:
        where = ", ".join(f"{factor * q:.6g}" for q in home)
        how = "is singular" if np.isfinite(x).all() else "cannot be assembled"
        raise ConfigError(
            f"{robot.source}: geometry: {_written(data['geometry'])}: a {robot.mechanism} of "
            f"these dimensions {how} at home ({model.home_is}), joints at {where} {unit}"
            f"{_held(model, x)}"
        )


def _held(model: Mechanism, x: Array) -> str:
    """Commanded coordinates that no joint changes at home, in words; empty if there are none."""
    slope = model.velocity_jacobian(model.home[None], x, model.parameters.nominal)[0]
    moved = np.abs(slope[: model.task_size]).max(axis=1)
    if not (np.isfinite(moved).all() and moved.max() > 0):
        return ""
    still = np.flatnonzero(moved < moved.max() / _SINGULAR)
    named = " and ".join(FREEDOMS[model.freedoms[k]] for k in still.tolist())
    return f", where no joint changes {named}, which it is commanded by" if named else ""


def _written(section: Mapping[str, Any]) -> str:
    """Entries of a section as its file has them; long ones are left out."""
    return ", ".join(f"{k} {v}" for k, v in section.items() if len(str(v)) <= _SHORT)
