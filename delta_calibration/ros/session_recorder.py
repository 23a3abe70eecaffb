"""Node that records a session: all input topics, as the bytes that were received.

The bytes are taken from raw subscriptions and never serialised again. A topic is recorded under
its default name even where a remap makes it listen elsewhere: the remap says which of the cell's
topics that is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks

from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.recording import LATCHED, Qos, SessionWriter
from delta_calibration.recording.messages import message_type
from delta_calibration.ros.diagnostics import Diagnostics
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.parameters import ParameterTable, Spec, warn_of_unknown
from delta_calibration.ros.qos import BY_NAME, INPUTS, Topic, deeper
from delta_calibration.ros.runtime import BaseNode, run
from delta_calibration.ros.watchdog import leave

NAME = "session_recorder"
SYNC_S = 1.0  # [s]
CLOSE_S = 20.0  # [s] to write the remaining data on a slow disk
# Messages that wait while the disk is flushed: two seconds at 1 kHz, of which a depth of 100 would
# lose all but 0.1 s. The depth is a queue of this process only: the other side, for which the
# interface fixes 100 (qos.py), neither sees it nor has to match it.
QUEUE = 2000

SPECS = (
    Spec(
        "output",
        "",
        "folder of the session to be written; must not exist",
        read_only=True,
        path=True,
    ),
    Spec(
        "topics",
        tuple(topic.name for topic in INPUTS),
        "topics to record, by their default names",
        choices=tuple(topic.name for topic in INPUTS),
        read_only=True,
    ),
    Spec("provenance", ("",), "entries key=value for the metadata of the session", read_only=True),
)


@dataclass
class Tally:
    """Counts of messages and bytes received on one topic."""

    messages: int = 0
    bytes: int = 0
    dropped: int = 0


class SessionRecorder(BaseNode):
    """Wires raw subscriptions to a `SessionWriter`, and reports on `/diagnostics`."""

    stop_limit_s = CLOSE_S

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(NAME, **kwargs)
        parameters = ParameterTable(self, SPECS)
        warn_of_unknown(self)
        topics = [BY_NAME[name] for name in dict.fromkeys(parameters.texts("topics"))]
        if not topics:
            raise InputError(f"parameter topics: is empty; name some of {', '.join(BY_NAME)}")
        provenance = parse_provenance(parameters.texts("provenance")) | self._sources(topics)
        self._path = output_path(parameters.named("output"))
        self._writer = SessionWriter(self._path, provenance)
        self._failed = ""  # why the recording ended
        self._tallies = {topic.name: Tally() for topic in topics}
        for topic in topics:
            self._listen(topic)
        self._diagnostics = Diagnostics(self, self._report)
        self.create_timer(SYNC_S, self._sync, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f"recording {', '.join(self._tallies)} to {self._path}")

    def close(self) -> None:
        """Finish the files, with all messages that arrived until now."""
        self._diagnostics.publish()
        self._writer.close()
        self.get_logger().info(f"{self._path}: {self._writer.message_count} messages")

    def _sources(self, topics: Sequence[Topic]) -> dict[str, str]:
        """Provenance entries for topics that are recorded under a remapped name."""
        heard = {topic.name: self.resolve_topic_name(topic.name) for topic in topics}
        return {f"recorded {k} from": v for k, v in heard.items() if v != f"/{k}"}

    def _listen(self, topic: Topic) -> None:
        message_type(topic.type_name)  # cached: the first call takes a fifth of a second
        tally = self._tallies[topic.name]
        # A callback with one argument: with two, the events executor of rclpy 7.1 fails.
        self.create_subscription(
            topic.message,
            topic.name,
            functools.partial(self._on_message, topic, tally),
            deeper(topic.reader, QUEUE) if not topic.latched else topic.reader,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=functools.partial(_on_lost, tally)
            ),
        )

    def _on_message(self, topic: Topic, tally: Tally, data: bytes) -> None:
        now_ns = self.get_clock().now().nanoseconds
        if now_ns == 0 or self.finished.done():  # simulated time without a clock; a full disk
            tally.dropped += 1
            return
        try:
            if not tally.messages:
                qos = LATCHED if topic.latched else Qos()
                self._writer.add_topic("/" + topic.name, topic.type_name, (qos,))
            self._writer.write("/" + topic.name, topic.type_name, now_ns, data)
        except CalibrationError as error:
            self._give_up(error)
            return
        tally.messages += 1
        tally.bytes += len(data)

    def _sync(self) -> None:
        """Flush written data to the disk, even while no messages arrive."""
        if not self.finished.done():
            try:
                self._writer.sync()
            except CalibrationError as error:
                self._give_up(error)

    def _give_up(self, error: CalibrationError) -> None:
        """End the node, with the error on diagnostics as well as in the log."""
        self._failed = str(error)
        self._diagnostics.publish()
        self.fail(error)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        dropped = sum(tally.dropped for tally in self._tallies.values())
        values: dict[str, object] = {"session": self._path}
        for name, tally in self._tallies.items():
            values[f"{name} messages"] = tally.messages
            values[f"{name} bytes"] = tally.bytes
            values[f"{name} dropped"] = tally.dropped
        if self._failed:
            return DiagnosticStatus.ERROR, self._failed, values
        if dropped:
            return DiagnosticStatus.WARN, f"recording, {dropped} messages dropped", values
        return DiagnosticStatus.OK, "recording", values


def _on_lost(tally: Tally, event: Any) -> None:
    tally.dropped += int(event.total_count_change)


def output_path(text: str) -> Path:
    """Folder to write; the writer checks that it does not exist yet.

    Raises:
        InputError: no name.
    """
    if not text:
        raise InputError("parameter output: is empty; it names the folder of the session to write")
    return Path(text).expanduser()


def parse_provenance(entries: Sequence[str]) -> dict[str, str]:
    """Parse texts `key=value` to a mapping.

    Raises:
        InputError: an entry without `=` or without a key.
    """
    pairs = {}
    for entry in entries:
        key, sign, value = entry.partition("=")
        if not sign or not key.strip():
            raise InputError(f"parameter provenance: {entry!r} is not of the form key=value")
        pairs[key.strip()] = value.strip()
    return pairs


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    build: Callable[[], SessionRecorder] = SessionRecorder
    return run(build, NAME, arguments)


if __name__ == "__main__":
    leave(run_node(NAME))
