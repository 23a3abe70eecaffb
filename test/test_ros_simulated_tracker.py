"""The simulated cell: rest errors, commands that it cannot follow, and its topics."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped, PoseStamped
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState, Temperature

from delta_calibration.errors import InputError, ReachError
from delta_calibration.robot import Robot, load_robot
from delta_calibration.ros.conversions import joint_state, ns_to_stamp, stamp_to_ns
from delta_calibration.ros.qos import DIAGNOSTICS, MEASURED, PAYLOAD, STREAM_OUT
from delta_calibration.ros.simulated_machine import SimulatedMachine, without_noise
from delta_calibration.ros.simulated_tracker import SimulatedTracker
from delta_calibration.simulation import draw_machine
from ros_helpers import Bench, Launch, bench_fixture, launch_fixture  # noqa: F401

pytestmark = pytest.mark.ros

NODE = "delta_calibration.ros.simulated_tracker"
ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
A, B, C = np.array([[0.1, 0.2, 0.3], [0.4, 0.1, -0.1], [0.0, 0.5, 0.2]])


def machine(robot: Robot, scatter: float = 1.0) -> SimulatedMachine:
    rng = np.random.default_rng(5)
    return SimulatedMachine(draw_machine(robot, 3, scatter), rng, now=0.0)


def only_rest_errors(radians: float) -> Robot:
    quiet = without_noise(ROBOT)
    return replace(quiet, joints=replace(quiet.joints, repeatability=radians))


def at(simulated: SimulatedMachine, joint: np.ndarray, now: float) -> np.ndarray:
    simulated.command(joint, now)
    return simulated.measure().position


def test_a_rest_error_is_drawn_once_a_move() -> None:
    simulated = machine(only_rest_errors(1e-3))
    first = at(simulated, A, 1.0)
    on_the_way = at(simulated, B, 1.02)
    np.testing.assert_array_equal(at(simulated, A, 1.04), first)  # still the same move
    np.testing.assert_array_equal(at(simulated, A, 1.5), first)  # at rest no error is drawn
    np.testing.assert_allclose(at(simulated, A + 1e-9, 1.9), first, atol=1e-8)  # nor by a tremor
    again = at(simulated, B, 2.0)
    assert 1e-4 < np.linalg.norm(again - on_the_way) < 1e-2
    assert 1e-4 < np.linalg.norm(at(simulated, A, 2.02) - first) < 1e-2


def test_rest_errors_are_as_large_as_the_robot_file_says() -> None:
    repeatability = 50e-6
    simulated = machine(only_rest_errors(repeatability), scatter=0.0)
    points = []
    for k in range(60):  # there and back, with a rest at both ends
        at(simulated, B, 2.0 * k + 1.0)
        points.append(at(simulated, A, 2.0 * k + 2.0))
    model = ROBOT.model("rotary_delta")
    nominal = model.parameters.nominal
    slope = model.velocity_jacobian(A[None], model.forward(A[None], nominal), nominal)[0]
    expected = repeatability * np.linalg.norm(slope)  # root of the trace of J J^T
    spread = np.sqrt(np.var(points, axis=0, ddof=1).sum())
    assert spread == pytest.approx(expected, rel=0.3)


@pytest.mark.parametrize("measures", ["position", "pose"])
def test_a_machine_as_drawn_is_a_delta_in_another_frame(measures: str) -> None:
    robot = without_noise(ROBOT)
    robot = replace(robot, tracker=replace(robot.tracker, measures=measures))
    simulated = machine(robot, scatter=0.0)
    seen = []
    for k, joint in enumerate((A, B, C)):
        simulated.command(joint, float(k))
        seen.append(simulated.measure())
        np.testing.assert_array_equal(seen[-1].joint, joint)
    model = robot.model("rotary_delta")
    points = model.position(model.forward(np.array([A, B, C]), model.parameters.nominal))
    read = np.array([s.position for s in seen])
    for one, other in ((0, 1), (1, 2), (2, 0)):
        length = np.linalg.norm(points[one] - points[other])
        assert np.linalg.norm(read[one] - read[other]) == pytest.approx(length, abs=1e-9)
    turn = Rotation.from_quat([s.quaternion for s in seen])
    if measures == "pose":  # the platform does not rotate: its orientation is that of the base
        ways = turn[:2].apply(points[1:] - points[:2])
        np.testing.assert_allclose(read[1:] - read[:2], ways, atol=1e-9)
    else:
        np.testing.assert_array_equal(turn.magnitude(), 0.0)


def test_beyond_a_limit_it_stays_where_it_is() -> None:
    simulated = machine(without_noise(ROBOT))
    before = at(simulated, A, 1.0)
    with pytest.raises(ReachError, match=r"103\.13 degrees for joint_2; allowed: -35\.0 to 100"):
        simulated.command(np.array([0.0, 1.8, 0.0]), 2.0)
    measured = simulated.measure()
    np.testing.assert_array_equal(measured.position, before)
    np.testing.assert_array_equal(measured.joint, A)


def test_where_it_cannot_be_assembled_it_stays_where_it_was() -> None:
    short = replace(ROBOT.dimensions, rod=0.5)
    wide = replace(ROBOT.joints, lower=np.full(3, -4.0), upper=np.full(3, 4.0))
    simulated = machine(without_noise(replace(ROBOT, dimensions=short, joints=wide)), scatter=0.0)
    before = at(simulated, A, 1.0)
    simulated.command(np.array([-1.6, -2.4, -0.4]), 2.0)
    with pytest.raises(ReachError):
        simulated.measure()
    np.testing.assert_array_equal(simulated.measure().position, before)
    assert np.linalg.norm(at(simulated, B, 3.0) - before) > 0.01


class Upstream:
    """Sends commands to the node and records its messages."""

    def __init__(self, bench: Bench, **parameters: object) -> None:
        self.bench = bench
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.cell = SimulatedTracker(context=bench.context, parameter_overrides=overrides)
        bench.add(self.cell)
        self.cell.start()
        node = bench.node("upstream")
        self.command = node.create_publisher(JointState, "joint_command_compensated", STREAM_OUT)
        self.states: list[JointState] = []
        self.poses: list[PoseStamped] = []
        self.loads: list[InertiaStamped] = []
        self.heat: list[Temperature] = []
        self.said: list[DiagnosticStatus] = []
        for kind, name, heard, qos in (
            (JointState, "joint_states", self.states, MEASURED),
            (PoseStamped, "tracker/pose", self.poses, MEASURED),
            (InertiaStamped, "cell/payload", self.loads, PAYLOAD),
            (Temperature, "cell/temperature", self.heat, MEASURED),
        ):
            node.create_subscription(kind, name, heard.append, qos)
        node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.said.extend(m.status), DIAGNOSTICS
        )
        assert bench.until(lambda: self.command.get_subscription_count() and self.poses)
        bench.spin_for(0.3)

    def send(self, joint: np.ndarray) -> None:
        self.command.publish(joint_state(NAMES, joint, ns_to_stamp(1)))

    def stands_at(self, joint: np.ndarray) -> bool:
        return bool(self.states) and np.allclose(self.states[-1].position, joint, atol=1e-4)

    def says(self, level: bytes, text: str) -> bool:
        """Whether diagnostics that are published now say this."""
        self.said.clear()
        self.cell._diagnostics.publish()
        self.bench.until(lambda: self.said)
        return self.said[-1].level == level and text in self.said[-1].message


def test_encoders_and_tracker_speak_at_the_rate_with_one_stamp(bench: Bench) -> None:
    cell = Upstream(bench, rate=40.0)
    assert cell.stands_at(np.zeros(3))  # at home
    cell.states.clear()
    cell.poses.clear()
    assert bench.until(lambda: len(cell.poses) >= 40)
    stamps = [stamp_to_ns(m.header.stamp) for m in cell.states]
    assert set(stamps) & {stamp_to_ns(m.header.stamp) for m in cell.poses} >= set(stamps[1:-1])
    assert np.median(np.diff(stamps)) == pytest.approx(25e6, rel=0.2)
    now = cell.cell.get_clock().now().nanoseconds
    assert 0 <= now - stamps[-1] < 30e9
    pose = cell.poses[-1]
    assert pose.header.frame_id == "tracker"
    assert (pose.pose.orientation.x, pose.pose.orientation.w) == (0.0, 1.0)
    assert list(cell.states[-1].name) == list(NAMES)
    assert [m.inertia.m for m in cell.loads] == [0.0]  # received although published before
    assert {m.header.frame_id for m in cell.heat} == {"arm", "base"}
    assert {m.temperature for m in cell.heat} == {20.0}


def test_without_noise_every_reading_is_the_same(bench: Bench) -> None:
    quiet = Upstream(bench, noise=False)
    assert bench.until(lambda: len(quiet.poses) > 10)
    assert len({m.pose.position.x for m in quiet.poses}) == 1


def test_the_tracker_has_noise_at_rest(bench: Bench) -> None:
    noisy = Upstream(bench, seed=0)
    noisy.poses.clear()
    assert bench.until(lambda: len(noisy.poses) > 30)
    points = np.array([[p.pose.position.x, p.pose.position.y] for p in noisy.poses])
    assert len(np.unique(points[:, 0])) == len(points) > 30
    assert points.std(axis=0).max() > 1e-6
    assert points.std(axis=0).max() < 3e-5


@pytest.mark.parametrize(
    ("names", "position", "said"),
    [
        (NAMES, [0.1, float("nan"), 0.1], "joint_2 = nan"),
        (("joint_1", "joint_2", "elbow"), [0.1, 0.1, 0.1], "'joint_2', 'elbow']"),
        (NAMES, [0.1, 0.1], "2 positions for 3 names"),
        ((), [], "found []"),
        (NAMES, [0.1, 0.1, 2.0], "114.59 degrees for joint_3"),
    ],
)
def test_a_useless_command_holds_the_pose_and_is_said(
    bench: Bench, names: tuple[str, ...], position: list[float], said: str
) -> None:
    cell = Upstream(bench)
    cell.send(A)
    assert bench.until(lambda: cell.stands_at(A))
    cell.command.publish(JointState(name=list(names), position=position))
    assert bench.until(lambda: cell.cell._refused)
    bench.spin_for(0.1)
    assert cell.says(DiagnosticStatus.WARN, said)
    assert cell.stands_at(A)
    cell.send(B)
    assert bench.until(lambda: cell.stands_at(B))
    assert cell.says(DiagnosticStatus.OK, "following")


def test_the_truth_is_nowhere_to_be_read(bench: Bench) -> None:
    cell = Upstream(bench)
    listener = bench.node("spy")
    published = dict(listener.get_publisher_names_and_types_by_node("simulated_tracker", "/"))
    ours = {name for name in published if name not in ("/rosout", "/parameter_events")}
    expected = {"/joint_states", "/tracker/pose", "/cell/temperature", "/cell/payload"}
    assert ours == expected | {"/diagnostics"}
    assert not cell.states[-1].velocity
    known = {spec for spec in cell.cell.list_parameters([], 0).names if "." not in spec}
    assert known <= {"robot", "seed", "scatter", "rate", "noise", "effects", "warm_up"} | {
        "data_dir",
        "frame_prefix",
        "services",
        "use_sim_time",
        "start_type_description_service",
    }


def test_hidden_effects_are_in_what_it_says(bench: Bench) -> None:
    """It warms up, and the stated payload bends it."""
    effects = ["none", "thermal_growth_arm", "joint_compliance:value=1e-3"]
    cell = Upstream(bench, noise=False, effects=effects, warm_up=2.0)
    assert bench.until(lambda: len(cell.heat) >= 4)
    assert max(m.temperature for m in cell.heat) > 21.0
    before = cell.poses[-1].pose.position.z
    load = bench.node("crane").create_publisher(InertiaStamped, "cell/payload", PAYLOAD)
    message = InertiaStamped()
    message.inertia.m = 4.0
    load.publish(message)
    # 4 kg rotate each joint by a few mrad: some millimetres down
    assert bench.until(lambda: before - cell.poses[-1].pose.position.z > 1e-3)
    message.inertia.m = -1.0
    load.publish(message)
    bench.spin_for(0.3)
    assert before - cell.poses[-1].pose.position.z > 1e-3


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("robot", "/no/such/robot.yaml", "/no/such/robot.yaml"),
        ("rate", 0.0, "rate"),
        ("scatter", float("nan"), "scatter"),
        ("seed", -1, "seed"),
        ("warm_up", 0.0, "warm_up"),
        ("effects", "backlash", "parameter effects: 'backlash' is not of type array"),
        ("effects", ["slack"], "effect slack cannot be hidden; causes: geometry, .*backlash"),
        ("effects", ["backlash:value=wide"], r"value 'wide' is not a finite number \(SI: rad\)"),
        ("effects", ["none", "backlash:value"], "'value' is not of the form key=value"),
    ],
)
def test_wrong_parameters_are_refused(bench: Bench, name: str, value: object, said: str) -> None:
    with pytest.raises(InputError, match=said):
        SimulatedTracker(context=bench.context, parameter_overrides=[Parameter(name, value=value)])


def test_wrong_use_is_one_line_and_2(launch: Launch) -> None:
    node = launch(NODE, robot="scarab")
    assert node.end() == 2
    assert f"no robot '{Path.cwd() / 'scarab'}'" in node.output
    assert len(node.output.strip().splitlines()) == 1


def test_a_robot_file_is_taken_and_sigterm_ends_it(launch: Launch, tmp_path: Path) -> None:
    source = Path(ROBOT.source).read_text().replace("name: srbd", "name: twin")
    (tmp_path / "twin.yaml").write_text(source)
    node = launch(NODE, robot=tmp_path / "twin.yaml", seed=4)
    assert node.says("machine 4 of twin")
    node.send(signal.SIGTERM)
    assert node.end() == 0
    assert "Traceback" not in node.output


def test_a_storm_of_bad_messages_is_a_few_lines_of_log(bench: Bench, launch: Launch) -> None:
    node = launch(NODE, rate=20.0)
    sender = bench.node("sender")
    load = sender.create_publisher(InertiaStamped, "cell/payload", PAYLOAD)
    command = sender.create_publisher(JointState, "joint_command_compensated", STREAM_OUT)
    wrong = InertiaStamped()
    wrong.inertia.m = -1.0
    long = JointState(name=["x" * 10_000] * 20, position=[0.0] * 20)
    assert bench.until(lambda: load.get_subscription_count() and command.get_subscription_count())

    def told() -> bool:
        load.publish(wrong)
        command.publish(long)
        bench.spin_for(0.005)
        return "payload as before" in node.output and "pose held" in node.output

    assert bench.until(told)
    for _ in range(200):
        told()
    node.send(signal.SIGINT)
    assert node.end() == 0
    said = [line for line in node.output.splitlines() if "payload as before" in line]
    assert "InertiaStamped.inertia.m: -1.0 kg" in said[0]
    assert len(said) < 10
    assert max(map(len, node.output.splitlines())) < 1000
