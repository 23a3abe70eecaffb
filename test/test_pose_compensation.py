"""Compensation of robots that are commanded by poses: position and rotation of the tool."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import save_calibration
from delta_calibration.cli.main import run
from delta_calibration.compensation import CommandStatus, JointCompensator, backward_kernel
from delta_calibration.compensation.machine import drawn
from delta_calibration.compensation.task_coordinates import LEVER
from delta_calibration.data import collect
from delta_calibration.errors import InputError, ReachError
from delta_calibration.estimation import identify
from delta_calibration.geometry import rotations
from delta_calibration.plans import (
    make_plan,
    nominal_joints,
    read_plan,
    read_targets,
    require_borne,
    write_plan,
)
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import (
    TrueMachine,
    draw_machine,
    effect_options,
    simulate_session,
    standing,
)

POSES = ("cdpr8", "five_axis", "scara", "ur10")
TURNS = ("cdpr8", "five_axis", "ur10")


def known(machine: TrueMachine) -> Calibration:
    """A calibration equal to the true machine, valid in a region of 20 m."""
    robot = machine.robot
    corners = 10.0 * (2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0)
    ends = robot.joints.lower, robot.joints.upper
    return Calibration(
        robot, machine.chain, machine.theta, Region(corners), *ends, 1e-5, "known", "seal"
    )


def places(robot: Robot, count: int = 12, seed: int = 2) -> np.ndarray:
    return make_plan("identify", robot, count=count, both_sides=False, seed=seed).joint


def tool(machine: TrueMachine, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """True position and rotation of the tool, by the chain."""
    chain = machine.chain
    x = chain.pose(standing(q), machine.theta)
    return chain.point(x, machine.tool), chain.mechanism.rotation(x)


@pytest.mark.parametrize("name", POSES)
def test_the_tool_stands_where_the_drawing_meant_it(name: str) -> None:
    robot = load_robot(name)
    machine, q = draw_machine(robot, 4), places(robot)
    nominal = TrueMachine(
        robot,
        machine.chain,
        machine.chain.join(
            robot.commanded.parameters.nominal,
            robot.tracker.reflector_offset,
            machine.chain.split(machine.theta)[2],
        ),
    )
    (meant, held), (before, _) = tool(nominal, q), tool(machine, q)
    done = JointCompensator(known(machine)).compensate(q)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    after, turned = tool(machine, done.joint)
    axes = 2 if name == "scara" else 3
    assert np.linalg.norm((before - meant)[:, :axes], axis=1).min() > 1e-6
    np.testing.assert_allclose(after[:, :axes], meant[:, :axes], atol=2e-8)
    assert done.model_error.max() < 2e-8
    if name in TURNS:
        np.testing.assert_allclose(turned, held, atol=1e-7)
        assert done.model_turn is not None
        assert done.model_turn.max() < 1e-7
    else:
        assert done.model_turn is None


def test_corrected_cables_fit_a_pose_without_a_rest() -> None:
    machine = draw_machine(load_robot("cdpr8"), 4)
    q, chain = places(machine.robot), machine.chain
    done = JointCompensator(known(machine)).compensate(q)
    geometry = chain.split(machine.theta)[0]

    def rest(joint: np.ndarray) -> float:
        x = chain.mechanism.forward(joint, geometry)
        return float(np.abs(chain.mechanism.closure(joint, x, geometry)).max())

    assert rest(q) > 1e-4  # nominal commands make the cables contradict each other
    assert rest(done.joint) < 1e-10


@pytest.mark.parametrize(
    ("name", "effect"),
    [
        ("cdpr8", "cable_elasticity:strength=3"),
        ("five_axis", "slider_pitch:strength=3"),
        ("ur10", "encoder_eccentricity:strength=3"),
    ],
)
def test_effects_take_part(name: str, effect: str) -> None:
    robot = load_robot(name)
    machine, q = draw_machine(robot, 4, 1.0, [effect_options(effect)]), places(robot)
    plain = replace(machine, chain=machine.chain.with_effects(()))
    plain = replace(plain, theta=machine.theta[plain.chain.layout.base])
    at = standing(q)
    meant, _ = tool(plain, JointCompensator(known(plain)).compensate(q, at).joint)
    done = JointCompensator(known(machine)).compensate(q, at)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    np.testing.assert_allclose(tool(machine, done.joint)[0], meant, atol=1e-6)
    left, _ = tool(machine, JointCompensator(known(plain)).compensate(q, at).joint)
    assert np.abs(left - meant).max() > 1e-5


def test_the_swarm_agrees_with_newton() -> None:
    for name in ("five_axis", "scara"):
        machine = draw_machine(load_robot(name), 4)
        q = places(machine.robot, 3)
        exact, found = (
            JointCompensator(known(machine), method).compensate(q) for method in ("newton", "apso")
        )
        assert set(found.verdicts) == {CommandStatus.CORRECTED}
        np.testing.assert_allclose(found.joint, exact.joint, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "method", "allowed"),
    [("cdpr8", "apso", "newton"), ("ur10", "table", "newton, apso"), ("scara", "table", "apso")],
)
def test_ways_that_are_not_for_a_robot_are_refused(name: str, method: str, allowed: str) -> None:
    machine = draw_machine(load_robot(name), 4)
    with pytest.raises(InputError, match=f"method '{method}' is not for robot {name}.*{allowed}"):
        JointCompensator(known(machine), method)


def test_guards_of_a_robot_that_is_turned() -> None:
    machine = draw_machine(load_robot("five_axis"), 4)
    robot, q = machine.robot, places(machine.robot, 4)
    wide = known(machine)
    near = Region.of(robot.commanded.forward(q, robot.commanded.parameters.nominal)[:, [3, 0, 1]])
    tight = replace(robot, limits=replace(robot.limits, correction=1e-7))
    singular = replace(robot, limits=replace(robot.limits, condition=1.01))
    beyond = q + np.array([0.0, 0.0, 0.0, 2.0])
    for calibration, commands, verdict in (
        (wide, beyond, CommandStatus.JOINT_LIMIT),
        (wide, np.array([[1.9, 1.1, 1.1, 0.3]]), CommandStatus.OUT_OF_REACH),
        (replace(wide, region=near), places(robot, 4, 9), CommandStatus.OUTSIDE_REGION),
        (replace(wide, robot=tight), q, CommandStatus.NOT_REACHED),
        (replace(wide, robot=singular), q, CommandStatus.SINGULAR),
        (wide, np.full_like(q, np.nan), CommandStatus.NOT_FINITE),
    ):
        done = JointCompensator(calibration).compensate(commands)
        assert verdict in done.verdicts
        bad = np.array([v is verdict for v in done.verdicts])
        assert np.isinf(done.model_error[bad]).all()
        np.testing.assert_array_equal(done.correction[bad], 0.0)


def test_slack_cables_are_told_apart_from_what_no_pull_holds() -> None:
    robot = load_robot("cdpr8")
    loose = replace(robot, dimensions=replace(robot.dimensions, pretension=0.0))
    middle, outside = np.array([[0.0, 0.0, 1.25]]), np.array([[0.0, 0.0, 3.2]])
    nominal_joints(robot, middle)
    with pytest.raises(ReachError, match=r"point 1: cable_\d is slack: -[\d.]+ N at a pretension"):
        nominal_joints(loose, middle)
    with pytest.raises(ReachError, match="point 1: no tension of the 8 cables"):
        nominal_joints(robot, outside)
    with pytest.raises(ReachError, match=r"cable_\d is slack"):  # 400 N are too little
        require_borne(robot, nominal_joints(robot, middle), "point", np.array([300.0]))
    machine = replace(draw_machine(robot, 4), robot=loose)
    q = nominal_joints(robot, middle)
    assert JointCompensator(known(machine)).compensate(q).verdicts == (CommandStatus.SLACK,)


@pytest.mark.parametrize("name", [*POSES, "srbd", "linear_delta"])
def test_places_of_a_tool(name: str) -> None:
    robot = load_robot(name)
    model, q = robot.commanded, places(robot, 3)
    offset = np.array([0.02, -0.03, 0.15])
    machine = drawn(model, offset)
    found, x = machine.stand(q)
    np.testing.assert_allclose(x, model.forward(q, model.parameters.nominal), atol=1e-12)
    rotation, points = model.rotation(x), model.points(x, offset)
    np.testing.assert_allclose(found[:, : len(machine.aim.axes)], points[:, machine.aim.axes])
    if machine.aim.turns:
        far = np.linalg.norm(points[0] - points[1])
        turn = np.linalg.norm(rotations.log(rotation[0] @ rotation[1].T))
        whole = np.hypot(far, 2 * LEVER * np.sin(turn / 2))
        assert np.linalg.norm(found[0] - found[1]) == pytest.approx(whole, rel=1e-9)


@pytest.mark.parametrize("name", [*POSES, "srbd", "linear_delta"])
def test_newtons_jacobian_is_the_slope_of_places(name: str) -> None:
    """Central differences of the positions; twelve numbers where the tool rotates."""
    robot = load_robot(name)
    model, q = robot.commanded, places(robot, 3)
    machine = drawn(model, np.array([0.02, -0.03, 0.15]))
    steps = 1e-5 * model.joint_size * np.eye(model.joints)
    moved = [machine.point(q + step) - machine.point(q - step) for step in steps]
    slope = np.stack(moved, axis=-1) / 2e-5
    own, rows = machine.compiled, machine.resting(q).rows
    room = backward_kernel.scratch(own, rows.shape[1])
    for joint, signals, expected in zip(q, rows, slope, strict=True):
        backward_kernel.begin(own, room)
        assert backward_kernel.stands(own, joint, signals, room)
        backward_kernel._slope(own, room)
        np.testing.assert_allclose(model.joint_size * room.by_q, expected, atol=1e-8)


@pytest.mark.parametrize("name", TURNS)
def test_a_plan_keeps_its_turns_in_a_file(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=6, both_sides=False, seed=3)
    write_plan(tmp_path / "plan.csv", plan, robot)
    again = read_plan(tmp_path / "plan.csv", robot, 1.0, (1.0,), 0.0)
    np.testing.assert_allclose(again.joint, plan.joint, atol=1e-6)
    np.testing.assert_allclose(again.target, plan.target, atol=1e-8)


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("scara", "x_mm,y_mm,z_mm\n300,550,5\n", "line 2: z_mm: '5' cannot be chosen"),
        ("scara", "x_mm,z_mm\n300,0\n", "column y_mm missing; expected x_mm, y_mm"),
        ("five_axis", "y_mm,z_mm,turn_x_rad\n0,1200,0.1\n", "turn_x_rad: not a known unit"),
        ("five_axis", "y_mm,z_mm,turn_z_deg\n0,1200,3\n", "turn_z_deg: '3' cannot be chosen"),
        ("ur10", "x_m,y_m,z_m\n0,0,0\n", "column x_mm, y_mm, z_mm missing"),
        ("srbd", "x_mm,y_mm,z_mm,turn_x_deg\n0,0,-711,2\n", "turn_x_deg: '2' cannot be chosen"),
        ("cdpr8", "x_mm,y_mm,z_mm,turn_z_deg\n0,0,1250,nan\n", "turn_z_deg: 'nan' is not"),
    ],
)
def test_targets_that_cannot_be(name: str, text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read_targets(written(tmp_path / "targets.csv", text), load_robot(name))


def test_targets_out_of_reach_are_named(tmp_path: Path) -> None:
    for name, text, said in (
        ("five_axis", "y_mm,z_mm\n0,1200\n900,1200\n", r"point 2 \(0, 0.9, 1.2 m\) is out of"),
        ("five_axis", "y_mm,z_mm\n0,2200\n", r"point 1 needs .* mm for slider_"),
        ("scara", "x_mm,y_mm\n1100,0\n", r"point 1 \(1.1, 0, 0 m\) is out of"),
    ):
        with pytest.raises(ReachError, match=said):
            read_targets(written(tmp_path / "targets.csv", text), load_robot(name))


def test_turns_are_written_with_their_error(tmp_path: Path, capsys) -> None:
    robot = load_robot("five_axis")
    plan = make_plan("identify", robot, count=20, dwell=0.4, both_sides=False)
    poses = collect(simulate_session(draw_machine(robot, 5), plan, 5), robot.joints.names)
    save_calibration(tmp_path / "c.yaml", identify(poses, robot), robot, poses)
    targets = written(
        tmp_path / "targets.csv", "y_mm,z_mm,turn_x_deg,turn_y_deg\n10,1200,3,-4\n0,1210,0,0\n"
    )
    order = ["compensate", "--robot", "five_axis", "--calibration", str(tmp_path / "c.yaml")]
    assert run([*order, str(targets), "--out", str(tmp_path / "out.csv")]) == 0
    assert "mrad" in capsys.readouterr().out
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    names = [f"slider_{k}_mm" for k in range(1, 5)]
    nominal = [f"nominal_{name}" for name in names]
    came = ["y_mm", "z_mm", "turn_x_deg", "turn_y_deg"]
    said = ["status", "u95_mm", "error_mm", "error_mrad"]
    assert list(rows[0]) == [*came, *nominal, *names, *said]
    assert max(float(row["error_mrad"]) for row in rows) < 1e-4
    joint = np.array([[float(row[name]) for name in names] for row in rows]) * 1e-3
    off = np.abs(joint - read_targets(targets, robot).joint).max()
    assert 1e-6 < off < robot.limits.correction


def test_readings_become_tool_points_with_the_turn_that_pulleys_give_the_platform() -> None:
    """Of a reflector 0.2 m off the tool; that turn had been neglected."""
    robot = load_robot("cdpr8")
    machine = draw_machine(robot, 4, hidden=[effect_options("pulley_radius:value=0.03")])
    theta = machine.theta.copy()
    theta[machine.chain.layout.offset] += [0.2, 0.0, 0.1]
    machine, q = replace(machine, theta=theta), places(robot)
    readings = machine.reflector_points(standing(q))
    tool = machine.tool_points(standing(q))
    made = known(machine)
    np.testing.assert_allclose(made.tool_points(readings, q), tool, atol=1e-9)
    bare = machine.chain.mechanism.forward(q, made.geometry)  # no pulleys
    turned = machine.chain.mechanism.rotation(bare) - machine.chain.mechanism.rotation(
        machine.chain.pose(standing(q), theta)
    )
    assert np.abs(turned @ [0.2, 0.0, 0.1]).max() > 5e-5
