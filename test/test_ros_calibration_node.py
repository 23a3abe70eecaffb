"""The calibration node in this process: its outputs, refusals and robustness."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import InertiaStamped, PointStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, Temperature

from calibration_bench import (  # noqa: F401
    CLEARLY,
    MACHINE,
    NAMES,
    ROBOT,
    T0_NS,
    Cell,
    Q,
    desk_fixture,
    file_fixture,
    positions,
    session_fixture,
)
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cell.calibration_session import CalibrationSession
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import at_rest
from delta_calibration.ros.calibration_node import MARK, CalibrationNode
from delta_calibration.ros.conversions import joint_state, ns_to_stamp, stamp_to_ns
from delta_calibration.ros.qos import PAYLOAD, STREAM_OUT
from extended_bench import Effects, with_effects
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros


def test_a_command_is_passed_through_compensated_and_passed_again(
    bench: Bench, file: Path
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    stamp = T0_NS + 123_456_789
    out = cell.give(Q, stamp)
    np.testing.assert_array_equal(positions(out), Q)
    assert (stamp_to_ns(out.header.stamp), out.header.frame_id) == (stamp, "")

    assert cell.call("enable", True)[0]
    out = cell.give(Q, stamp + 1)
    assert (stamp_to_ns(out.header.stamp), out.header.frame_id) == (stamp + 1, MARK)
    correction = positions(out) - Q
    assert np.abs(correction).max() > CLEARLY
    # The true tool gets nearer to the place that the nominal robot was meant to reach.
    errors = [true_error(cell.node._desk, q) for q in (Q, positions(out))]
    assert errors[1] < 0.1 * errors[0]

    cell.states.publish(joint_state(NAMES, positions(out), ns_to_stamp(stamp + 2)))
    assert bench.until(lambda: cell.nominal)
    np.testing.assert_allclose(positions(cell.nominal[-1]), Q, atol=1e-12)
    assert stamp_to_ns(cell.nominal[-1].header.stamp) == stamp + 2

    assert cell.call("enable", False)[0]
    np.testing.assert_allclose(positions(cell.give(Q, stamp + 3)), Q, atol=1e-15)


def true_error(desk: CalibrationSession, q: np.ndarray) -> float:
    """Distance of the true tool at q from the nominal tool at Q, in the calibrated base [m]."""
    reading = MACHINE.chain.predict(at_rest(q[None]), MACHINE.theta)
    reached = desk.calibration.tool_points(reading, q[None])[0]
    nominal = ROBOT.model("rotary_delta")
    meant = nominal.forward(Q[None], nominal.parameters.nominal)[0] + ROBOT.tool_offset
    return float(np.linalg.norm(reached - meant))


def test_a_table_is_ready_when_the_node_is_configured(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0, method="table")
    newton = JointCompensator(load_calibration(file, ROBOT))
    assert cell.call("enable", True)[0]
    out = cell.give(Q)
    np.testing.assert_allclose(positions(out), newton.compensate(Q[None]).joint[0], atol=3e-6)
    assert np.abs(positions(out) - Q).max() > CLEARLY
    assert cell.diagnosed("compensating by table (", DiagnosticStatus.OK)


def test_the_correction_comes_without_a_jump(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=4.0)  # longer than any delay of this computer
    cell.give(Q, T0_NS)
    assert cell.call("enable", True)[0]
    end = time.monotonic() + 4.5
    out = []
    while time.monotonic() < end:
        out.append(positions(cell.give(Q, T0_NS)))
        bench.spin_for(0.005)
    steps = np.abs(np.diff([Q, *out], axis=0)).max(axis=1)
    whole = np.abs(out[-1] - Q).max()
    assert whole > CLEARLY
    assert len(out) > 20
    assert steps.max() < 0.5 * whole


def test_an_order_of_names_that_differs_is_understood(bench: Bench) -> None:
    cell = Cell(bench)
    message = JointState(name=[*NAMES[::-1], "gripper"], position=array("d", [*Q[::-1], 9.0]))
    np.testing.assert_array_equal(positions(cell.answer(message)), Q)


BAD: dict[str, Callable[[], JointState]] = {
    "finite values are needed": lambda: JointState(
        name=list(NAMES), position=array("d", [0.1, np.nan, 0.2])
    ),
    "found ['a', 'b', 'c']": lambda: JointState(name=["a", "b", "c"], position=array("d", Q)),
    "2 positions for": lambda: JointState(name=list(NAMES), position=array("d", [0.1, 0.2])),
    "found []": lambda: JointState(position=array("d", Q)),
}


@pytest.mark.parametrize("on_failure", ["pass_through", "hold"])
def test_malformed_commands_are_refused_told_and_dropped_or_held(
    bench: Bench, on_failure: str
) -> None:
    cell = Cell(bench, on_failure=on_failure)
    assert cell.answer(BAD["found []"]()) is None  # no command to hold yet
    good = cell.give(Q)
    for said, make in BAD.items():
        out = cell.answer(make())
        if on_failure == "hold":
            np.testing.assert_array_equal(positions(out), positions(good))
        else:
            assert out is None
        assert said in cell.node._desk.health(time.monotonic(), 2.0).message
    assert cell.diagnosed("joint_command: JointState")
    assert cell.value("joint_command refused") == "5"
    back = positions(cell.give(Q + 0.01))
    if on_failure == "hold":  # a ramp starts at the held command
        assert (back < Q + 0.005).all()
        for _ in range(25):
            bench.spin_for(0.05)
            back = positions(cell.give(Q + 0.01))
    np.testing.assert_allclose(back, Q + 0.01, atol=1e-15)


def test_malformed_states_and_readings_are_refused_and_the_path_goes_on(bench: Bench) -> None:
    cell = Cell(bench)
    cell.states.publish(JointState(name=list(NAMES), position=array("d", [np.inf, 0.0, 0.0])))
    point = PointStamped()
    point.point.x = float("nan")
    cell.tracker.publish(point)
    assert cell.diagnosed("tracker/point")
    assert cell.value("joint_states refused") == "1"
    assert cell.value("tracker/point refused") == "1"
    assert cell.nominal == []
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)


def test_beyond_the_region_a_command_passes_or_the_last_good_one_is_held(
    bench: Bench, file: Path
) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    good = positions(cell.give(Q))
    far = np.full(3, 1.2)  # far below the measured poses
    np.testing.assert_array_equal(positions(cell.give(far)), far)
    assert cell.diagnosed("outside the calibrated region")
    cell.node.set_parameters([Parameter("on_failure", value="hold")])
    np.testing.assert_allclose(positions(cell.give(Q)), good, atol=1e-12)
    np.testing.assert_allclose(positions(cell.give(far)), good, atol=1e-12)
    assert cell.value("command outside the calibrated region") == "2"


def test_a_compensated_command_is_not_compensated_twice(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    once = cell.give(Q)
    assert once.header.frame_id == MARK
    twice = cell.answer(once)
    np.testing.assert_array_equal(positions(twice), positions(once))
    assert twice.header == once.header
    assert cell.diagnosed("already compensated")
    assert cell.value("command already compensated, passed unchanged") == "1"


def test_time_going_backwards_is_told_and_nothing_lost(bench: Bench) -> None:
    cell = Cell(bench)
    for stamp in (T0_NS, T0_NS + 5, T0_NS + 2):
        assert stamp_to_ns(cell.give(Q, stamp).header.stamp) == stamp
    assert cell.diagnosed("time went backwards")
    assert cell.value("command time went backwards") == "1"


def test_only_an_active_node_sends(bench: Bench) -> None:
    cell = Cell(bench)
    assert cell.give(Q) is not None
    cell.node.trigger_deactivate()
    assert cell.give(Q) is None
    cell.states.publish(joint_state(NAMES, Q, ns_to_stamp(T0_NS)))
    bench.spin_for(0.2)
    assert cell.nominal == []
    assert cell.diagnosed("inactive: nothing is sent", DiagnosticStatus.OK)
    for service, value in (("start_capture", None), ("enable", True)):
        yes, said = cell.call(service, value)
        assert not yes
        assert "activate it first" in said
    cell.node.trigger_activate()
    assert cell.give(Q) is not None
    cell.node.trigger_deactivate()
    cell.node.trigger_cleanup()
    for service in ("start_capture", "stop_capture", "fit", "save", "reload"):
        yes, said = cell.call(service)
        assert not yes
        assert "configure it first" in said
    assert cell.give(Q) is None


def test_compensation_is_off_after_every_activation(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    cell.node.trigger_deactivate()
    cell.node.trigger_activate()
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)


def test_deactivated_in_a_hold_it_comes_back_from_where_the_drives_stand(bench: Bench) -> None:
    cell = Cell(bench, on_failure="hold")
    held = positions(cell.give(Q))
    cell.give(np.full(3, np.nan))
    cell.node.trigger_deactivate()
    cell.node.trigger_activate()
    assert cell.give(Q + 0.05) is None
    assert cell.diagnosed("waiting for joint_states")
    cell.states.publish(joint_state(NAMES, held, ns_to_stamp(T0_NS)))
    assert bench.until(lambda: cell.nominal)
    np.testing.assert_allclose(positions(cell.give(Q + 0.05)), held, atol=1e-12)


def test_where_the_drives_stand_is_known_before_the_node_is_active(bench: Bench) -> None:
    cell = Cell(bench)
    cell.node.trigger_deactivate()
    cell.states.publish(joint_state(NAMES, Q - 0.05, ns_to_stamp(T0_NS)))
    bench.spin_for(0.2)
    cell.node.trigger_activate()
    np.testing.assert_allclose(positions(cell.give(Q)), Q - 0.05, atol=1e-12)


def test_a_stop_of_the_process_sends_nothing_stale_and_is_told(bench: Bench) -> None:
    """The node is not spun for half a second while commands arrive at 200 Hz."""
    cell = Cell(bench)
    for _ in range(10):
        cell.give(Q, time.time_ns())
        time.sleep(0.005)
    before = len(cell.sent)
    for k in range(100):
        cell.command.publish(joint_state(NAMES, Q + k * 1e-3, ns_to_stamp(time.time_ns())))
        time.sleep(0.005)
    assert cell.diagnosed("the process was interrupted")
    sent = np.array([positions(m) for m in cell.sent[before:]])
    assert 1 <= len(sent) < 5
    np.testing.assert_allclose(sent[0], Q)  # no jump to the present commands
    assert int(cell.value("command late, a newer one sent")) > 90


def test_another_that_sends_to_the_drives_is_told(bench: Bench) -> None:
    cell = Cell(bench)
    assert cell.diagnosed("passing commands through", DiagnosticStatus.OK)
    other = cell.world.create_publisher(JointState, "joint_command_compensated", STREAM_OUT)
    assert cell.diagnosed("/joint_command_compensated: 2 nodes publish it")
    cell.world.destroy_publisher(other)


@pytest.mark.parametrize(
    ("heard", "sent"),
    [("joint_command", "joint_command_compensated"), ("joint_states", "joint_states_nominal")],
)
def test_a_node_that_would_answer_itself_is_refused(bench: Bench, heard: str, sent: str) -> None:
    remapped = ["--ros-args", "-r", f"{sent}:={heard}"]
    node = bench.add(CalibrationNode(context=bench.context, cli_args=remapped))
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert f"{heard} is /{heard}, which the node itself sends" in node._refused


def test_transitions_out_of_state_are_answered_false(bench: Bench) -> None:
    cell = Cell(bench)
    client = cell.world.create_client(ChangeState, "/calibration_node/change_state")
    assert bench.until(client.service_is_ready)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP, 99):
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = client.call_async(request)
        assert bench.until(answer.done)
        assert not answer.result().success
    assert cell.node.state == "active"
    assert cell.give(Q) is not None


# An extended calibration

GAP = 4e-4  # [rad]


def extended(desk: CalibrationSession, folder: Path, effects: Effects) -> Path:
    """A calibration file with effects."""
    path = folder / "extended.yaml"
    save_calibration(
        path, with_effects(desk.fitted.found, ROBOT, effects), ROBOT, desk.fitted.poses
    )
    return path


def come(cell: Cell, begin: np.ndarray, stamp_ns: int) -> np.ndarray:
    """Correction at Q after a move from `begin` and a moment at rest."""
    way = [begin + share * (Q - begin) for share in np.linspace(0.0, 1.0, 6)] + [Q] * 3
    for k, q in enumerate(way):
        out = cell.give(q, stamp_ns + k * 20_000_000)
    return positions(out) - Q


def test_a_play_in_the_calibration_is_corrected_by_the_way_the_joints_came(
    bench: Bench, desk: CalibrationSession, tmp_path: Path
) -> None:
    cycle: dict[str, object] = {"period": 900.0}
    effects: Effects = {"backlash": ({}, GAP), "joint_zero_drift": (cycle, 1e-3)}
    cell = Cell(bench, calibration=extended(desk, tmp_path, effects), ramp_s=0.0)
    assert cell.value("effects compensated") == "backlash"
    assert cell.value("effects left out").startswith(
        "joint_zero_drift: found in the session but not"
    )
    inward = -np.sign(Q) * 0.02  # inside the region
    yes, _ = cell.call("enable", True)
    assert yes
    unknown = positions(cell.give(Q, T0_NS)) - Q
    outward = come(cell, Q + inward, T0_NS + 10**9)
    cell.give(Q + inward, T0_NS + 2 * 10**9)
    back = come(cell, Q - inward, T0_NS + 3 * 10**9)
    np.testing.assert_allclose(outward - back, GAP * np.sign(-inward), atol=1e-7)
    np.testing.assert_allclose(unknown, (outward + back) / 2, atol=1e-7)
    cell.node.trigger_deactivate()
    cell.node.trigger_activate()  # it may have been moved in the meantime
    assert cell.call("enable", True)[0]
    np.testing.assert_allclose(positions(cell.give(Q, T0_NS)) - Q, unknown, atol=1e-7)


def test_a_correction_that_steps_is_held_to_the_rate_of_the_parameter(
    bench: Bench, desk: CalibrationSession, tmp_path: Path
) -> None:
    path = extended(desk, tmp_path, {"backlash": ({}, GAP)})
    cell = Cell(bench, calibration=path, ramp_s=0.0)
    assert cell.call("enable", True)[0]
    inward = -np.sign(Q) * 0.02
    before = come(cell, Q + inward, T0_NS)
    cell.node.set_parameters([Parameter("max_correction_rate", value=1e-4)])
    turned = positions(cell.give(Q + 0.1 * inward, T0_NS + 10**9)) - (Q + 0.1 * inward)
    free = GAP / 2 * np.ones(3)
    assert (np.abs(turned - before) < free).all()  # 0.2 mrad take 2 s, the next command 1 s
    cell.node.set_parameters([Parameter("max_correction_rate", value=100.0)])
    bench.spin_for(0.05)
    turned = positions(cell.give(Q + 0.1 * inward, T0_NS + 2 * 10**9)) - (Q + 0.1 * inward)
    assert (np.abs(turned - before) > free).all()


def test_what_a_model_needs_to_know_is_asked_for_on_diagnostics(
    bench: Bench, desk: CalibrationSession, tmp_path: Path
) -> None:
    effects: Effects = {
        "joint_compliance": ({}, 4e-5),
        "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),
    }
    cell = Cell(bench, calibration=extended(desk, tmp_path, effects), ramp_s=0.0)
    assert cell.call("enable", True)[0]
    np.testing.assert_array_equal(positions(cell.give(Q)), Q)
    said = "the payload is not known; the temperature of part 'arm' is not known"
    assert cell.diagnosed(said)
    carried = cell.world.create_publisher(InertiaStamped, "cell/payload", PAYLOAD)
    warm = cell.world.create_publisher(Temperature, "cell/temperature", STREAM_OUT)
    assert bench.until(lambda: carried.get_subscription_count() and warm.get_subscription_count())
    arm = Temperature(temperature=30.0)
    arm.header.frame_id = "arm"
    corrections = []
    for mass in (0.0, 3.0):
        load = InertiaStamped()
        load.inertia.m = mass
        carried.publish(load)
        warm.publish(arm)
        bench.spin_for(0.3)
        corrections.append(positions(cell.give(Q)) - Q)
    assert (corrections[1] < corrections[0] - CLEARLY).all()  # a smaller angle is a higher arm
    cell.node.set_parameters(
        [Parameter("temperature_timeout_s", value=1.0), Parameter("on_failure", value="hold")]
    )
    bench.spin_for(1.2)
    held = positions(cell.give(Q + 1e-3))
    np.testing.assert_allclose(held, Q + corrections[1], atol=1e-12)
    assert cell.diagnosed("the temperature of part 'arm' is not known")


def test_a_timeout_lets_nothing_pass_whose_age_is_not_known_or_cannot_be(bench: Bench) -> None:
    """Such as simulated time without `/clock`, and a stamp far in the future."""
    cell = Cell(bench, command_timeout_s=0.5, use_sim_time=True)
    assert cell.give(Q) is None
    assert cell.diagnosed("use_sim_time is set and there is no /clock")
    assert cell.give(Q, 0) is None  # no stamp, and no clock
    cell.node.set_parameters([Parameter("use_sim_time", value=False)])
    now_ns = time.time_ns()
    assert cell.give(Q, now_ns + 1000 * 10**9) is None
    assert cell.diagnosed("ahead of the node's clock")
    np.testing.assert_array_equal(positions(cell.give(Q, time.time_ns())), Q)


def test_a_watch_is_told_on_diagnostics(bench: Bench, file: Path) -> None:
    cell = Cell(bench, calibration=file, watch_false_alarms=0.1)
    assert cell.value("watch") == "as calibrated"
    assert cell.value("watch stops examined") == "0"
    trouble = "the machine is no longer what was calibrated"
    vigil = cell.node._desk.watchman._vigil
    vigil.suspicion = replace(vigil.suspicion, odds=vigil.suspicion.limit + 1.0)
    assert cell.diagnosed(trouble)
    assert cell.call("reload")[0]  # the watch starts again
    assert cell.value("watch") == "as calibrated"


def test_no_watch_is_kept_where_none_is_asked_for(bench: Bench, file: Path) -> None:
    assert Cell(bench, calibration=file).value("watch") == "off"
