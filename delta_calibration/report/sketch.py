"""Drawing of a robot file in three views: frames, zero and positive sense of every joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.description import describe
from delta_calibration.description.skeleton import Skeleton
from delta_calibration.description.tree import BASE, PRISMATIC, TOOL, Joint, toward
from delta_calibration.errors import InputError
from delta_calibration.geometry import rotations
from delta_calibration.report.missing import required
from delta_calibration.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

Flat = tuple[int, int]  # axis to the right, axis up

VIEWS: tuple[tuple[str, Flat], ...] = (("front", (0, 2)), ("side", (1, 2)), ("top", (0, 1)))
_AXES = ("x", "y", "z")
_COLOURS = ("#d55e00", "#007a5a", "#0072b2")  # of x, y, z
_GHOST, _BEFORE = "#9aa0a6", "#d55e00"
_SENSE = 0.35  # [rad] rotation drawn to show the sense of a joint
_SEEN = 0.6  # smallest projected length in a suitable view, over the longest projection
_LONG_SENSE = 4.7  # [rad] rotation drawn if the link lies along the axis
_SHARE = 0.16  # length of a slide's arrow and of a frame's axes, over the machine's size
_ENDINGS = (".svg", ".png", ".pdf")
_WIDE, _TALL = 15.0, 6.2  # [inch]


@dataclass(frozen=True)
class Pose:
    """Machine at given joints, prepared for drawing: shapes of the links, and frames."""

    skeleton: Skeleton
    frames: Mapping[str, tuple[Array, Array]]

    @classmethod
    def home(cls, robot: Robot) -> Pose:
        """Nominal robot at its home pose, in the middle of its workspace."""
        skeleton = describe(robot)
        values = skeleton.values(skeleton.mechanism.home[None])
        return cls(skeleton, skeleton.tree.frames(values))

    def lines(
        self, link: str, turn: Array | None = None, about: Array | None = None
    ) -> list[Array]:
        """Centre lines of a link's shapes in the base, (2, 3) [m] each, rotated about a point."""
        rotation, place = self.frames[link]
        shapes = next(item.shapes for item in self.skeleton.tree.links if item.name == link)
        ends = [place[0] + np.stack([s.start, s.end]) @ rotation[0].T for s in shapes]
        if turn is None or about is None:
            return ends
        return [about + (line - about) @ turn.T for line in ends]

    @property
    def size(self) -> float:
        """Largest extent of the machine along an axis [m]."""
        places = np.concatenate([place for _, place in self.frames.values()])
        return float(np.ptp(places, axis=0).max()) or 1.0


def write_sketch(robot: Robot, path: Path, before: Robot | None = None, changed: str = "") -> None:
    """Draw a robot to an SVG, PNG or PDF file; the file ending selects the format.

    Args:
        robot: robot to draw.
        path: path of the file.
        before: another version of the robot, drawn behind it.
        changed: description of the difference between the two, used as title.

    Raises:
        InputError: no shapes for its mechanism, matplotlib is not installed, the file cannot be
            written.
    """
    pyplot = required("matplotlib.pyplot", "a drawing of the robot")
    pose = Pose.home(robot)
    behind = None if before is None else Pose.home(before)
    style = {"font.size": 9, "svg.fonttype": "none", "text.parse_math": False}
    with pyplot.rc_context(style):
        figure, panels = pyplot.subplots(1, 3, figsize=(_WIDE, _TALL), layout="constrained")
        for axes, view in zip(panels, VIEWS, strict=True):
            if behind is not None:
                _machine(axes, behind, view[1], _BEFORE)
            _panel(axes, robot, pose, view, plain=behind is not None)
        figure.suptitle(changed or _title(robot))
        try:
            figure.savefig(path, dpi=110, metadata=_metadata(path))
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be written: {error}") from error
        finally:
            pyplot.close(figure)


def _metadata(path: Path) -> dict[str, Any]:
    """Metadata without a date, so that the same robot gives the same file.

    Raises:
        InputError: the file ending is not SVG, PNG or PDF.
    """
    if path.suffix.lower() not in _ENDINGS:
        raise InputError(f"{path}: the ending selects the format: {', '.join(_ENDINGS)}")
    return {"Date": None} if path.suffix.lower() == ".svg" else {}


def _title(robot: Robot) -> str:
    limits = robot.joints.shown
    low, high = limits[1] * robot.joints.lower, limits[1] * robot.joints.upper
    home = limits[1] * robot.detailed.home
    said = (
        f"{name} {at:.4g} ({least:.6g} to {most:.6g}) {limits[0]}{read}"
        for name, at, least, most, read in zip(
            robot.joints.names, home, low, high, _read(robot), strict=True
        )
    )
    rows = [", ".join(row) for row in _rows(list(said), 4)]
    if robot.joints.passed_through:
        rows.append(f"passed through: {', '.join(robot.joints.passed_through)}")
    return "\n".join([f"{robot.name} ({robot.mechanism}) in the middle of its workspace", *rows])


def _read(robot: Robot) -> list[str]:
    """Sign and zero of each joint as text, if the robot file states them."""
    joints, drives = robot.joints, robot.drives
    if joints.sign is None and joints.zero is None:
        return [""] * len(joints.names)
    zeros = joints.shown[1] * drives.zero
    return [f" [sign {s:+.0f}, zero {z:.6g}]" for s, z in zip(drives.sense, zeros, strict=True)]


def _rows(items: list[str], size: int) -> list[list[str]]:
    return [items[k : k + size] for k in range(0, len(items), size)]


def _panel(axes: Axes, robot: Robot, pose: Pose, view: tuple[str, Flat], *, plain: bool) -> None:
    seen_from, both = view
    right, up = both
    _machine(axes, pose, both, _COLOURS[2] if plain else "")
    _frame(axes, pose, BASE, both, "base", (4, -11))
    _frame(axes, pose, TOOL, both, "tool", (-26, 5))  # left of it: the last joint's name is right
    if not plain:
        joints = _driven(robot, pose)
        ways = [_motion(pose, joint) for joint in joints]
        for joint, way in zip(joints, ways, strict=True):
            _sense(axes, pose, joint, way, both)
            if _best_view(way, ways) == both:
                name = f"+{joint.name}"
                end = 1e3 * way[-1][list(both)]
                axes.annotate(name, end, xytext=(6, 6), textcoords="offset points")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{seen_from}: {_AXES[right]} to the right, {_AXES[up]} up")
    axes.set_xlabel(f"{_AXES[right]} [mm]")
    axes.set_ylabel(f"{_AXES[up]} [mm]")
    axes.grid(visible=True, color="#ececec")
    axes.set_axisbelow(True)


def _driven(robot: Robot, pose: Pose) -> list[Joint]:
    """Actuated joints that are in the tree; the drum of a cable is not."""
    joints = {joint.name: joint for joint in pose.skeleton.tree.joints}
    return [joints[name] for name in robot.joints.names if name in joints]


def _machine(axes: Axes, pose: Pose, both: Flat, colour: str) -> None:
    for link in pose.skeleton.tree.links:
        if link.name not in pose.frames:
            continue
        for shape, line in zip(link.shapes, pose.lines(link.name), strict=True):
            flat = 1e3 * _outline(line, shape.radius)[:, both]
            rgb = colour or tuple(shape.colour)
            axes.plot(*flat.T, color=rgb, linewidth=3.0 if not colour else 1.6, alpha=0.75)


def _outline(line: Array, radius: float) -> Array:
    """Centre line of a bar, or rim of a plate, (n, 3) [m]."""
    way = line[1] - line[0]
    if radius <= np.linalg.norm(way):
        return line
    along = toward(way / np.linalg.norm(way))
    angles = np.linspace(0.0, 2 * np.pi, 49)
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return np.asarray(line.mean(axis=0) + radius * rim @ along.T)


def _frame(
    axes: Axes, pose: Pose, link: str, both: Flat, name: str, beside: tuple[int, int]
) -> None:
    rotation, place = (part[0] for part in pose.frames[link])
    start = 1e3 * place[list(both)]
    for axis, colour in enumerate(_COLOURS):
        way = 1e3 * _SHARE * pose.size * rotation[list(both), axis]
        if np.linalg.norm(way) < 1e-3 * 1e3 * _SHARE * pose.size:
            continue  # it points at the reader
        _arrow(axes, start, start + way, colour)
        axes.annotate(_AXES[axis], start + 1.12 * way, color=colour, ha="center", va="center")
    axes.annotate(name, start, xytext=beside, textcoords="offset points", color="#1a1a1a")


def _sense(axes: Axes, pose: Pose, joint: Joint, way: Array, both: Flat) -> None:
    """Draw a joint's zero position (dashed) and its positive sense (arrow)."""
    axis, place = _axis(pose, joint)
    value = float(pose.skeleton.mechanism.home[pose.skeleton.actuated.index(joint.name)])
    if joint.kind != PRISMATIC:
        for line in pose.lines(joint.child, rotations.exp(-value * axis), place):
            axes.plot(*1e3 * line[:, both].T, color=_GHOST, linestyle=(0, (4, 3)), linewidth=1.2)
    flat = 1e3 * way[:, both]
    axes.plot(*flat.T, color="#1a1a1a", linewidth=1.2)
    _arrow(axes, flat[-2], flat[-1], "#1a1a1a")


def _axis(pose: Pose, joint: Joint) -> tuple[Array, Array]:
    """Direction of a joint's axis, and a point on it [m], in the base."""
    rotation, place = (part[0] for part in pose.frames[joint.child])
    return rotation @ joint.axis, place


def _motion(pose: Pose, joint: Joint) -> Array:
    """Path of a point of a joint's link when the joint moves in its positive sense, (n, 3) [m]."""
    axis, place = _axis(pose, joint)
    ends = np.concatenate([*pose.lines(joint.child), place[None]])
    tip = ends[np.argmax(np.linalg.norm(ends - place, axis=1))]
    if joint.kind == PRISMATIC:
        return np.stack([tip, tip + _SHARE * pose.size * axis])
    arm = (tip - place) - axis * (axis @ (tip - place))
    span = _SENSE
    if np.linalg.norm(arm) < _SHARE / 2 * pose.size:  # the link lies along the axis, or is short
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        tip = tip - arm + _SHARE / 2 * pose.size * across / np.linalg.norm(across)
        span = _LONG_SENSE
    angles = np.linspace(0.0, span, 40)[:, None]
    return np.asarray(place + (rotations.exp(angles * axis) @ (tip - place)[:, None])[..., 0])


def _best_view(way: Array, ways: list[Array]) -> Flat:
    """Select, of the views that show a path, the one with its end farthest from other ends."""
    steps = np.diff(way, axis=0)
    seen = {both: float(np.linalg.norm(steps[:, both], axis=1).sum()) for _, both in VIEWS}
    return max(
        (both for both in seen if seen[both] > _SEEN * max(seen.values())),
        key=lambda both: _apart(way[-1][list(both)], [w[-1][list(both)] for w in ways]),
    )


def _apart(end: Array, ends: list[Array]) -> float:
    """Distance of an end from the nearest other [m]."""
    return float(np.sort(np.linalg.norm(np.array(ends) - end, axis=1))[1:2].sum())


def _arrow(axes: Axes, start: Array, end: Array, colour: str) -> None:
    axes.annotate(
        "",
        (end[0], end[1]),
        xytext=(start[0], start[1]),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.4},
    )
