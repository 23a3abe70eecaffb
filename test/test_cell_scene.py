"""Tests of the markers: errors, workspace, region, places where guards acted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.command_path import HOLD, CommandPath
from delta_calibration.cell.guard_trail import FADED, HELD, PASSED, GuardTrail
from delta_calibration.cell.scene import Drawing, Errors, Kind, errors, scene, workspace
from delta_calibration.cell.task import Task
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import collect
from delta_calibration.plans import make_plan, nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")
MACHINE = draw_machine(ROBOT, 5)
PLAN = make_plan("identify", ROBOT, count=15, dwell=0.4)


@pytest.fixture(scope="module", name="session")
def session_fixture() -> Any:
    return simulate_session(MACHINE, PLAN, 5)


@pytest.fixture(scope="module", name="desk")
def desk_fixture(session: Any) -> CalibrationSession:
    desk = CalibrationSession(Settings("srbd", model="rotary_delta"))
    desk.start_capture(0.0)
    for k, stamp in enumerate(session.states.stamp_ns.tolist()):
        desk.capture.add_command(stamp, session.command.position[k])
        desk.capture.add_states(stamp, session.states.position[k])
        desk.capture.add_tracker(stamp, session.tracker.position[k])
    desk.take(*desk.prepare_fit()())
    return desk


def named(drawings: Any, name: str) -> Drawing:
    (found,) = (drawing for drawing in drawings if drawing.name == name)
    return found


def test_error_vectors_go_from_where_it_was_meant_to_be_to_where_it_is(
    desk: CalibrationSession,
) -> None:
    """The drawn errors are compared with the machine's true ones, unknown to the fit."""
    drawings = scene(ROBOT, desk.calibration, desk.fitted, 100.0)
    lines = named(drawings, "error measured")
    start, tip = lines.points[::2], lines.points[1::2]
    dots = named(drawings, "nominal").points
    np.testing.assert_array_equal(dots, start)
    poses = desk.fitted.poses
    assert len(start) == len(poses) == 2 * 15
    nearest = np.linalg.norm(dots[:, None] - PLAN.target, axis=-1).min(axis=1)
    assert nearest.max() < 1e-6
    # The frame is fitted: what counts is the machine's error after the best rigid motion.
    assert 0.1e-3 < np.linalg.norm(tip - start, axis=1).mean() / 100.0 < 5e-3
    model = named(drawings, "error calibrated")
    apart = np.linalg.norm(model.points[1::2] - tip, axis=1) / 100.0
    assert np.sqrt(np.mean(apart**2)) < 0.1e-3  # the fit explains them
    assert np.linalg.norm(tip - start, axis=1).mean() / 100.0 > 3 * apart.mean()


def test_the_scale_draws_errors_longer_and_zero_not_at_all() -> None:
    meant = np.array([[0.1, 0.2, -0.7], [0.0, 0.0, -0.7]])
    off = np.array([[1e-3, 0.0, 0.0], [0.0, -2e-3, 0.0]])
    seen = Errors(meant, meant, meant + off)
    tips = named(errors(seen, 50.0), "error measured").points[1::2]
    np.testing.assert_allclose(tips, [[0.15, 0.2, -0.7], [0.0, -0.1, -0.7]])
    none = named(errors(seen, 0.0), "error measured").points
    np.testing.assert_array_equal(none[::2], none[1::2])


def test_poses_out_of_reach_are_left_out_and_many_thinned() -> None:
    meant = np.arange(3000.0).reshape(-1, 3)
    meant[7] = np.nan
    drawings = errors(Errors(meant, meant, meant), 1.0)
    dots = named(drawings, "nominal").points
    assert 200 < len(dots) <= 300
    assert np.isfinite(dots).all()
    assert not len(named(errors(Errors(*3 * (meant[7:8],)), 1.0), "nominal").points)


def test_a_calibration_that_was_loaded_draws_the_errors_that_it_expects(
    desk: CalibrationSession,
) -> None:
    """At places of the region; compared with the identified model, solved by the closure."""
    other = replace(desk.calibration, source="another")
    drawings = scene(ROBOT, other, desk.fitted, 100.0)
    names = {drawing.name for drawing in drawings}
    assert names == {"workspace", "region", "region edges", "nominal", "error calibrated"}
    lines = named(drawings, "error calibrated").points
    meant, tips = lines[::2], lines[1::2]
    assert (other.region.outside(meant) < 1e-6).all()
    expected = meant + (tips - meant) / 100.0
    q, model = nominal_joints(ROBOT, meant), other.chain.mechanism
    assert np.abs(model.closure(q, expected, other.geometry)).max() < 1e-9
    assert np.linalg.norm(expected - meant, axis=1).max() > 0.1e-3
    assert {d.name for d in scene(ROBOT, None, None, 100.0)} == {"workspace"}


def test_the_region_is_the_hull_that_guards_go_by(desk: CalibrationSession) -> None:
    held = desk.calibration.region
    faces = named(scene(ROBOT, desk.calibration, None, 1.0), "region").points
    assert np.abs(held.outside(faces)).max() < 1e-6  # all on the boundary
    middles = faces.reshape(-1, 3, 3).mean(axis=1)
    assert np.abs(held.outside(middles)).max() < 1e-6
    assert {tuple(v) for v in faces} == {tuple(v) for v in held.vertices}


def test_the_workspace_is_the_file_s_box_or_what_plans_of_a_delta_cover() -> None:
    box = load_robot("linear_delta").workspace
    points = workspace(load_robot("linear_delta")).points
    assert points.shape == (24, 3)
    np.testing.assert_allclose(points.min(axis=0), box.centre - box.size / 2)
    np.testing.assert_allclose(points.max(axis=0), box.centre + box.size / 2)
    sides = np.linalg.norm(points[::2] - points[1::2], axis=1)
    np.testing.assert_allclose(np.sort(sides), np.sort(np.repeat(box.size, 4)))
    points = workspace(ROBOT).points
    covered = make_plan("identify", ROBOT, count=60).target
    reach = np.linalg.norm(covered[:, :2], axis=1).max()
    assert np.linalg.norm(points[:, :2], axis=1).max() == pytest.approx(reach, rel=0.05)
    assert points[:, 2].min() <= covered[:, 2].min()
    assert points[:, 2].max() >= covered[:, 2].max()


def enabled(desk: CalibrationSession, on_failure: str) -> CommandPath:
    path = CommandPath(on_failure, 0.0)
    path.load(JointCompensator(desk.calibration))
    path.enable(True)
    return path


def drive(path: CommandPath, trail: GuardTrail, points: np.ndarray) -> None:
    for k, q in enumerate(nominal_joints(ROBOT, points)):
        path.send(q, k + 1, 0.01 * k)
        trail.see(q, path)


@pytest.mark.parametrize(("on_failure", "act"), [("pass_through", PASSED), (HOLD, HELD)])
def test_guards_are_seen_where_they_acted(
    desk: CalibrationSession, on_failure: str, act: str
) -> None:
    """Outwards from the region: corrected, blended out on its margin, then not corrected."""
    # 5 mm apart, like the cells of which one point each is kept, and not on their edges.
    way = np.linspace([0.0, 0.0, -0.711], [0.66, 0.0, -0.711], 133) + 0.002
    trail = GuardTrail()
    drive(enabled(desk, on_failure), trail, way)
    assert trail.placed(ROBOT)
    found = {drawing.name: drawing for drawing in trail.drawings()}
    assert set(found) == {f"guard: {FADED}", f"guard: {act}"}
    outside = desk.calibration.region.outside(way)
    margin = ROBOT.limits.region_margin
    faded = way[(outside > 0) & (outside < margin)]
    left = way[outside >= margin]
    np.testing.assert_allclose(found[f"guard: {FADED}"].points, faded, atol=1e-9)
    np.testing.assert_allclose(found[f"guard: {act}"].points, left, atol=1e-9)
    assert found[f"guard: {FADED}"].size != found[f"guard: {act}"].size
    assert not trail.placed(ROBOT)  # nothing new
    trail.clear()
    assert trail.drawings() == ()


def test_commands_that_nothing_happened_to_leave_no_trail(desk: CalibrationSession) -> None:
    trail = GuardTrail()
    path = enabled(desk, HOLD)
    drive(path, trail, np.linspace([0.0, 0.0, -0.711], [0.1, 0.0, -0.711], 20))
    q = nominal_joints(ROBOT, np.array([[0.0, 0.1, -0.711]]))[0]
    path.send(q, 1, 1.0, already=True)
    trail.see(q, path)
    path.send(np.full(3, np.nan), 2, 1.0)
    trail.see(np.full(3, np.nan), path)
    assert not trail.placed(ROBOT)
    assert trail.drawings() == ()


def test_one_place_is_one_dot_and_old_ones_go() -> None:
    path, trail = CommandPath(), GuardTrail()
    path.trouble = "outside the calibrated region"
    rng = np.random.default_rng(0)
    for _ in range(10):
        for q in rng.uniform(-0.3, 0.6, (150, 3)):
            trail.see(q, path)
            trail.see(q, path)
        trail.placed(ROBOT)
    (dots,) = trail.drawings()
    assert dots.kind is Kind.DOTS
    assert len(dots.points) == 500
    assert len(np.unique(dots.points, axis=0)) == 500


def test_a_task_says_its_step() -> None:
    task = Task("fit", ("still moments", "geometry", "compensator"), 10.0)
    assert task.sentence() == "still moments, step 1 of 3"
    task.begin("geometry")
    values = task.values(12.5)
    assert values["step"] == "geometry"
    assert values["done [%]"] == "33"
    assert values["elapsed [s]"] == "2.5"


def test_a_fit_tells_its_steps_in_order(desk: CalibrationSession, session: Any) -> None:
    from delta_calibration.cell.fitting import FIT_STEPS

    told: list[str] = []
    desk.prepare_fit(step=told.append)()
    assert tuple(told) == FIT_STEPS
    assert len(collect(session, ROBOT.joints.names)) == len(desk.fitted.poses)
