"""Serial arms of rotary joints, computed by a product of screws.

With all joints at zero, joint i turns about a line through a point, both fixed in space. The
vectors from point to point and the directions of the lines are the geometry; an arm as built has
other vectors, and its lines are tilted. The Denavit-Hartenberg table of the robot file is used
only once, to find the lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind.kind import Index, Kind, More, Span, read

Array = NDArray[np.float64]

_HALVES = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)  # Gauss: mass, centre and inertia of a rod
_CLOSED, _MOST = 1e-12, 60


@dataclass(frozen=True)
class Build:
    """An arm with all joints at zero; one row per joint, and the tool behind the last."""

    link: Array  # (m + 1, 3) [m] from point to point of the lines, the last to the tool
    tilt: Array  # (m, 2) [rad] of each line, about two directions across it
    zero: Array  # (m,) [rad]


@dataclass(frozen=True)
class ArmStand:
    """Position and orientation of the tool, and a point on the line of each joint."""

    place: Array  # (n, 3) [m]
    turn: Array  # (n, 3, 3)
    points: Array  # (n, m, 3) [m]

    def point(self, local: Array) -> Array:
        return self.place + self.turn @ local

    def take(self, rows: Index) -> ArmStand:
        return ArmStand(self.place[rows], self.turn[rows], self.points[rows])


def _turned(axis: Array, angle: Array) -> Array:
    """Rotation matrices about one direction by n angles, by Rodrigues' formula, (n, 3, 3)."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * k + (1 - c) * (k @ k))


class Arm(Kind):
    """An arm of a robot file, with given masses, places and sizes."""

    def __init__(
        self,
        robot: str,
        kilograms: tuple[float, ...],
        span: Array,
        gears: tuple[float, float],
        rest: float,
        reflector: float,
        home: Array | None = None,
    ) -> None:
        file = read(robot)
        geometry, tolerance = file["geometry"], file["tolerances"]
        self.robot, self.gears, self.rest, self.offset = robot, gears, rest, reflector
        self.kilograms, self.span = np.array(kilograms), span
        self.joints = tuple(file["joints"]["names"])
        self.encoder = 1e-6 * file["joints"]["encoder_urad"]
        self.home = np.radians(geometry["home_deg"]) if home is None else home
        self.beside = np.full(len(self.joints), 0.05)
        self.sweep = np.diag(np.minimum(span, 0.6))
        self._lines(geometry)
        long, tool = 1e-3 * tolerance["length_mm"], 1e-3 * tolerance["tool_mm"]
        # Errors along the common normal and along the line; one across both would be a zero
        # offset.
        parallel = np.array([[row.get("parallel", False)] for row in geometry["links"]])
        links = long * (np.abs(self.across[:, 0]) + np.where(parallel, 0.0, np.abs(self.axes)))
        links[0] = 0.0  # the position of the first line is the base
        about = np.concatenate([np.ones_like(parallel), parallel], axis=1)
        self.expected = {
            "link": np.append(links, np.full((1, 3), tool), axis=0),
            "tilt": 1e-3 * tolerance["twist_mrad"] * about,
            "zero": 1e-3 * tolerance["zero_mrad"],
        }
        self.rise = {"link": (9.0, 14.0)}
        self.constant = {"link": (2000.0, 3000.0)}
        self.sensors = ("link",)

    def _lines(self, geometry: Any) -> None:
        """Find directions of the lines, points on them, and the tool's orientation, at zero."""
        self.lengths = [i for i, row in enumerate(geometry["links"]) if row["length_mm"]]
        frame, points, axes, normals = np.eye(4), [np.zeros(3)], [], []
        for row in geometry["links"]:
            before, after = np.eye(4), np.eye(4)
            before[:3, :3] = Rotation.from_euler("x", row["twist_deg"], degrees=True).as_matrix()
            before[0, 3] = 1e-3 * row["length_mm"]
            after[2, 3] = 1e-3 * row["offset_mm"]
            frame = frame @ before @ after
            points.append(frame[:3, 3])
            axes.append(frame[:3, 2])
            normals.append(frame[:3, 0])
        points.append((frame @ np.append(1e-3 * np.array(geometry["tool_mm"]), 1.0))[:3])
        mount = Rotation.from_euler("XYZ", geometry["mount_deg"], degrees=True)
        self.axes, self.mounted = np.array(axes), frame[:3, :3] @ mount.as_matrix()
        self.links = np.diff(np.array(points), axis=0)
        first = np.array(normals)  # common normals of each line and the previous one
        self.across = np.stack([first, np.cross(self.axes, first)], axis=1)  # (m, 2, 3)

    def drawing(self) -> Build:
        m = len(self.joints)
        return Build(self.links.copy(), np.zeros((m, 2)), np.zeros(m))

    def assemble(
        self, q: Array, build: Build, changed: More | None = None, near: Any = None
    ) -> ArmStand:
        n, turn, place, points = len(q), np.eye(3)[None], np.zeros((1, 3)), []
        more = np.asarray(0.0 if changed is None else changed.of("link"))
        link = np.broadcast_to(build.link + more, (n, *build.link.shape))
        for i, axis in enumerate(self.axes):
            place = place + (turn @ link[:, i, :, None])[..., 0]
            points.append(place)
            tilted = Rotation.from_rotvec(build.tilt[i] @ self.across[i]).as_matrix()
            turn = turn @ tilted @ _turned(axis, q[:, i] + build.zero[i])
        place = place + (turn @ link[:, -1, :, None])[..., 0]
        held = turn @ self.mounted
        turned = np.asarray(0.0 if changed is None else changed.of("tool"))
        if turned.any():
            held = Rotation.from_rotvec(turned).as_matrix() @ held
        return ArmStand(place, held, np.stack(points, axis=1))

    def masses(
        self, stand: ArmStand, build: Build, payload: Array, centre: Array
    ) -> tuple[Array, Array]:
        """Two mass points per link, a uniform rod between joint lines; and the payload."""
        n, ends = len(stand.place), np.append(stand.points, stand.place[:, None], axis=1)
        begin, along = ends[:, :-1, None], np.diff(ends, axis=1)[:, :, None]
        rods = (begin + _HALVES[:, None] * along).reshape(n, -1, 3)
        where = np.append(rods, stand.point(centre)[:, None], axis=1)
        mass = np.empty(where.shape[:2])
        mass[:, :-1], mass[:, -1] = np.repeat(self.kilograms / 2, 2), payload
        return mass, where

    def reflector(self, rng: np.random.Generator) -> Array:
        return self.offset * rng.uniform(-0.6, 0.6, 3)

    def places(self, rng: np.random.Generator, count: int) -> Array:
        return self.home + self.span * rng.uniform(-1.0, 1.0, (count, len(self.joints)))

    def at(self, points: Array) -> Array:
        """Joints near home that bring the nominal tool to the points, oriented as at home."""
        build = self.drawing()
        held = self.assemble(self.home[None], build).turn
        q = np.tile(self.home, (len(points), 1))
        for _ in range(_MOST):
            off, slope = self._off(q, build, points, held)
            step = np.clip((np.linalg.pinv(slope) @ off[..., None])[..., 0], -0.2, 0.2)
            q = q + step
            if np.abs(step).max() < _CLOSED:
                return q
        raise ArithmeticError(f"{self.robot} does not get there")

    def _off(self, q: Array, build: Build, points: Array, held: Array) -> tuple[Array, Array]:
        """Remaining error, and its derivative by the joints (each turns all behind its line)."""
        stand = self.assemble(q, build)
        axes, turn = [], np.eye(3)[None]
        for i, axis in enumerate(self.axes):
            axes.append(np.broadcast_to(turn @ axis, (len(q), 3)))
            turn = turn @ _turned(axis, q[:, i])
        along = np.stack(axes, axis=1)
        arms = np.cross(along, stand.place[:, None] - stand.points)
        off, slope = points - stand.place, np.swapaxes(arms, 1, 2)
        if len(self.joints) < 6:
            return off, slope
        left = Rotation.from_matrix(held @ np.swapaxes(stand.turn, 1, 2)).as_rotvec()
        return np.append(off, left, axis=1), np.append(slope, np.swapaxes(along, 1, 2), axis=1)

    def ring(self, angle: Array, radius: float, level: float) -> Array:
        """Circle about the tool position at home, a little inward, `level` above it."""
        middle = self.assemble(self.home[None], self.drawing()).place[0]
        flat = [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, level)]
        return middle + np.stack(flat, axis=1)


class _Scara(Arm):
    """Two vertical axes: the elbow is bent, the circle lies where both links reach."""

    circle: Span = (0.14, 0.0)
    others: tuple[Span, Span] = ((0.11, 0.0), (0.17, 0.0))


class _Ur10(Arm):
    """Six axes, with the link masses that the manufacturer states."""

    circle: Span = (0.14, 0.0)
    others: tuple[Span, Span] = ((0.11, 0.04), (0.11, -0.04))
    far: Span = (3.0, 3.6)


SCARA = _Scara(
    "scara",
    (8.0, 5.0),
    np.array([0.9, 0.9]),
    (100.0, 50.0),
    12e-6,
    1e-4,
    np.radians([15.0, 85.0]),  # the elbow bent, far from a straight arm
)
UR10 = _Ur10(
    "ur10",
    (7.1, 12.7, 4.27, 2.0, 2.0, 0.365),
    np.array([1.0, 0.5, 0.6, 1.0, 0.8, 1.5]),
    (101.0, 80.0),
    30e-6,
    0.05,
)
