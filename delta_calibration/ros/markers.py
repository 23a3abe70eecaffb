"""Publisher of the cell's scene as latched markers, redrawn on change beside the command path."""

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
    """Publishes the scene of a calibration session on `~/markers`.

    Once a second it checks for changes; if there are any, the scene is drawn and sent on another
    thread, so that no command waits for it. Failures there are logged.

    Args:
        node: node that owns the session.
        desk: function that returns the present session, or None if there is none.
        scale: function that returns the present magnification of the errors.
        prefix: prefix of the name of the robot's base frame, in which all is drawn.
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
        self._drawn: tuple[Any, ...] = ()  # inputs of the present scene
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
        """Whether the drawing has finished; a failure is logged."""
        if not work.done:
            return False
        try:
            work.result()
        except Exception:
            self._node.get_logger().error(f"markers: {traceback.format_exc()}")
        return True

    def _draw(self, wanted: tuple[Any, ...]) -> None:
        """Draw and publish the scene; must not run on the thread of the commands."""
        anew = not _same(wanted, self._drawn)
        if anew:
            self._drawn = wanted
            self.trail.clear()
            self._scene = [marker(drawing, self._frame) for drawing in scene(*wanted)]
        if self.trail.placed(wanted[0]) or anew:
            guards = [marker(drawing, self._frame) for drawing in self.trail.drawings()]
            self._publisher.publish(picture([*self._scene, *guards], self._frame))


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether two scenes have identical objects as inputs and the same scale."""
    return [*map(id, one[:-1]), one[-1:]] == [*map(id, other[:-1]), other[-1:]]


def picture(markers: Sequence[Marker], frame: str) -> MarkerArray:
    """Message that replaces all earlier markers by these."""
    clear = Marker(action=Marker.DELETEALL)
    clear.header.frame_id = frame
    return MarkerArray(markers=[clear, *markers])


def marker(drawing: Drawing, frame: str) -> Marker:
    """Marker of a drawing, in its own namespace so that it can be switched off separately."""
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
