"""Plans contain reachable poses, and their motion respects the limits of the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import legs, make_plan
from delta_calibration.robot import load_robot
from six_rods import SixRods

ROBOT = load_robot("srbd")
NAMES = ("line", "disc", "iso9283", "identify", "circles", "rich")
RATE = 50.0


@pytest.fixture(scope="module", params=NAMES)
def plan(request):
    return make_plan(request.param, ROBOT, count=12, dwell=0.4)


def test_stops_are_the_drawings_joints_within_the_limits(plan):
    np.testing.assert_allclose(SixRods().point(plan.joint), plan.target, atol=1e-9)
    assert (plan.joint >= ROBOT.joints.lower).all()
    assert (plan.joint <= ROBOT.joints.upper).all()
    assert len(plan.target) == len(plan.direction) == len(plan.payload) == len(plan)
    assert set(plan.direction) <= {1.0, -1.0}


def test_motion_is_continuous_within_limits_and_comes_from_the_side_it_says(plan):
    """No step, within a leg or between legs, exceeds the speed in the robot file."""
    last, count = plan.joint[0], 0
    for leg in legs(plan, ROBOT, RATE):
        steps = np.diff(np.vstack([last, leg.joint]), axis=0)
        assert np.abs(steps).max() * RATE <= ROBOT.joints.speed * (1 + 1e-9)
        assert (leg.joint >= ROBOT.joints.lower - 1e-12).all()
        assert (leg.joint <= ROBOT.joints.upper + 1e-12).all()
        np.testing.assert_allclose(np.diff(leg.time), 1 / RATE)
        rest = leg.joint[leg.resting]
        assert np.ptp(rest, axis=0).max() == 0
        assert (len(rest) - 1) / RATE >= plan.dwell - 1e-9
        if count < len(plan):
            np.testing.assert_array_equal(rest[0], plan.joint[count])
            into = rest[0] - leg.joint[~leg.resting][-1]
            assert (np.sign(into) == plan.direction[count]).all()
            assert leg.payload == plan.payload[count]
        last, count = leg.joint[-1], count + 1
    assert count == len(plan) + 2 * len(plan.paths)


def test_both_sides_or_one():
    both, one = (make_plan("disc", ROBOT, count=7, both_sides=b) for b in (True, False))
    assert both.direction.tolist() == [1, -1] * 7
    assert one.direction.tolist() == [1] * 7
    np.testing.assert_array_equal(both.target[::2], one.target)
    np.testing.assert_array_equal(both.target[1::2], one.target)


def test_line_and_disc_are_the_papers():
    line = make_plan("line", ROBOT, both_sides=False).target
    assert len(line) == 61
    np.testing.assert_allclose(
        line[[0, 30, 60]], [[-0.45, 0.45, -0.711], [0, 0, -0.711], [0.45, -0.45, -0.711]]
    )
    disc = make_plan("disc", ROBOT, count=400, both_sides=False).target
    radius = np.hypot(disc[:, 0], disc[:, 1])
    assert radius.max() < 0.45
    assert np.mean(radius < 0.45 / np.sqrt(2)) == pytest.approx(0.5, abs=0.02)  # uniform in area


def test_iso_poses_come_in_cycles_from_one_side():
    plan = make_plan("iso9283", ROBOT, count=4)
    cycle = plan.target[:5]
    np.testing.assert_array_equal(plan.target, np.tile(cycle, (4, 1)))
    assert (plan.direction == 1).all()
    middle = cycle[4]  # the order is P5, P4, P3, P2, P1
    np.testing.assert_allclose(cycle[:4].mean(axis=0), middle, atol=1e-12)
    corners = 0.4 * 0.3 * np.sqrt(3) * np.ones(4)  # 80 % of half the diagonal of the cube
    np.testing.assert_allclose(np.linalg.norm(cycle[:4] - middle, axis=1), corners)
    assert [path.name for path in plan.paths] == ["line", "circle"]
    assert len(make_plan("iso9283", ROBOT)) == 150


def test_rich_has_all_a_diagnosis_wants():
    plan = make_plan("rich", ROBOT)
    assert len(plan) == 190
    kinds, times = np.unique(
        np.column_stack([plan.target, plan.direction, plan.payload]), axis=0, return_counts=True
    )
    assert len(kinds) == 40 * 2 * 2
    assert sorted(times) == [1] * 150 + [4] * 10
    assert sorted(set(plan.payload)) == [0.0, 2.0]
    assert np.count_nonzero(np.diff(plan.payload)) == 3
    order = np.arange(190)
    assert abs(np.corrcoef(order, plan.target[:, 0])[0, 1]) < 0.3  # shuffled in time
    assert abs(np.corrcoef(order, plan.direction)[0, 1]) < 0.3
    names = [path.name for path in plan.paths]
    assert [n for n in names if n.startswith("sweep")] == [f"sweep_joint_{k}" for k in (1, 2, 3)]
    assert sum(n.startswith("circle") for n in names) == 6
    for path in plan.paths[:3]:  # a sweep moves one joint slowly there and back
        moved = np.ptp(path.joint, axis=0)
        assert np.count_nonzero(moved > 1e-12) == 1
        assert 2 * moved.max() / path.duration < 0.05
    there, back = plan.paths[3], plan.paths[4]
    np.testing.assert_array_equal(there.joint, back.joint[::-1])


def test_identify_covers_the_papers_line_and_the_seed_decides():
    from scipy.spatial import Delaunay

    plans = [make_plan("identify", ROBOT, seed=seed, both_sides=False) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(plans[0].target, plans[1].target)
    assert np.abs(plans[0].target - plans[2].target).max() > 0.01
    hull = Delaunay(plans[0].target)
    assert (hull.find_simplex(make_plan("line", ROBOT).target) >= 0).all()


def test_a_short_way_in_is_kept_within_the_limits():
    """A stop at the limit of a joint, approached from beyond that limit."""
    plan = make_plan("line", ROBOT, count=1)
    edge = replace(plan, joint=np.tile(ROBOT.joints.upper, (2, 1)))
    for leg in legs(edge, ROBOT, RATE):
        assert (leg.joint <= ROBOT.joints.upper).all()


def test_paths_keep_their_time_and_slow_down_where_a_joint_is_too_slow_for_them():
    plan = make_plan("rich", ROBOT, count=2, dwell=0.0)
    slow = replace(ROBOT, joints=replace(ROBOT.joints, speed=0.1))
    for robot, quickest in ((ROBOT, 2.5), (slow, 10.0)):
        ways = list(legs(plan, robot, RATE))[len(plan) + 1 :: 2]
        assert len(ways) == len(plan.paths)
        last = ways[-1]
        moving = last.joint
        assert np.abs(np.diff(moving, axis=0)).max() * RATE <= robot.joints.speed * (1 + 1e-9)
        assert np.count_nonzero(~last.resting) / RATE >= quickest
        assert ways[0].time[-1] == pytest.approx(40.0, abs=2 / RATE)  # a sweep is slow enough


def test_sweeps_beyond_the_limits_are_refused():
    upper = np.array([0.3, 1.7, 1.7])
    narrow = replace(ROBOT, joints=replace(ROBOT.joints, upper=upper))
    said = r"sweep_joint_1: sample \d+ needs 17\.\d+ degrees for joint_1"
    with pytest.raises(ReachError, match=said):
        make_plan("rich", narrow, count=1, radius=0.02)


# CSV files and refusals


def csv_plan(tmp_path, text, name="points.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode("utf-8"))
    return make_plan(str(path), ROBOT)


@pytest.mark.parametrize(
    "text",
    [
        "x_mm,y_mm,z_mm\n100,0,-711\n0,-50.5,-800\n",
        "\ufeffz_mm, note, y_mm, x_mm\r\n-711, a, 0, 100\r\n-800,, -50.5, 0\r\n",
    ],
)
def test_points_of_a_file_by_the_names_of_its_columns(tmp_path, text):
    plan = csv_plan(tmp_path, text, "iso9283.csv")
    assert plan.name == "iso9283"
    np.testing.assert_allclose(plan.target[::2], [[0.1, 0, -0.711], [0, -0.0505, -0.8]])
    assert plan.paths == ()  # the file is used, not the plan of that name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "column x_mm, y_mm, z_mm missing; expected .*, found nothing"),
        ("x_mm,y_mm\n1,2\n", "column z_mm missing; expected x_mm, y_mm, z_mm, found x_mm, y_mm"),
        ("x;y;z\n", "column x_mm, y_mm, z_mm missing; .* found x;y;z"),
        ("x_mm,y_mm,z_mm\n", "contains no points"),
        ("x_mm,y_mm,z_mm\n0,0,-700\n0,zero,-700\n", "line 3: y_mm: 'zero' is not a finite number"),
        ("x_mm,y_mm,z_mm\n0,nan,-700\n", "line 2: y_mm: 'nan' is not a finite number"),
        ("x_mm,y_mm,z_mm\ninf,0,-700\n", "line 2: x_mm: 'inf' is not a finite number"),
        ("x_mm,y_mm,z_mm\n0,0\n", "line 2: z_mm: '' is not a finite number"),
        ("x_mm,y_mm,z_mm\n1,5,2,0,-711,0\n", "line 2: 6 values, but 3 columns; use a decimal p"),
        ("x_mm,y_mm,z_mm\n0,,-700\n", "line 2: y_mm: '' is not a finite number"),
    ],
)
def test_a_wrong_file_is_refused_by_line_column_and_value(tmp_path, text, message):
    with pytest.raises(InputError, match=rf"points\.csv: {message}") as caught:
        csv_plan(tmp_path, text)
    assert caught.value.exit_code == 2


def test_points_out_of_reach_or_limits_are_named(tmp_path):
    head = "x_mm,y_mm,z_mm\n0,0,-711\n"
    with pytest.raises(ReachError, match=r"points\.csv: point 2 \(0\.9, 0, -0\.711 m\) is out"):
        csv_plan(tmp_path, head + "900,0,-711\n")
    said = r"points\.csv: point 2 needs -\d+\.\d+ deg.* joint_1; allowed: -35\.0 to 100"
    with pytest.raises(ReachError, match=said):
        csv_plan(tmp_path, head + "0,0,-550\n")


def test_wrong_use_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no plan 'circle'; there are: line, .*rich, or a CSV"):
        make_plan("circle", ROBOT)
    with pytest.raises(InputError, match=r"none\.csv: cannot be read: No such file or directory$"):
        make_plan(str(tmp_path / "none.csv"), ROBOT)
    for count in (0, -3):
        with pytest.raises(InputError, match=f"count is {count}; it has to be at least 1"):
            make_plan("line", ROBOT, count=count)


def test_a_file_lists_its_stops(tmp_path):
    """A count that is given with it would be ignored."""
    path = tmp_path / "p.csv"
    path.write_text("x_mm,y_mm,z_mm\n0,0,-750\n")
    assert len(make_plan(str(path), ROBOT)) == 2
    with pytest.raises(InputError, match=r"p\.csv: the file lists its stops; a count of 9"):
        make_plan(str(path), ROBOT, count=9)
