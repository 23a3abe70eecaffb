"""Computed plans of all robots: reachable poses in the right assembly mode, with their loads."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import (
    Plan,
    legs,
    make_plan,
    nominal_joints,
    read_targets,
    require_limits,
    tool_frames,
    tool_points,
)
from delta_calibration.plans.optimal import candidates, optimal_plan
from delta_calibration.plans.parting import part
from delta_calibration.robot import Robot, known_robots, load_robot

ROOM = 1e-9
CAUSES = {
    "cdpr8": "drum_scale",
    "five_axis": "slider_pitch",
    "linear_delta": "slider_pitch",
    "scara": "reducer_compliance",
    "srbd": "backlash",
    "ur10": "gravity_sag",
}


def require_possible(robot: Robot, plan: Plan) -> None:
    """Require limits, workspace, and the assembly mode of the nominal machine."""
    joint, model, nominal = plan.joint, robot.commanded, robot.commanded.parameters.nominal
    assert (joint > robot.joints.lower).all()
    assert (joint < robot.joints.upper).all()
    x = model.forward(joint, nominal)
    assert np.abs(model.closure(joint, x, nominal)).max() < 1e-9
    back = model.inverse(x[:, : model.task_size], nominal)
    np.testing.assert_allclose(back, joint, atol=1e-7)
    assert (model.condition(joint, x, nominal) < robot.limits.condition).all()
    if robot.workspace is None:
        return
    box = robot.workspace
    point, turn = tool_frames(robot, joint)
    commanded = [k for k in range(3) if k in robot.commanded.freedoms]
    off = np.abs(point - box.centre)[:, commanded]
    assert (off <= box.size[commanded] / 2 + ROOM).all()
    commanded = [k - 3 for k in robot.commanded.freedoms if k > 2]
    assert (np.abs(turn[:, commanded]) <= box.turn + ROOM).all()


@pytest.mark.parametrize("name", known_robots())
def test_the_poses_to_identify_by_are_possible(name: str) -> None:
    robot = load_robot(name)
    best = optimal_plan(robot, 10, seed=2)
    require_possible(robot, best.plan)
    assert best.log_det > best.random_log_det + 5


@pytest.mark.parametrize("name", known_robots())
def test_a_circle_test_is_possible_within_ten_minutes(name: str) -> None:
    """Each circle is complete, in both directions at two feeds, with one radius per plane."""
    robot = load_robot(name)
    plan = make_plan("circles", robot)
    require_possible(robot, plan)
    assert sum(leg.time[-1] for leg in legs(plan, robot, 20.0)) < 600.0
    planes = {"scara": ["xy"], "five_axis": ["yz"]}.get(name, ["xy", "xz", "yz"])
    assert sorted({path.name.split("_")[1] for path in plan.paths}) == planes
    for path in plan.paths:
        require_limits(robot, path.joint, path.name)
        point = tool_points(robot, path.joint)
        axes = ["xyz".index(axis) for axis in path.name.split("_")[1]]
        out = (point - (point.min(axis=0) + point.max(axis=0)) / 2)[:, axes]
        assert np.ptp(np.linalg.norm(out, axis=1)) < 1e-5
        turn = np.ptp(np.unwrap(np.arctan2(*out.T)))
        assert np.degrees(turn) == pytest.approx(420.0, abs=1.0)
    names = [path.name for path in plan.paths]
    for plane in planes:
        for feed in ("18_s", "6_s"):
            assert f"circle_{plane}_clockwise_{feed}" in names
            assert f"circle_{plane}_anticlockwise_{feed}" in names


def test_a_circle_test_that_cannot_be_driven_is_refused() -> None:
    robot = load_robot("srbd")
    narrow = replace(robot, joints=replace(robot.joints, upper=robot.joints.lower + 0.1))
    with pytest.raises(
        InputError, match="plan circles: no circle of 45 mm or more about 0, 0, -761"
    ):
        make_plan("circles", narrow)


@pytest.mark.parametrize("name", known_robots())
def test_the_poses_that_part_two_causes_are_possible(name: str) -> None:
    robot = load_robot(name)
    parted = part(robot, (CAUSES[name], "geometry"), 10, seed=2)
    require_possible(robot, parted.plan)
    for path in parted.plan.paths:
        assert np.isfinite(tool_frames(robot, path.joint)[0]).all()


@pytest.mark.parametrize("name", ["five_axis", "ur10", "scara"])
def test_without_a_workspace_poses_are_put_together_as_at_home(name: str) -> None:
    """Poses cover the joint ranges, except those reached in another assembly mode.

    Here the assembly mode is followed by the velocity Jacobian, in steps much finer than the
    plan's.
    """
    robot = replace(load_robot(name), workspace=None)
    joint = candidates(robot, 40, None, np.random.default_rng(1))
    model, nominal = robot.commanded, robot.commanded.parameters.nominal
    x = model.forward(joint, nominal)
    np.testing.assert_allclose(model.inverse(x[:, : model.task_size], nominal), joint, atol=1e-7)
    assert np.abs(tool_frames(robot, joint)[1]).max() <= np.pi + ROOM
    if name == "five_axis":  # the others have forward kinematics in closed form
        way = np.linspace(robot.commanded.home, joint, 1001)
        y = np.tile(model.forward(way[0, :1], nominal), (len(joint), 1))
        for here, there in pairwise(way):
            slope = model.velocity_jacobian((here + there) / 2, y, nominal)
            y = y + (slope @ (there - here)[..., None])[..., 0]
        assert np.abs(y - x).max() < 0.01  # error of the steps


def test_joints_that_cannot_move_alone_need_a_workspace() -> None:
    robot = replace(load_robot("cdpr8"), workspace=None)
    with pytest.raises(InputError, match=r"cdpr8.yaml: poses are selected in its"):
        candidates(robot, 10, None, np.random.default_rng(1))


def test_a_turn_of_another_assembly_mode_is_out_of_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight cables with the lengths for this pose hold the platform in another pose."""
    file = tmp_path / "turned.csv"
    file.write_text("x_mm,y_mm,z_mm,turn_x_deg\n0,0,1250,180\n")
    with pytest.raises(ReachError, match=r"point 1 \(.*, 180, 0, 0 m and degrees\) is out"):
        read_targets(file, load_robot("cdpr8"))
    order = ["simulate", "--robot", "cdpr8", "--plan", str(file), "--out", str(tmp_path / "s")]
    assert run(order) == 1
    assert "is out of the robot's reach" in capsys.readouterr().err


# Loads on the platform of a cable robot

HEAVY = 150.0  # [kg] with 400 N of pretension some cables become slack


def test_cables_are_taut_with_the_load_of_each_line(tmp_path: Path) -> None:
    robot, file = load_robot("cdpr8"), tmp_path / "plan.csv"
    file.write_text("x_mm,y_mm,z_mm,payload_kg\n0,0,1250,0\n0,0,1250,300\n")
    with pytest.raises(ReachError, match=r"point 2: cable_\d is slack"):
        make_plan(str(file), robot)
    file.write_text("x_mm,y_mm,z_mm\n0,0,1250\n")
    assert len(make_plan(str(file), robot)) == 2
    with pytest.raises(ReachError, match=r"point 1: cable_\d is slack"):
        make_plan(str(file), robot, payload=300.0)


def test_a_load_may_be_what_holds_cables_taut(tmp_path: Path) -> None:
    """All cables come from above, and a weightless platform is held by its load."""
    robot = load_robot("cdpr8")
    anchors = robot.dimensions.anchors.copy()
    anchors[:, 2] = 2500.0e-3
    hung = replace(robot.dimensions, anchors=anchors, pretension=0.0)
    light = replace(robot, dimensions=hung, masses=replace(robot.masses, platform=1e-6))
    middle = np.array([[0.0, 0.0, 1.25]])
    with pytest.raises(ReachError, match=r"slack|no pull"):
        nominal_joints(replace(light, masses=replace(robot.masses, platform=0.0)), middle)
    assert np.isfinite(nominal_joints(light, middle, payload=10.0)).all()


def test_a_path_is_driven_with_what_the_last_stop_had(tmp_path: Path) -> None:
    robot, file = load_robot("cdpr8"), tmp_path / "plan.csv"
    head = "x_mm,y_mm,z_mm,payload_kg,path,duration_s\n"
    way = "0,0,1250,{0},way,2\n300,0,1250,{0},way,2\n"
    file.write_text(head + "0,0,1250,20,,\n" + way.format(""))
    assert len(make_plan(str(file), robot).paths) == 1
    file.write_text(head + "0,0,1250,20,,\n" + way.format(30))
    with pytest.raises(InputError, match="line 3: payload_kg: '30' differs from the 20 of the l"):
        make_plan(str(file), robot)


def test_paths_and_loaded_stops_of_a_named_plan_are_looked_at() -> None:
    robot = load_robot("cdpr8")
    assert len(make_plan("rich", robot, count=4, payload=5.0))
    with pytest.raises(ReachError, match=r"cable_\d is slack"):
        make_plan("rich", robot, count=4, payload=HEAVY)


def test_the_poses_of_a_contrast_bear_its_load() -> None:
    robot = load_robot("cdpr8")
    payload, rng = 60.0, np.random.default_rng
    loaded = candidates(robot, 200, None, rng(1), (0.0, payload))
    assert not np.array_equal(loaded, candidates(robot, 200, None, rng(1)))
    point, turn = tool_frames(robot, loaded)
    nominal_joints(robot, point, turn, payload)
    with pytest.raises(InputError, match="lie within the limits with 5000 kg; choose"):
        candidates(robot, 200, None, rng(1), (0.0, 5000.0))


# Equal results alone and in a batch


def test_one_target_out_of_reach_leaves_the_others_of_a_batch_as_they_are_alone() -> None:
    robot = load_robot("ur10")
    model, nominal = robot.commanded, robot.commanded.parameters.nominal
    task = np.tile(model.forward(robot.commanded.home[None], nominal), (100, 1))
    task[:, 0] += np.linspace(-0.05, 0.05, 100)
    task[7, 0] = 9.0
    joint = model.inverse(task, nominal)
    assert np.isnan(joint[7]).all()
    assert np.isfinite(np.delete(joint, 7, axis=0)).all()
    alone = np.concatenate([model.inverse(row[None], nominal) for row in task])
    np.testing.assert_allclose(joint, alone, atol=1e-12)
