"""Node that plays a session on its topics, with `/clock`: the recorded bytes at their log times.

Header stamps stay as recorded, and `/clock` shows log times: with `use_sim_time` the nodes that
listen live in the recording. When a session is looped, their time goes back to its start.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock as ClockMessage

from delta_calibration.errors import InputError
from delta_calibration.ros.conversions import ns_to_stamp
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.parameters import ParameterTable, Spec, warn_of_unknown
from delta_calibration.ros.playback import ALL, PlaybackClock, load_timeline, start_index
from delta_calibration.ros.qos import BY_NAME, CLOCK, STREAM_OUT, deeper
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.watchdog import leave

NAME = "session_player"
PERIOD_S = 0.002  # [s] of the timer: messages are late by no more than this
BATCH = 500  # messages sent at a time, so that signals are handled in between
# Messages by which a slow subscriber may lag: at a rate of 10, a depth of 100 is 10 ms of a stream
# of 1 kHz. The depth is a queue of this process only, which subscribers neither see nor match.
QUEUE = 1000
FAREWELL_S = 0.5  # [s] for the last messages to arrive; an acknowledgement may take 3 s

SPECS = (
    Spec("session", "", "folder or file of the session to play", read_only=True, path=True),
    Spec("topics", (ALL,), "topics to play, by their recorded names; * for all", read_only=True),
    Spec("rate", 1.0, "speed of the replay relative to the recording", range=(1e-3, 1e4)),
    Spec("paused", False, "pause the replay until this is set to false"),
    Spec("loop", False, "start again when the end is reached"),
    Spec("start", 0.0, "offset [s] into the session to start from", (0.0, 1e9), read_only=True),
    Spec("clock", True, "publish /clock", read_only=True),
    Spec("clock_rate", 100.0, "rate [Hz] of /clock", range=(1.0, 500.0), read_only=True),
    Spec(
        "wait_for_subscribers",
        0.0,
        "time [s] to wait for a subscriber on every topic before playing anyway",
        range=(0.0, 3600.0),
        read_only=True,
    ),
)


class SessionPlayer(BaseNode):
    """Wires a `Timeline` and a `PlaybackClock` to publishers."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        self._settings = ParameterTable(self, SPECS, self._on_change)
        warn_of_unknown(self)
        path = session_path(self._settings.named("session"))
        self._timeline = load_timeline(path, self._settings.texts("topics"))
        self._first = start_index(self._timeline, self._settings.number("start"))
        for note in self._timeline.notes:
            self.get_logger().warn(note)
        self._publishers_of = [self._advertise(*t) for t in self._topics()]
        self._clock_publisher = (
            self.create_publisher(ClockMessage, "/clock", CLOCK)
            if self._settings.flag("clock")
            else None
        )
        self._playback: PlaybackClock | None = None  # None while waiting for subscribers
        self._next = self._first
        self._passes = 0
        self._created_ns = self._pass_ns = time.monotonic_ns()
        self._clock_due_ns = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(PERIOD_S, self._tick, clock=steady)
        self.get_logger().info(
            f"{path}: {len(self._timeline.records) - self._first} messages on "
            f"{', '.join(self._timeline.topics)}, {self._length_s:.0f} s as recorded, "
            f"{self._settings.number('rate'):g} times as fast"
        )

    def close(self) -> None:
        """Wait for the last messages to arrive."""
        end = time.monotonic() + FAREWELL_S
        for publisher in filter(None, self._publishers_of):
            left_s = max(end - time.monotonic(), 0.0)  # a negative time would wait for ever
            publisher.wait_for_all_acked(Duration(seconds=left_s))

    def _topics(self) -> list[tuple[str, str]]:
        return list(zip(self._timeline.topics, self._timeline.type_names, strict=True))

    def _advertise(self, name: str, type_name: str) -> Publisher | None:
        """Publisher under the relative name, so that a namespace acts; None for unknown types."""
        message = message_class(type_name)
        if message is None:
            self.get_logger().warn(f"{name}: messages of type {type_name} are not installed")
            return None
        topic = BY_NAME.get(name.strip("/"))
        profile = STREAM_OUT if topic is None else topic.writer
        if topic is None or not topic.latched:
            profile = deeper(profile, QUEUE)
        return self.create_publisher(message, name.strip("/"), profile)

    def _on_change(self, _names: tuple[str, ...]) -> None:
        if self._playback is not None:
            self._playback.change(time.monotonic_ns(), *self._speed())

    def _speed(self) -> tuple[float, bool]:
        return self._settings.number("rate"), self._settings.flag("paused")

    def _tick(self) -> None:
        wall_ns = time.monotonic_ns()
        if self._playback is None:
            self._say_time(self._start_ns, wall_ns)
            if self._ready(wall_ns):
                self._playback = self._begin(wall_ns)
            return
        now_ns = min(self._playback.at(wall_ns), self._timeline.end_ns)
        self._say_time(now_ns, wall_ns)
        self._play_until(now_ns)
        if self._next == len(self._timeline.records):
            self._clock_due_ns = 0  # the end time is always published
            self._say_time(now_ns, wall_ns)
            self._end_pass(wall_ns)

    @property
    def _length_s(self) -> float:
        return (self._timeline.end_ns - self._start_ns) * 1e-9

    @property
    def _start_ns(self) -> int:
        return int(self._timeline.log_time_ns[self._first])

    def _ready(self, wall_ns: int) -> bool:
        """Whether every topic has a subscriber, or the waiting time is over."""
        waited_s = (wall_ns - self._created_ns) * 1e-9
        lonely = [
            p.topic_name for p in self._publishers_of if p and not p.get_subscription_count()
        ]
        limit_s = self._settings.number("wait_for_subscribers")
        if lonely and waited_s < limit_s:
            return False
        if lonely and limit_s > 0.0:
            self.get_logger().warn(f"no subscriber on {', '.join(lonely)}")
        return True

    def _begin(self, wall_ns: int) -> PlaybackClock:
        """Start a pass; latched messages from before the start are published first."""
        self._next, self._pass_ns = self._first, wall_ns
        for topic, name in enumerate(self._timeline.topics):
            known = BY_NAME.get(name.strip("/"))
            if known is not None and known.latched:
                index = self._timeline.last_before(topic, self._first)
                if index is not None:
                    self._publish(index)
        return PlaybackClock(self._start_ns, wall_ns, *self._speed())

    def _play_until(self, now_ns: int) -> None:
        stop = min(self._timeline.first_at(now_ns + 1), self._next + BATCH)
        for index in range(self._next, stop):
            self._publish(index)
        self._next = max(self._next, stop)

    def _publish(self, index: int) -> None:
        publisher = self._publishers_of[self._timeline.topic[index]]
        if publisher is not None:
            publisher.publish(self._timeline.records[index])

    def _say_time(self, now_ns: int, wall_ns: int) -> None:
        if self._clock_publisher is not None and wall_ns >= self._clock_due_ns:
            self._clock_due_ns = wall_ns + int(1e9 / self._settings.number("clock_rate"))
            self._clock_publisher.publish(ClockMessage(clock=ns_to_stamp(now_ns)))

    def _end_pass(self, wall_ns: int) -> None:
        self._passes += 1
        count = len(self._timeline.records) - self._first
        lasted = (wall_ns - self._pass_ns) * 1e-9
        self.get_logger().info(f"pass {self._passes}: {count} messages in {lasted:.1f} s")
        if self._settings.flag("loop"):
            self._playback = self._begin(wall_ns)
        else:
            self._timer.cancel()
            self.finish()


def session_path(text: str) -> Path:
    """Path of the session to play.

    Raises:
        InputError: no name given.
    """
    if not text:
        raise InputError("parameter session: is empty; it names the folder of the session to play")
    return Path(text).expanduser()


def message_class(type_name: str) -> Any | None:
    """Class of a type such as `sensor_msgs/msg/JointState`; None if it is not installed."""
    package, _, name = type_name.replace("/", ".").rpartition(".")
    try:
        return getattr(import_module(package), name, None)
    except (ImportError, ValueError):
        return None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until the session ends or it is stopped; returns the exit code."""
    build: Callable[[], SessionPlayer] = SessionPlayer
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
