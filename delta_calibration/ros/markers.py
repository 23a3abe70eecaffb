"""The cell's scene as markers: latched, redrawn on change, beside the command path."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import Point
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from delta_calibration.cell.background import Background
from delta_calibration.cell.calibration_session import CalibrationSession
from delta_calibration.cell.guard_trail import GuardTrail
from delta_calibration.cell.scene import Drawing, Kind, scene
from delta_calibration.description import BASE
from delta_calibration.ros.qos import STATUS

PERIOD_S = 1.0
TYPES = {
    Kind.DOTS: Marker.SPHERE_LIST,
    Kind.LINES: Marker.LINE_LIST,
    Kind.TRIANGLES: Marker.TRIANGLE_LIST,
}


class Markers:
    """Publishes what a desk's cell looks like on `~/markers`.

    Once a second it looks whether something changed: then the picture is made and sent on another
    thread. What goes wrong there is logged: nobody's commands wait for a picture.

    Args:
        node: that has the desk.
        desk: the desk now; None where there is none.
        scale: by which errors are drawn longer, now.
        prefix: of the name of the robot's base, in which all is drawn.
    """

    def __init__(
        self,
        node: Node,
        desk: Callable[[], CalibrationSession | None],
        scale: Callable[[], float],
        prefix: str = "",
    ) -> None:
        self._node, self._desk, self._scale = node, desk, scale
        self._frame = prefix + BASE
        self.trail = GuardTrail()
        self._drawn: tuple[Any, ...] = ()  # what the scene is of
        self._scene: list[Marker] = []
        self._work: Background[None] | None = None
        self._publisher = node.create_publisher(MarkerArray, "~/markers", STATUS)
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self._look, clock=clock)

    def _look(self) -> None:
        if self._work is not None and not self._ended(self._work):
            return
        desk, self._work = self._desk(), None
        if desk is None:
            return
        wanted = (desk.robot, desk.calibration, desk.fitted, self._scale())
        if self.trail.waiting or not _same(wanted, self._drawn):
            self._work = Background(partial(self._draw, wanted))

    def _ended(self, work: Background[None]) -> bool:
        """Whether a picture is done; one that could not be made is told."""
        if not work.done:
            return False
        try:
            work.result()
        except Exception:
            self._node.get_logger().error(f"markers: {traceback.format_exc()}")
        return True

    def _draw(self, wanted: tuple[Any, ...]) -> None:
        """Make the picture and send it; not on the thread of the commands."""
        anew = not _same(wanted, self._drawn)
        if anew:
            self._drawn = wanted
            self.trail.clear()
            self._scene = [marker(drawing, self._frame) for drawing in scene(*wanted)]
        if self.trail.placed(wanted[0]) or anew:
            guards = [marker(drawing, self._frame) for drawing in self.trail.drawings()]
            self._publisher.publish(picture([*self._scene, *guards], self._frame))


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether two scenes are of the very same things, drawn at the same scale."""
    return [*map(id, one[:-1]), one[-1:]] == [*map(id, other[:-1]), other[-1:]]


def picture(markers: Sequence[Marker], frame: str) -> MarkerArray:
    """The whole of it: all markers from before go."""
    clear = Marker(action=Marker.DELETEALL)
    clear.header.frame_id = frame
    return MarkerArray(markers=[clear, *markers])


def marker(drawing: Drawing, frame: str) -> Marker:
    """One drawing, under its own namespace, so that each can be switched off by itself."""
    message = Marker(ns=drawing.name, type=TYPES[drawing.kind], action=Marker.ADD)
    message.header.frame_id = frame
    message.pose.orientation.w = 1.0
    size = drawing.size
    message.scale.x, message.scale.y, message.scale.z = (
        (size, 0.0, 0.0) if drawing.kind is Kind.LINES else (size, size, size)
    )
    red, green, blue = drawing.colour
    message.color = ColorRGBA(r=red, g=green, b=blue, a=drawing.opacity)
    message.points = [Point(x=x, y=y, z=z) for x, y, z in drawing.points.tolist()]
    return message
