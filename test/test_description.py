"""Tests of URDF against the mechanisms: an independent reader, chains closed at many poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.cli.main import run
from delta_calibration.description import Skeleton, describe, frame_prefix, urdf
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import Robot, known_robots, load_robot
from urdf_reader import Urdf

CLOSED = 1e-9  # [m]
STRUTS = {"srbd": 6, "linear_delta": 3, "cdpr8": 8, "five_axis": 4, "scara": 0, "ur10": 0}
CUBE_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)


def joints_of(robot: Robot, count: int = 25) -> np.ndarray:
    """Nominal joints over the workspace; a platform on cables is also rotated."""
    return make_plan("identify", robot, count=count, both_sides=False, seed=2).joint


def identified(robot: Robot, model: str | None = None) -> Calibration:
    """A calibration of a machine with errors of five times its tolerances."""
    mechanism = robot.model(model)
    drawn, rng = mechanism.parameters, np.random.default_rng(4)
    size = np.where(np.isfinite(drawn.prior), drawn.prior, 0.0)
    geometry = drawn.nominal + 5.0 * size * rng.standard_normal(len(drawn))
    chain = Chain(mechanism, np.zeros(3), 0.05)
    frame = Frame.from_vector(np.array([0.3, -0.2, 1.1, 2.0, -1.0, 0.5]))
    theta = chain.join(geometry, np.zeros(3), frame)
    limits = robot.joints.lower, robot.joints.upper
    return Calibration(robot, chain, theta, Region(CUBE_CORNERS), *limits, 1e-5, "drawn", "")


def values_at(skeleton: Skeleton, q: np.ndarray) -> list[dict[str, float]]:
    values = skeleton.values(q)
    return [{name: float(v[k]) for name, v in values.items()} for k in range(len(q))]


def ends_of(robot: Robot, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Ends of the struts on the platform by the geometric parameters, (3,) [m]."""
    model = skeleton.mechanism
    given = dict(zip(model.parameters.names, skeleton.geometry, strict=True))
    if model.name == "six_rod_delta":
        return {f"{leg}{side}": _ball(given, leg, side) for leg in (1, 2, 3) for side in "ab"}
    if model.name == "linear_delta":
        return {str(tower): np.zeros(3) for tower in (1, 2, 3)}
    return {
        str(i): np.array([given[f"platform_{axis}_{i}"] for axis in "xyz"])
        for i in range(1, model.joints + 1)
    }


def _ball(given: dict[str, float], leg: int, side: str) -> np.ndarray:
    place = np.array([given[f"platform_{a}_{leg}"] for a in ("radial", "tangential", "height")])
    tilt = [given[f"platform_line_tilt_x_{leg}"], 0.0, given[f"platform_line_tilt_z_{leg}"]]
    width = given[f"platform_half_width_{leg}{side}"] * (-1.0 if side == "a" else 1.0)
    line = Rotation.from_rotvec(tilt).apply([0.0, width, 0.0])
    return Rotation.from_euler("z", 120.0 * (leg - 1), degrees=True).apply(place + line)


@pytest.mark.parametrize("crooked", [False, True], ids=["drawn", "identified"])
@pytest.mark.parametrize("name", known_robots())
def test_both_ends_of_every_strut_meet_the_platform(name: str, crooked: bool) -> None:
    robot = load_robot(name)
    skeleton = describe(robot, identified(robot) if crooked else None)
    model, q = skeleton.mechanism, joints_of(robot)
    file, pose = Urdf(urdf(skeleton.tree)), model.forward(q, skeleton.geometry)
    assert np.isfinite(pose).all()
    centre, turn = model.position(pose), model.rotation(pose)
    struts = ends_of(robot, skeleton) if STRUTS[name] else {}
    assert len(struts) == STRUTS[name]
    for k, values in enumerate(values_at(skeleton, q)):
        tool = file.place("tool0", values)
        np.testing.assert_allclose(tool[:3, 3], centre[k], atol=CLOSED)
        np.testing.assert_allclose(tool[:3, :3], turn[k], atol=CLOSED)
        for strut, end in struts.items():
            tip = tip_of(file, skeleton, strut, values)
            held = turn[k]
            if name == "five_axis" and strut in "34":  # their joints do not turn about y
                held = held @ Rotation.from_euler("y", -pose[k, 3]).as_matrix()
            np.testing.assert_allclose(tip, centre[k] + held @ end, atol=CLOSED)


def tip_of(file: Urdf, skeleton: Skeleton, strut: str, values: dict[str, float]) -> np.ndarray:
    """Far end of a strut in the file: at the drawn length, or the end of a cable."""
    if f"end_{strut}" in file.links:
        return file.place(f"end_{strut}", values)[:3, 3]
    length = next(s.length for s in skeleton.struts if s.name == strut)
    return (file.place(f"strut_{strut}", values) @ [0.0, 0.0, -length, 1.0])[:3]


def test_the_srbd_is_the_contract_s() -> None:
    """Dimensions, directions and legs as in the robot's specification, in mm."""
    robot = load_robot("srbd")
    skeleton = describe(robot)
    file = Urdf(urdf(skeleton.tree))
    assert file.name == "srbd"
    assert file.root == "base_link"
    for leg, degrees in ((1, 0.0), (2, 120.0), (3, 240.0)):
        out = Rotation.from_euler("z", degrees, degrees=True)
        level = dict.fromkeys(skeleton.tree.moving, 0.0)
        lowered = level | {f"joint_{leg}": 0.1, f"upright_{leg}": -0.1, f"elbow_{leg}": 0.1}
        hinge, elbow = (file.place(f"{part}_{leg}", level)[:3, 3] for part in ("arm", "elbow"))
        np.testing.assert_allclose(hinge, out.apply([0.2, 0.0, 0.0]), atol=1e-12)
        np.testing.assert_allclose(elbow, out.apply([0.52, 0.0, 0.0]), atol=1e-12)
        assert file.place(f"elbow_{leg}", lowered)[2, 3] == pytest.approx(-0.32 * np.sin(0.1))
        for letter, side in (("a", -0.04), ("b", 0.04)):
            ball = file.place(f"cross_{leg}{letter}", level)[:3, 3]
            np.testing.assert_allclose(ball, out.apply([0.52, side, 0.0]), atol=1e-12)
    home = values_at(skeleton, np.zeros((1, 3)))[0]
    place = file.place("tool0", home)
    np.testing.assert_allclose(place[:3, :3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(place[:3, 3], [0.0, 0.0, -0.711], atol=1e-3)
    limit = file.joint("joint_2").limit
    assert limit is not None
    assert (limit["lower"], limit["upper"]) == pytest.approx(np.radians([-35.0, 100.0]))


def test_a_wrong_passive_value_opens_the_chain() -> None:
    """The check above can fail: 1 mrad is visible at the far end of a rod."""
    robot = load_robot("srbd")
    skeleton = describe(robot)
    file, q = Urdf(urdf(skeleton.tree)), joints_of(robot)[:1]
    (values,) = values_at(skeleton, q)
    good = tip_of(file, skeleton, "2b", values)
    bad = tip_of(file, skeleton, "2b", values | {"swing_2b": values["swing_2b"] + 1e-3})
    assert np.linalg.norm(good - bad) > 1e-4


@pytest.mark.parametrize("name", known_robots())
def test_motors_have_the_robot_s_names_and_the_rest_is_passive(name: str) -> None:
    robot = load_robot(name)
    skeleton = describe(robot)
    file = Urdf(urdf(skeleton.tree))
    moving = {joint.name for joint in file.joints if joint.kind != "fixed"}
    assert moving == set(robot.joints.names) | set(skeleton.passive)
    assert set(robot.joints.names).isdisjoint(skeleton.passive)
    assert {"base_link", "tool0"} <= set(file.links)
    assert set(skeleton.values(skeleton.mechanism.home[None])) == moving


def test_out_of_reach_is_not_a_number_and_leaves_the_others_alone() -> None:
    skeleton = describe(load_robot("linear_delta"))
    values = skeleton.values(np.array([[0.2, 0.2, 0.2], [0.0, 0.0, 2.0]]))
    for name in skeleton.passive:
        assert np.isfinite(values[name][0])
    assert np.isnan(values["swing_1"][1])


def test_every_mechanism_has_a_tree() -> None:
    drawn = {load_robot(name).model().name for name in known_robots()}
    assert drawn | {"rotary_delta"} == set(MECHANISMS)


def test_three_spheres_are_shown_as_six_rods_that_stand_there() -> None:
    robot = load_robot("srbd")
    calibration = identified(robot, "rotary_delta")
    skeleton = describe(robot, calibration)
    q = joints_of(robot)
    spheres = calibration.chain.mechanism.forward(q, calibration.geometry)
    rods = skeleton.mechanism.forward(q, skeleton.geometry)
    assert skeleton.mechanism.name == "six_rod_delta"
    np.testing.assert_allclose(rods[:, :3], spheres, atol=CLOSED)
    np.testing.assert_allclose(rods[:, 3:], 0.0, atol=CLOSED)


def test_a_calibration_brings_the_tracker_s_frame_and_a_tool_its_tip() -> None:
    drawn = load_robot("srbd")
    robot = replace(drawn, tool_offset=np.array([0.01, 0.0, -0.1]))
    calibration = identified(robot)
    file = Urdf(urdf(describe(robot, calibration).tree))
    point = np.array([0.1, 0.2, -0.7])
    seen = calibration.frame.apply(point)
    np.testing.assert_allclose(file.place("tracker", {}) @ [*seen, 1.0], [*point, 1.0], atol=1e-12)
    tip = file.joint("tcp")
    assert tip.parent == "tool0"
    np.testing.assert_allclose(tip.origin[:3, 3], robot.tool_offset)
    assert "tracker" not in Urdf(urdf(describe(drawn).tree)).links


@pytest.mark.parametrize("turn", [[0.0, np.pi / 2, 0.0], [0.3, -np.pi / 2, 0.4], [3.0, 1.0, -2.0]])
def test_angles_of_a_frame_give_it_back_where_x_stands_up_too(turn: list[float]) -> None:
    from delta_calibration.geometry.rotations import roll_pitch_yaw

    matrix = Rotation.from_euler("xyz", turn).as_matrix()
    again = Rotation.from_euler("xyz", roll_pitch_yaw(matrix)).as_matrix()
    np.testing.assert_allclose(again, matrix, atol=1e-15)


def test_the_verb_prints_or_writes_it(tmp_path: Path, capsys: Any) -> None:
    assert run(["urdf", "--robot", "srbd"]) == 0
    printed = capsys.readouterr().out
    assert Urdf(printed).name == "srbd"
    out = tmp_path / "srbd.urdf"
    assert run(["urdf", "--robot", "srbd", "--out", str(out)]) == 0
    assert out.read_text(encoding="utf-8") == printed
    assert run(["urdf", "--robot", "srbd", "--out", str(out / "file")]) == 2
    assert str(out) in capsys.readouterr().err
    assert run(["urdf", "--robot", "nobody"]) == 2
    assert "no robot 'nobody'" in capsys.readouterr().err


def test_one_robot_among_several_has_frames_of_its_own(capsys: Any) -> None:
    assert run(["urdf", "--robot", "srbd"]) == 0
    alone = Urdf(capsys.readouterr().out)
    assert run(["urdf", "--robot", "srbd", "--frame-prefix", "left/"]) == 0
    left = Urdf(capsys.readouterr().out)
    assert left.root == "left/base_link"
    assert left.links == [f"left/{link}" for link in alone.links]
    ends = [(f"left/{joint.parent}", f"left/{joint.child}") for joint in alone.joints]
    assert [(joint.parent, joint.child) for joint in left.joints] == ends
    assert [joint.name for joint in left.joints] == [joint.name for joint in alone.joints]


@pytest.mark.parametrize("prefix", ["", "left/", "cell-1/left_", "a.b/c/"])
def test_a_prefix_of_frames_is_taken(prefix: str) -> None:
    assert frame_prefix(prefix) == prefix


@pytest.mark.parametrize("prefix", ["/left/", "left//", "left robot/", "\u00e4/", "a" * 60 + "!"])
def test_a_prefix_that_no_frame_may_have_is_refused(prefix: str) -> None:
    with pytest.raises(InputError, match=r"frame_prefix '.*': letters, digits"):
        frame_prefix(prefix)
