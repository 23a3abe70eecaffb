"""Make the robot file of a serial arm from the URDF that its vendor publishes.

A URDF can place a joint frame anywhere; a robot file has modified Denavit-Hartenberg links
(Craig). Both describe the same axes: frame i has z along axis i and x along the common normal to
axis i + 1, and A_i leads from frame i - 1 to frame i,

    A_i = R_x(twist) T_x(length) R_z(q_i + zero) T_z(offset)

The result is compared with the forward kinematics of the URDF.

A robot file spreads the mass of a link evenly from its joint to the next, while a URDF places its
centre of mass anywhere. The torques of gravity are linear in the static moments of the links (mass
times distance), and the compliances that follow from them are wrong by as much as the moments are.
Therefore masses are only written if the centres of mass agree with an even spread: the moments
m_i e_i of their distances e_i from it may add up to 5 % of the links' own, the sum of m_i l_i over
masses times lengths. Where all axes up to a link are upright, e_i is the horizontal distance,
because a height exerts no torque there. Without masses `gravity_sag` fits the first moments.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from delta_calibration.effects.gravity_sag import GravitySag
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmDimensions, ArmTolerances
from delta_calibration.sections import part_of
from delta_calibration.texts import read_text

Array = NDArray[np.float64]

_PARALLEL = 0.02  # [rad] angle below which neighbouring axes count as parallel
_SAME = 1e-9  # [m, rad] tolerance of the geometry
_TRIALS, _WIDEST = 256, 2 * np.pi / 3  # candidates for home, and their largest joint angle
_REACH = 0.15  # half edge of the proposed workspace, as a share of the arm's length
_TURN = 360.0  # [deg] limits of a continuous joint
_SPEED = 120.0  # [deg/s] default if the URDF has no limit
_OFF = 0.05  # of the links' static moments: largest part that an even spread may miss
_UPRIGHT = 1e-6  # sine of the angle between an axis and the vertical below which it is upright
_NAMED = 3  # largest number of links that a note names
_XACRO = ("<xacro:", "${", "$(")  # marks of xacro, which no plain URDF contains


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF with its parent and child link."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Frame
    axis: Array  # (3,) of length 1
    lower: float  # [rad]
    upper: float  # [rad]
    speed: float  # [rad/s]


@dataclass(frozen=True)
class Mass:
    """Mass of a link, or of all that moves with it."""

    kg: float
    centre: Array  # (3,) [m] of mass, in the link

    def joined(self, other: Mass) -> Mass:
        """Both together, their centres in the same frame."""
        kg = self.kg + other.kg
        moment = self.kg * self.centre + other.kg * other.centre
        return Mass(kg, moment / kg if kg else self.centre)


@dataclass(frozen=True)
class Draft:
    """Content of a robot file, and what its reader should know about it."""

    document: dict[str, Any]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Chain:
    """Joints from base to tip, including fixed ones, and the masses of all links."""

    name: str
    joints: tuple[UrdfJoint, ...]
    masses: dict[str, Mass]  # by link
    every: tuple[UrdfJoint, ...]  # joints of the whole tree

    @property
    def turning(self) -> tuple[UrdfJoint, ...]:
        """The joints of the chain that turn, without fixed ones."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    def frames(self, q: Array) -> Iterator[Frame]:
        """Yield frames of the turning joints, then of the tip, in the base, at q (m,) [rad]."""
        at, values = Frame.identity(), iter(q)
        for joint in self.joints:
            at = at @ joint.origin
            if joint.kind != "fixed":
                yield at
                at = at @ Frame(rotations.exp(joint.axis * next(values)), np.zeros(3))
        yield at


def robot_from_urdf(
    path: Path, base: str | None = None, tip: str | None = None, name: str | None = None
) -> dict[str, Any]:
    """Make the content of a robot file for the serial arm in a URDF, see `draft_from_urdf`."""
    return draft_from_urdf(path, base, tip, name).document


def draft_from_urdf(
    path: Path, base: str | None = None, tip: str | None = None, name: str | None = None
) -> Draft:
    """Make the content of a robot file for the serial arm in a URDF, with notes on it.

    Args:
        path: URDF file; xacro is not allowed.
        base: link where the chain begins; by default the root.
        tip: link of the tool; by default the end of the only chain.
        name: name of the robot; by default that of the URDF in lower case.

    Raises:
        InputError: not a URDF, an unknown link, a joint that slides, several chains to choose
            from, or a first axis that modified DH cannot reach from the base.
    """
    chain = _chain(path, base, tip)
    links, tool, places = _denavit_hartenberg(chain, path)
    carried = _carried(chain)
    note = _uneven(chain, carried, places)
    if not note:
        links = [{**k, "mass_kg": mass.kg} for k, mass in zip(links, carried, strict=True)]
    document = _document(chain, links, tool, name)
    _require_same(chain, document, path)
    return Draft(_with_home(document), (note,) if note else ())


# --- reading


def _chain(path: Path, base: str | None, tip: str | None) -> Chain:
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path}: a document type or entities are not allowed in a URDF")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not XML: {error}") from error
    if root.tag != "robot":
        raise InputError(f"{path}: its root is <{root.tag}>, that of a URDF is <robot>")
    if any(mark in text for mark in _XACRO):
        raise InputError(f"{path}: is xacro; convert it first: xacro {path} > robot.urdf")
    joints = tuple(_joint(element, path) for element in root.findall("joint"))
    links = {str(e.get("name")): _mass(e, path) for e in root.findall("link")}
    _require_links(joints, links, path)
    children = {joint.child: joint for joint in joints}
    begin = _link(base, "base", links, path) or next((n for n in links if n not in children), "")
    end = _link(tip, "tip", links, path) or _end(joints, begin, path)
    way: list[UrdfJoint] = []
    at = end
    while at != begin:
        if at not in children or len(way) > len(joints):
            raise InputError(f"{path}: link {end!r} is not attached to {begin!r}")
        way.append(children[at])
        if way[-1].kind not in ("fixed", "revolute", "continuous"):
            raise InputError(
                f"{path}: joint {way[-1].name!r}: type {way[-1].kind!r}; an arm of turning joints "
                "is needed (--base and --tip choose a part of it)"
            )
        at = way[-1].parent
    return Chain(str(root.get("name") or path.stem), tuple(reversed(way)), links, joints)


def _require_links(joints: Iterable[UrdfJoint], links: Mapping[str, Mass], path: Path) -> None:
    """Refuse a joint whose parent or child link is not defined: a chain would end before it.

    Raises:
        InputError: there is such a joint.
    """
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(
                    f"{path}: joint {joint.name!r}: there is no link {end!r}; there are: "
                    f"{', '.join(links)}"
                )


def _link(name: str | None, option: str, links: dict[str, Mass], path: Path) -> str | None:
    if name is not None and name not in links:
        raise InputError(
            f"{path}: --{option} {name!r}: no such link; there are: {', '.join(links)}"
        )
    return name


def _end(joints: Sequence[UrdfJoint], begin: str, path: Path) -> str:
    """The link at the end of the only chain of joints that move."""
    ends: dict[str, tuple[UrdfJoint, ...]] = {}
    open_at: list[tuple[str, tuple[UrdfJoint, ...]]] = [(begin, ())]
    while open_at:
        link, way = open_at.pop()
        below = [joint for joint in joints if joint.parent == link]
        open_at += [(j.child, (*way, j)) for j in below]
        if not below:
            ends[link] = tuple(joint for joint in way if joint.kind != "fixed")
    last = sorted(end for end, way in ends.items() if not _goes_on(way, ends.values()))
    if not any(ends.values()):
        raise InputError(f"{path}: no revolute joint after link {begin!r}")
    if len(last) == 1:
        return last[0]
    shared = {id(joint) for joint in ends[last[0]]}.intersection(
        *({id(joint) for joint in ends[end]} for end in last)
    )
    if not shared:
        raise InputError(
            f"{path}: {len(last)} arms are attached to link {begin!r}; give --tip for one of "
            f"them: {', '.join(last)} (a machine with closed chains is no serial arm)"
        )
    raise InputError(
        f"{path}: several ends of the arm; give --tip: {', '.join(last)} (or a link before them)"
    )


def _goes_on(way: Sequence[UrdfJoint], ways: Iterable[Sequence[UrdfJoint]]) -> bool:
    """Whether the moving joints of one chain are the first joints of a longer chain."""
    return any(len(other) > len(way) and other[: len(way)] == way for other in ways)


def _joint(element: Element, path: Path) -> UrdfJoint:
    name, kind = str(element.get("name")), str(element.get("type"))
    where = f"joint {name!r}"
    axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where, path)
    length = float(np.linalg.norm(axis))
    if kind != "fixed" and not length > 0.0:
        raise InputError(f"{path}: {where}: axis has no length")
    limit = element.find("limit")
    bound = {
        key: float(_numbers(limit, key, (default,), where, path)[0])
        for key, default in (("lower", -np.inf), ("upper", np.inf), ("velocity", np.nan))
    }
    endless = kind == "continuous"
    return UrdfJoint(
        name,
        kind,
        _end_of(element, "parent", where, path),
        _end_of(element, "child", where, path),
        _origin(element, where, path),
        axis / (length or 1.0),
        np.radians(-_TURN) if endless else max(bound["lower"], np.radians(-_TURN)),
        np.radians(_TURN) if endless else min(bound["upper"], np.radians(_TURN)),
        bound["velocity"],
    )


def _end_of(element: Element, tag: str, where: str, path: Path) -> str:
    found = element.find(tag)
    if found is None or not found.get("link"):
        raise InputError(f"{path}: {where}: <{tag} link=...> is missing")
    return str(found.get("link"))


def _origin(element: Element, where: str, path: Path) -> Frame:
    origin = element.find("origin")
    place = _numbers(origin, "xyz", (0.0, 0.0, 0.0), where, path)
    turns = _numbers(origin, "rpy", (0.0, 0.0, 0.0), where, path)
    return Frame(Rotation.from_euler("xyz", turns).as_matrix(), place)


def _mass(link: Element, path: Path) -> Mass:
    inertial, where = link.find("inertial"), f"link {link.get('name')!r}"
    if inertial is None:
        return Mass(0.0, np.zeros(3))
    kg = _numbers(inertial.find("mass"), "value", (0.0,), where, path)
    centre = _numbers(inertial.find("origin"), "xyz", (0.0, 0.0, 0.0), where, path)
    return Mass(float(kg[0]), centre)


def _numbers(
    element: Element | None, key: str, default: Sequence[float], where: str, path: Path
) -> Array:
    text = None if element is None else element.get(key)
    if text is None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != len(default) or not np.isfinite(values).all():
        raise InputError(f"{path}: {where}: {key}={text!r}; {len(default)} numbers are needed")
    return values


# --- from axes to links


def _denavit_hartenberg(
    chain: Chain, path: Path
) -> tuple[list[dict[str, Any]], Frame, list[Array]]:
    """Links of the robot file from the chain's axes, the tool in the last link's frame, and ends.

    The ends are where each link begins, and the tool, in the base [m].
    """
    *joints, tip = chain.frames(np.zeros(len(chain.turning)))
    axes = [
        (frame.translation, frame.rotation @ joint.axis)
        for frame, joint in zip(joints, chain.turning, strict=True)
    ]
    _require_first(axes[0], chain, path)
    before = Frame.identity()  # origin and axes of the frame reached
    links, places = [], []
    for number, (point, direction) in enumerate(axes):
        x = before.rotation[:, 0]
        foot = _foot(before.translation, x, point, direction)
        places.append(foot)
        twist = _angle(before.rotation[:, 2], direction, x)
        origin, ahead = _next_frame(axes[number:], foot, x)
        links.append(
            {
                "twist_deg": _tidy(np.degrees(twist)),
                "length_mm": _tidy(float(1e3 * (foot - before.translation) @ x)),
                "offset_mm": _tidy(float(1e3 * (origin - foot) @ direction)),
                "zero_deg": _tidy(np.degrees(_angle(x, ahead, direction))),
                "parallel": bool(number > 0 and abs(np.sin(twist)) < _PARALLEL),
            }
        )
        before = Frame(np.stack([ahead, np.cross(direction, ahead), direction], axis=1), origin)
    return links, before.inverse() @ tip, [*places, tip.translation]


def _require_first(axis: tuple[Array, Array], chain: Chain, path: Path) -> None:
    """Refuse a first axis that R_x T_x cannot reach from the base, and name links that can.

    Raises:
        InputError: the first axis cannot be reached.
    """
    if _leads_to(*axis):
        return
    links = " or ".join(_bases(chain))
    hint = f"give --base {links}" if links else "add a suitable base link to the URDF"
    raise InputError(
        f"{path}: the first axis has to intersect the base's x axis at a right angle; {hint}"
    )


def _leads_to(point: Array, direction: Array) -> bool:
    """Whether an axis intersects the x axis at a right angle."""
    off = point[1] * direction[2] - point[2] * direction[1]
    return bool(abs(direction[0]) <= _SAME and abs(off) < _SAME)


def _bases(chain: Chain) -> Iterator[str]:
    """Yield the links before the first turning joint from which R_x T_x reaches its axis."""
    fixed = list(takewhile(lambda joint: joint.kind == "fixed", chain.joints))
    first = chain.turning[0]
    at = first.origin  # of the first axis, in the link before it
    for joint in reversed(fixed):
        if _leads_to(at.translation, at.rotation @ first.axis):
            yield joint.child
        at = joint.origin @ at


def _foot(start: Array, x: Array, point: Array, direction: Array) -> Array:
    """Intersection of the line from `start` along x with an axis perpendicular to it, (3,) [m]."""
    return np.asarray(
        point + direction * (direction @ (start + x * (x @ (point - start)) - point))
    )


def _next_frame(axes: Sequence[tuple[Array, Array]], foot: Array, x: Array) -> tuple[Array, Array]:
    """Origin on an axis and x of its frame: along the common normal to the next one."""
    direction = axes[0][1]
    if len(axes) == 1:  # the tool frame takes up the rest
        return foot, _across(x, direction)
    point, ahead = axes[1]
    normal = np.cross(direction, ahead)
    if np.linalg.norm(normal) < _SAME:
        away = (point - foot) - direction * (direction @ (point - foot))
        if np.linalg.norm(away) < _SAME:
            return foot, _across(x, direction)
        return foot, _along(away)
    # the feet of the common normal: direction t - ahead s + normal r = point - foot
    system = np.stack([direction, -ahead, normal], axis=1)
    t, _, r = np.linalg.solve(system, point - foot)
    way = _along(normal * (r if abs(r) > _SAME else 1.0))
    if abs(r) <= _SAME and way @ x < 0.0:
        way = -way
    return foot + direction * t, way


def _across(x: Array, direction: Array) -> Array:
    return _along(x - direction * (direction @ x))


def _along(way: Array) -> Array:
    return np.asarray(way / np.linalg.norm(way))


def _angle(start: Array, end: Array, about: Array) -> float:
    """Angle from one direction to another about an axis [rad]."""
    return float(np.arctan2(np.cross(start, end) @ about, start @ end))


def _tidy(value: float) -> float:
    """Round to 9 decimals, to remove rounding errors, and turn -0.0 into 0.0."""
    near = round(value, 9)
    return float(near + 0.0)


# --- the file


def _document(
    chain: Chain, links: list[dict[str, Any]], tool: Frame, name: str | None
) -> dict[str, Any]:
    joints = chain.turning
    mount = Rotation.from_matrix(tool.rotation).as_euler("ZYX", degrees=True)
    speed = min((np.degrees(j.speed) for j in joints if np.isfinite(j.speed)), default=_SPEED)
    called = name or "".join(c if c.isalnum() else "_" for c in chain.name.lower()).strip("_")
    return {
        "schema": 1,
        "name": called,
        "mechanism": SerialArm.name,
        "geometry": {
            "links": links,
            "tool_mm": [_tidy(1e3 * v) for v in tool.translation],
            "home_deg": [0.0] * len(joints),
            "mount_deg": [_tidy(v) for v in mount],
        },
        "tolerances": {
            "length_mm": 1.0,
            "twist_mrad": 1.0,
            "zero_mrad": 1.0,
            "tool_mm": 2.0,
            "mount_mrad": 5.0,
        },
        "joints": {
            "names": [joint.name for joint in joints],
            "lower_deg": [_tidy(np.degrees(joint.lower)) for joint in joints],
            "upper_deg": [_tidy(np.degrees(joint.upper)) for joint in joints],
            "repeatability_urad": 30.0,
            "encoder_urad": 5.0,
            "speed_deg_per_s": _tidy(speed),
            "gear_ratio": 100.0,
        },
        "tool": {"offset_mm": [0.0, 0.0, 0.0]},
        "tracker": {
            "measures": "position",
            "radial_um": 3.0,
            "transverse_um": 2.0,
            "transverse_um_per_m": 2.0,
            "reflector_offset_mm": [0.0, 0.0, 0.0],
            "reflector_offset_prior_mm": 50.0,
        },
        "limits": {"correction_deg": 2.0, "condition": 50.0, "region_margin_mm": 20.0},
    }


def _carried(chain: Chain) -> list[Mass]:
    """All links that each joint carries and the next one does not; centres in the base at zero."""
    turning = {joint.child: number for number, joint in enumerate(chain.turning)}
    held = {joint.child: joint for joint in chain.every}
    frames = list(chain.frames(np.zeros(len(turning))))
    found = [Mass(0.0, np.zeros(3)) for _ in turning]
    for link, mass in chain.masses.items():
        at, place = link, Frame.identity()
        for _ in held:  # at most: links can hold each other in a circle
            if at in turning or at not in held:
                break
            at, place = held[at].parent, held[at].origin @ place
        if at in turning:
            here = (frames[turning[at]] @ place).apply(mass.centre)
            found[turning[at]] = found[turning[at]].joined(Mass(mass.kg, here))
    return found


def _uneven(chain: Chain, carried: Sequence[Mass], places: Sequence[Array]) -> str:
    """Note that masses are left out, with the links that are not spread evenly; else empty."""
    kg = np.array([mass.kg for mass in carried])
    off = _off_middle(chain, carried, places)
    length = np.linalg.norm(np.diff(places, axis=0), axis=1)
    if kg @ off <= _OFF * (kg @ length):
        return ""
    worst = [k for k in np.argsort(-kg * off).tolist() if kg[k] * off[k] > 0]
    told = [f"{chain.turning[k].child} by {1e3 * off[k]:.0f} mm" for k in worst[:_NAMED]]
    more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
    instead = "a diagnosis then looks for no effect that needs masses"
    if _tilting(chain).any():
        instead += f", but fits the first moments of the links ({GravitySag.cause})"
    return (
        "the masses of the links are left out: a robot file spreads them evenly from joint to "
        f"joint, and centres of mass in the URDF differ from that ({', '.join(told)}{more}); "
        f"{instead}"
    )


def _off_middle(chain: Chain, carried: Sequence[Mass], places: Sequence[Array]) -> Array:
    """Distance of each centre of mass from that of an even spread, (m,) [m]; 0 without a mass.

    Only the horizontal distance of links that cannot tilt.
    """
    ends = np.array(places)
    off = np.array([mass.centre for mass in carried]) - (ends[:-1] + ends[1:]) / 2
    off[[mass.kg == 0 for mass in carried]] = 0.0
    off[~_tilting(chain), 2] = 0.0
    return np.asarray(np.linalg.norm(off, axis=1))


def _tilting(chain: Chain) -> NDArray[np.bool_]:
    """Whether each link can tilt: a joint before it, or its own, has no upright axis, (m,)."""
    frames = chain.frames(np.zeros(len(chain.turning)))
    axes = [f.rotation @ j.axis for f, j in zip(frames, chain.turning, strict=False)]
    return np.cumsum([np.hypot(*axis[:2]) > _UPRIGHT for axis in axes]) > 0


def _require_same(chain: Chain, document: dict[str, Any], path: Path) -> None:
    """Refuse links whose forward kinematics differs from the URDF's.

    Raises:
        InputError: the difference exceeds the tolerance.
    """
    arm = _arm(document)
    rng = np.random.default_rng(0)
    joints = rng.uniform(-np.pi, np.pi, (20, len(chain.turning)))
    x = arm.forward(joints, arm.parameters.nominal)
    for q, place, turn in zip(joints, arm.position(x), arm.rotation(x), strict=True):
        *_, tip = chain.frames(q)
        off = max(np.abs(tip.translation - place).max(), np.abs(tip.rotation - turn).max())
        if not off < 10 * _SAME:
            raise InputError(f"{path}: its axes cannot be put in modified DH (off by {off:.2g})")


def _with_home(document: dict[str, Any]) -> dict[str, Any]:
    """Add home, with the largest least singular value of the velocity Jacobian, and workspace."""
    from scipy.stats import qmc  # takes long to load, and `robot check` reads no URDF

    arm = _arm(document)
    low, high = (np.array(document["joints"][key]) for key in ("lower_deg", "upper_deg"))
    low = np.maximum(np.radians(low), -_WIDEST)
    high = np.minimum(np.radians(high), _WIDEST)
    drawn = qmc.Sobol(arm.joints, scramble=False).random(_TRIALS)
    joints = np.radians(np.round(np.degrees(low + drawn * (high - low))))
    g = arm.parameters.nominal
    x = arm.forward(joints, g)
    slope = arm.velocity_jacobian(joints, x, g)[:, : arm.task_size]
    best = int(np.argmax(np.linalg.svd(slope, compute_uv=False)[:, -1]))
    half = 1e3 * _REACH * float(sum(np.hypot(k.length, k.offset) for k in arm.dimensions.links))
    workspace = {
        "centre_mm": [round(1e3 * float(v), 1) for v in arm.position(x)[best]],
        "size_mm": [round(2 * half)] * 3 if arm.task_size > 2 else [round(2 * half)] * 2 + [0.0],
    }
    geometry = {
        **document["geometry"],
        "home_deg": [_tidy(v) for v in np.degrees(joints[best])],
    }
    return {**document, "geometry": geometry, "workspace": workspace}


def _arm(document: dict[str, Any]) -> SerialArm:
    """Serial arm of a robot file whose home is not chosen yet."""
    geometry = part_of("geometry", ArmDimensions, document["geometry"])
    return SerialArm(geometry, part_of("tolerances", ArmTolerances, document["tolerances"]))
