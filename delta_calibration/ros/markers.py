"""The cell's scene as markers: latched, redrawn on change, beside the command path."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from delta_calibration.cell.background import Background
from delta_calibration.cell.desk import Desk
from delta_calibration.cell.guard_trail import GuardTrail
from delta_calibration.cell.scene import Drawing, Kind, scene
from delta_calibration.ros.qos import STATUS

PERIOD_S = 1.0
FRAME = "base_link"
TYPES = {
    Kind.DOTS: Marker.SPHERE_LIST,
    Kind.LINES: Marker.LINE_LIST,
    Kind.TRIANGLES: Marker.TRIANGLE_LIST,
}


class Markers:
    """Publishes what a desk's cell looks like on `~/markers`.

    The scene is made on another thread when the calibration changes; the places where guards acted
    are added once a second. What goes wrong here is logged: nobody's commands wait for a picture.

    Args:
        node: that has the desk.
        desk: the desk now; None where there is none.
        scale: by which errors are drawn longer, now.
    """

    def __init__(
        self, node: Node, desk: Callable[[], Desk | None], scale: Callable[[], float]
    ) -> None:
        self._node, self._desk, self._scale = node, desk, scale
        self.trail = GuardTrail()
        self._drawn: tuple[Any, ...] = ()  # what the scene is of
        self._scene: tuple[Drawing, ...] = ()
        self._work: Background[tuple[Drawing, ...]] | None = None
        self._publisher = node.create_publisher(MarkerArray, "~/markers", STATUS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self._tick, clock=clock)

    def _tick(self) -> None:
        try:
            self._look()
        except Exception:
            self._node.get_logger().error(f"markers: {traceback.format_exc()}")

    def _look(self) -> None:
        desk = self._desk()
        if desk is None:
            return
        if self._work is not None:
            if self._work.done:
                work, self._work = self._work, None
                self._scene = work.result()
                self._publish()
            return
        wanted = (desk.robot, desk.calibration, desk.fitted, self._scale())
        if not _same(wanted, self._drawn):
            self._drawn = wanted
            self.trail.clear()
            self._work = Background(partial(scene, *wanted))
        elif self.trail.placed(desk.robot):
            self._publish()

    def _publish(self) -> None:
        self._publisher.publish(marker_array((*self._scene, *self.trail.drawings())))


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether two scenes are of the very same things, drawn at the same scale."""
    return [*map(id, one[:-1]), one[-1:]] == [*map(id, other[:-1]), other[-1:]]


def marker_array(drawings: Sequence[Drawing]) -> MarkerArray:
    """The whole picture: all markers from before go."""
    clear = Marker(action=Marker.DELETEALL)
    clear.header.frame_id = FRAME
    return MarkerArray(markers=[clear, *map(marker, drawings)])


def marker(drawing: Drawing) -> Marker:
    """One drawing, under its own namespace, so that each can be switched off by itself."""
    message = Marker(ns=drawing.name, type=TYPES[drawing.kind], action=Marker.ADD)
    message.header.frame_id = FRAME
    message.pose.orientation.w = 1.0
    size = drawing.size
    message.scale.x, message.scale.y, message.scale.z = (
        (size, 0.0, 0.0) if drawing.kind is Kind.LINES else (size, size, size)
    )
    red, green, blue = drawing.colour
    message.color = ColorRGBA(r=red, g=green, b=blue, a=drawing.opacity)
    message.points = points_of(drawing.points)
    return message


def points_of(points: NDArray[Any]) -> list[Point]:
    """Of rows (n, 3) [m]."""
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
