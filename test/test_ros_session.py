"""Recorder and player as processes: counts, stamps, time, and the file of a killed recorder."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped, PoseStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.recording import SessionWriter, read_messages, read_session
from delta_calibration.recording.messages import encode_joint_state, encode_payload
from delta_calibration.ros.conversions import joint_state, ns_to_stamp, pose_stamped, stamp_to_ns
from delta_calibration.ros.qos import CLOCK, COMMAND, DIAGNOSTICS, MEASURED, PAYLOAD, STREAM_OUT
from ros_helpers import Bench, Launch, NodeProcess, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

RECORDER = "delta_calibration.ros.session_recorder"
PLAYER = "delta_calibration.ros.session_player"
NAMES = ("joint_1", "joint_2", "joint_3")
T0_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
COUNT = 100  # messages of the played session: 1 s


class Cell:
    """Publishes the topics of a cell."""

    def __init__(self, bench: Bench, prefix: str = "") -> None:
        self.bench = bench
        node = bench.node("cell")
        self.command = node.create_publisher(JointState, f"{prefix}joint_command", STREAM_OUT)
        self.states = node.create_publisher(JointState, f"{prefix}joint_states", MEASURED)
        self.tracker = node.create_publisher(PoseStamped, f"{prefix}tracker/pose", STREAM_OUT)
        self.heat = node.create_publisher(Temperature, f"{prefix}cell/temperature", MEASURED)
        payload = node.create_publisher(InertiaStamped, f"{prefix}cell/payload", PAYLOAD)
        load = InertiaStamped()
        load.inertia.m, load.header.stamp = 1.5, ns_to_stamp(T0_NS)
        payload.publish(load)  # before anybody subscribes

    def found(self) -> bool:
        streams = (self.command, self.states, self.tracker, self.heat)
        matched = self.bench.until(lambda: all(p.get_subscription_count() for p in streams))
        self.bench.spin_for(1.0)  # subscribers discover us too, or best effort is lost
        return matched

    def run(self, count: int, pause_s: float = 0.001) -> None:
        for k in range(count):
            stamp = ns_to_stamp(T0_NS + k * STEP_NS)
            angles = np.array([k, 2.0 * k, 3.0 * k]) * 1e-3
            self.command.publish(joint_state(NAMES, angles, stamp))
            self.states.publish(joint_state(NAMES, angles + 1e-5, stamp))
            pose = pose_stamped(np.array([k, 0.0, 3.0]), np.array([0, 0, 0, 1.0]), stamp)
            self.tracker.publish(pose)
            if k % 100 == 0:
                heat = Temperature(temperature=20.0 + k * 1e-3)
                heat.header.frame_id, heat.header.stamp = "arm", stamp
                self.heat.publish(heat)
            self.bench.spin_for(pause_s)


def watched(bench: Bench) -> list[DiagnosticStatus]:
    """Collect all statuses on /diagnostics from now on."""
    seen: list[DiagnosticStatus] = []
    bench.node("watcher").create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: seen.extend(m.status), DIAGNOSTICS
    )
    return seen


def recorded(seen: list[DiagnosticStatus], topic: str) -> int:
    """Number of recorded messages of a topic, by the recorder's last status."""
    return int(dict(pairs(seen[-1]))[f"{topic} messages"]) if seen else 0


def test_a_recording_holds_every_message_with_its_stamp(
    bench: Bench, launch: Launch, tmp_path: Path
) -> None:
    cell = Cell(bench)
    seen = watched(bench)
    path = tmp_path / "session"
    node = launch(RECORDER, output=path, provenance=["robot=srbd", "seed=4"])
    assert cell.found()
    cell.run(300)
    assert bench.until(lambda: recorded(seen, "joint_command") == 300)
    node.send(signal.SIGINT)
    assert node.end() == 0

    session = read_session(path)
    stamps = T0_NS + np.arange(300) * STEP_NS
    np.testing.assert_array_equal(session.command.stamp_ns, stamps)
    np.testing.assert_array_equal(session.states.stamp_ns, stamps)
    np.testing.assert_array_equal(session.tracker.position[:, 0], np.arange(300.0))
    np.testing.assert_array_equal(session.command.position[299], np.array([299, 598, 897]) * 1e-3)
    assert session.command.names == NAMES
    assert session.temperature[0].celsius.tolist() == [20.0, 20.1, 20.2]
    assert session.payload.mass.tolist() == [1.5]
    assert session.metadata["robot"] == "srbd"
    assert session.metadata["seed"] == "4"
    assert session.notes == ()

    last = seen[-1]
    assert last.level == DiagnosticStatus.OK
    assert last.name == "/session_recorder"
    assert ("tracker/pose dropped", "0") in pairs(last)
    assert int(dict(pairs(last))["tracker/pose bytes"]) > 300 * 80


def test_a_killed_recorder_loses_a_second_at_most_and_the_loss_is_said(
    bench: Bench, launch: Launch, tmp_path: Path
) -> None:
    cell = Cell(bench)
    path = tmp_path / "session"
    node = launch(RECORDER, output=path)
    assert cell.found()
    cell.run(1200)
    node.send(signal.SIGKILL)
    assert node.end() == -signal.SIGKILL
    session = read_session(path)
    count = len(session.command.stamp_ns)
    assert 300 <= count <= 1200
    expected = T0_NS + np.arange(count) * STEP_NS  # from the start, without gaps
    np.testing.assert_array_equal(session.command.stamp_ns, expected)
    assert any("cut off" in note for note in session.notes)


def test_a_remapped_topic_is_recorded_under_the_contracts_name(
    bench: Bench, launch: Launch, tmp_path: Path
) -> None:
    cell = Cell(bench, prefix="/plant/")
    path = tmp_path / "session"
    node = launch(
        RECORDER,
        *("--ros-args", "-r", "joint_command:=/plant/joint_command"),
        *("-p", f"output:='{path}'", "-p", "topics:=[joint_command]"),
    )
    seen = watched(bench)
    assert bench.until(lambda: cell.run(1) or recorded(seen, "joint_command"))
    node.send(signal.SIGTERM)
    assert node.end() == 0
    messages, _ = read_messages(path)
    assert {m.topic for m in messages} == {"/joint_command"}
    metadata = (path / "metadata.yaml").read_text()
    assert "recorded joint_command from: /plant/joint_command" in metadata


@pytest.mark.parametrize(
    ("take_away", "said"),
    [
        (shutil.rmtree, "the recording was deleted, and is lost"),
        (lambda path: path.rename(path.with_name("elsewhere")), "the recording was moved away"),
    ],
    ids=["deleted", "moved"],
)
def test_a_recording_whose_folder_goes_away_says_so_at_once(
    bench: Bench,
    launch: Launch,
    tmp_path: Path,
    take_away: Callable[[Path], object],
    said: str,
) -> None:
    seen = watched(bench)
    path = tmp_path / "session"
    node = launch(RECORDER, output=path)
    assert bench.until(lambda: seen)
    take_away(path)
    assert bench.until(lambda: node.process.poll() is not None)
    assert node.end() == 2
    assert f"{path}: {said} while it was written" in node.output
    assert "Traceback" not in node.output
    assert bench.until(lambda: seen[-1].level == DiagnosticStatus.ERROR)
    assert said in seen[-1].message


def test_a_session_is_never_overwritten(launch: Launch, played: Path) -> None:
    before = sorted((p, p.stat().st_size) for p in played.iterdir())
    node = launch(RECORDER, output=played)
    assert node.end() == 2
    assert f"{played} exists" in node.output
    assert "Traceback" not in node.output
    assert sorted((p, p.stat().st_size) for p in played.iterdir()) == before


@pytest.fixture
def played(tmp_path: Path) -> Path:
    """Session of 1 s with commands at 100 Hz and a payload at its start."""
    path = tmp_path / "played"
    with SessionWriter(path, {}, compression="none") as writer:
        load = encode_payload(T0_NS, "tool0", 2.5, (0.0, 0.0, 0.1))
        writer.write("/cell/payload", "geometry_msgs/msg/InertiaStamped", T0_NS, load)
        for k in range(COUNT):
            stamp = T0_NS + k * STEP_NS
            data = encode_joint_state(stamp, NAMES, (k * 1e-3, 0.0, 0.0))
            writer.write("/joint_command", "sensor_msgs/msg/JointState", stamp, data)
    return path


class Listener:
    """Records what a player sends."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        node: Node = bench.node("listener")
        self.stamps: list[int] = []
        self.angles: list[float] = []
        self.clock: list[int] = []
        self.masses: list[float] = []
        node.create_subscription(JointState, "joint_command", self._on_command, COMMAND)
        node.create_subscription(Clock, "/clock", self._on_clock, CLOCK)
        node.create_subscription(InertiaStamped, "cell/payload", self._on_payload, PAYLOAD)

    def _on_command(self, message: JointState) -> None:
        self.stamps.append(stamp_to_ns(message.header.stamp))
        self.angles.append(message.position[0])

    def _on_clock(self, message: Clock) -> None:
        self.clock.append(stamp_to_ns(message.clock))

    def _on_payload(self, message: InertiaStamped) -> None:
        self.masses.append(message.inertia.m)

    def until_end(self, node: NodeProcess) -> int:
        assert self.bench.until(lambda: node.process.poll() is not None)
        self.bench.spin_for(0.1)
        return node.end()


STAMPS = [T0_NS + k * STEP_NS for k in range(COUNT)]


@pytest.mark.parametrize("rate", [0.5, 1.0])
def test_a_player_gives_every_message_and_its_time(
    bench: Bench, launch: Launch, played: Path, rate: float
) -> None:
    listener = Listener(bench)
    node = launch(PLAYER, session=played, rate=rate, wait_for_subscribers=10.0)
    assert listener.until_end(node) == 0
    assert listener.stamps == STAMPS
    np.testing.assert_allclose(listener.angles, np.arange(COUNT) * 1e-3, rtol=1e-15)
    assert listener.masses == [2.5]
    assert f" s as recorded, {rate:g} times as fast" in node.output
    assert f"pass 1: {COUNT + 1} messages" in node.output
    clock = np.array(listener.clock)
    assert np.all(np.diff(clock) >= 0)
    assert clock.min() >= STAMPS[0]
    assert clock[-1] == STAMPS[-1]
    assert len(np.unique(clock)) > 30 / rate


def test_a_loop_goes_round_until_it_is_stopped(bench: Bench, launch: Launch, played: Path) -> None:
    listener = Listener(bench)
    node = launch(PLAYER, session=played, loop=True, wait_for_subscribers=10.0)
    assert bench.until(lambda: len(listener.stamps) > 2.5 * COUNT)
    node.send(signal.SIGINT)
    assert listener.until_end(node) == 0
    assert listener.stamps[: 2 * COUNT] == 2 * STAMPS
    assert "pass 2:" in node.output
    # Clock and messages are different topics; one may begin a pass before the other.
    turns = int(np.sum(np.diff(listener.clock) < 0))
    assert abs(turns - len(listener.stamps) // COUNT) <= 1
    assert turns >= 1


def test_a_start_inside_the_session_says_first_what_already_held(
    bench: Bench, launch: Launch, played: Path
) -> None:
    listener = Listener(bench)
    node = launch(PLAYER, session=played, start=0.6, wait_for_subscribers=10.0)
    assert listener.until_end(node) == 0
    assert listener.stamps == STAMPS[60:]
    assert listener.masses == [2.5]
    assert min(listener.clock) >= STAMPS[60]


def test_a_paused_player_waits_for_its_parameter(
    bench: Bench, launch: Launch, played: Path
) -> None:
    listener = Listener(bench)
    node = launch(PLAYER, session=played, paused=True, topics=["joint_command"])
    assert bench.until(lambda: len(listener.clock) > 20)
    assert len(set(listener.clock)) == 1
    assert len(listener.stamps) <= 1  # the message at the start
    client = AsyncParameterClient(bench.node("operator"), "/session_player")
    assert bench.until(client.services_are_ready)
    answer = client.set_parameters([Parameter("paused", value=False)])
    assert bench.until(answer.done)
    assert listener.until_end(node) == 0
    assert listener.stamps[-1] == STAMPS[-1]
    assert listener.masses == []


def test_a_cut_off_session_is_played_as_far_as_it_goes(
    bench: Bench, launch: Launch, played: Path
) -> None:
    data = next(played.glob("*.mcap"))
    content = data.read_bytes()
    halfway = content.index(encode_joint_state(STAMPS[50], NAMES, (50 * 1e-3, 0.0, 0.0)))
    data.write_bytes(content[: halfway + 10])
    listener = Listener(bench)
    node = launch(PLAYER, session=played, rate=10.0, wait_for_subscribers=10.0)
    assert listener.until_end(node) == 0
    assert "cut off" in node.output
    assert listener.stamps == STAMPS[:50]


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({}, "parameter session: is empty"),
        ({"session": "/no/such/folder"}, "/no/such/folder does not exist"),
        ({"rate": 0.0}, "rate"),
        ({"rate": -1.0}, "rate"),
        ({"topics": ["tracker/pose"]}, "no topic tracker/pose; it has"),
        ({"start": 5.0}, "5.0 s, but the session lasts 0.990 s"),
    ],
)
def test_wrong_use_of_the_player_is_one_line_and_2(
    launch: Launch, played: Path, parameters: dict[str, object], said: str
) -> None:
    session = {"session": played} if parameters else {}
    node = launch(PLAYER, **(session | parameters))
    assert node.end() == 2
    assert said in node.output
    assert len(node.output.strip().splitlines()) == 1


def pairs(status: DiagnosticStatus) -> list[tuple[str, str]]:
    return [(value.key, value.value) for value in status.values]
