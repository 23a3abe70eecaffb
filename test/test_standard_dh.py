"""Arms in standard DH parameters agree with plain products of 4 x 4 matrices."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.description import describe
from delta_calibration.errors import ConfigError
from delta_calibration.export.dh import dh_tables
from delta_calibration.robot import Robot, robot_document, robot_from
from export_bench import machine

# a, alpha [deg], d, theta [deg] of each joint [mm]
UR10 = [
    (0.0, 90.0, 127.3, 0.0),
    (-612.0, 0.0, 0.0, 0.0),
    (-572.3, 0.0, 0.0, 0.0),
    (0.0, 90.0, 163.941, 0.0),
    (0.0, -90.0, 115.7, 0.0),
    (0.0, 0.0, 92.2, 0.0),
]
PUMA = [
    (0.0, 90.0, 671.8, 0.0),
    (431.8, 0.0, 0.0, 0.0),
    (20.3, -90.0, 150.05, 90.0),
    (0.0, 90.0, 431.8, 0.0),
    (0.0, -90.0, 0.0, 0.0),
    (0.0, 0.0, 56.25, 0.0),
]
TURNED_END = [*PUMA[:-1], (15.0, 90.0, 56.25, -30.0)]  # the last row has a length and angle too
TOOL, MOUNT = np.array([10.0, -20.0, 90.0]), np.array([30.0, -10.0, 45.0])
HOME = [10.0, -70.0, 80.0, -40.0, 60.0, 20.0]


def arm(rows, parallel=(), **geometry) -> Robot:
    data = robot_document("ur10")[1]
    links = [
        {"length_mm": a, "twist_deg": alpha, "offset_mm": d, "zero_deg": theta}
        | ({"parallel": True} if i in parallel else {})
        for i, (a, alpha, d, theta) in enumerate(rows)
    ]
    own = {
        "links": links,
        "tool_mm": TOOL.tolist(),
        "mount_deg": MOUNT.tolist(),
        "home_deg": HOME,
        "convention": "standard",
        **geometry,
    }
    joints = {**data["joints"], "lower_deg": [-360.0] * 6, "upper_deg": [360.0] * 6}
    rest = {key: value for key, value in data.items() if key != "workspace"}
    return robot_from({**rest, "geometry": own, "joints": joints}, "arm.yaml")


def turned(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]]),
        "y": np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]]),
        "z": np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]),
    }[axis]


def shifted(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def tool_of(place, mount, turn=(0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = shifted(*place)
    for axis, angle in zip("zyx", mount, strict=True):
        matrix = matrix @ turned(axis, angle)
    for axis, angle in zip("xyz", turn, strict=True):
        matrix = matrix @ turned(axis, angle)
    return matrix


def by_hand(rows, q) -> np.ndarray:
    """Spong's A_i, written out: R_z T_z T_x R_x."""
    whole = np.eye(4)
    for (a, alpha, d, theta), angle in zip(rows, q, strict=True):
        c, s = np.cos(angle + np.radians(theta)), np.sin(angle + np.radians(theta))
        ca, sa = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        whole = whole @ np.array(
            [
                [c, -s * ca, s * sa, 1e-3 * a * c],
                [s, c * ca, -c * sa, 1e-3 * a * s],
                [0, sa, ca, 1e-3 * d],
                [0, 0, 0, 1],
            ]
        )
    return whole @ tool_of(1e-3 * TOOL, np.radians(MOUNT))


@pytest.mark.parametrize(
    ("rows", "parallel"), [(UR10, (1, 2)), (PUMA, (2,)), (TURNED_END, ()), (UR10, ())]
)
def test_the_tool_is_where_plain_products_put_it(rows, parallel) -> None:
    robot = arm(rows, parallel)
    model = robot.model()
    rng = np.random.default_rng(1)
    q = np.concatenate([model.home[None], rng.uniform(-2.5, 2.5, (20, 6))])
    x = model.forward(q, model.parameters.nominal)
    expected = np.array([by_hand(rows, each) for each in q])
    np.testing.assert_allclose(model.position(x), expected[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(model.rotation(x), expected[:, :3, :3], atol=1e-12)
    frames = describe(robot).tree.frames(dict(zip(robot.joints.names, q.T, strict=True)))
    np.testing.assert_allclose(frames["tool0"][1], expected[:, :3, 3], atol=1e-12)


def test_a_mount_that_stands_upright_is_kept() -> None:
    robot = arm(TURNED_END, mount_deg=[0.0, 0.0, 0.0], tool_mm=[0.0, 0.0, 0.0])
    upright = arm(TURNED_END, mount_deg=[90.0, 0.0, 30.0], tool_mm=[0.0, 0.0, 0.0])
    assert abs(upright.model().dimensions.mount[1]) == pytest.approx(np.pi / 2)
    stood = tool_of((0, 0, 0), np.radians([90, 0, 30]))
    for each, turn in ((robot, np.eye(4)), (upright, stood)):
        model = each.model()
        x = model.forward(model.home[None], model.parameters.nominal)
        own = by_hand(TURNED_END, np.radians(HOME)) @ np.linalg.inv(
            tool_of(1e-3 * TOOL, np.radians(MOUNT))
        )
        np.testing.assert_allclose(model.rotation(x)[0], (own @ turn)[:3, :3], atol=1e-12)


def walked(tables, q) -> list[np.ndarray]:
    """Tools by the modified and the standard table, multiplied as the file describes."""

    def to_axis(row):
        return (
            turned("x", row["alpha_rad"])
            @ turned("y", row["beta_rad"])
            @ shifted(row["a_m"], 0, 0)
        )

    def about_axis(row, angle):
        return turned("z", angle + row["theta_rad"]) @ shifted(0, 0, row["d_m"])

    tools = [
        tool_of(tool["place_m"], tool["mount_zyx_rad"], tool["turn_xyz_rad"])
        for tool in (tables["tool"], tables["standard"]["tool"])
    ]
    modified, standard = np.eye(4), to_axis(tables["standard"]["first"])
    for row, angle in zip(tables["modified"], q, strict=True):
        modified = modified @ to_axis(row) @ about_axis(row, angle)
    for row, angle in zip(tables["standard"]["links"], q, strict=True):
        standard = standard @ about_axis(row, angle) @ to_axis(row)
    return [modified @ tools[0], standard @ tools[1]]


@pytest.mark.parametrize(("rows", "parallel"), [(UR10, (1, 2)), (TURNED_END, ())])
def test_tables_go_out_in_both_conventions(rows, parallel) -> None:
    calibration: Calibration = machine(arm(rows, parallel))
    tables, model = dh_tables(calibration), calibration.chain.mechanism
    q = model.home + 0.1
    x = model.forward(q[None], calibration.geometry)
    for tool in walked(tables, q):
        np.testing.assert_allclose(tool[:3, 3], x[0, :3], atol=1e-12)
        np.testing.assert_allclose(tool[:3, :3], model.rotation(x)[0], atol=1e-12)
    drawn = tables["drawing"]["standard"]
    for row, (a, alpha, d, theta) in zip(drawn["links"], rows, strict=True):
        np.testing.assert_allclose(
            [row["a_m"], row["alpha_rad"], row["d_m"], row["theta_rad"]],
            [1e-3 * a, np.radians(alpha), 1e-3 * d, np.radians(theta)],
            atol=1e-15,
        )
    np.testing.assert_allclose(drawn["tool"]["place_m"], 1e-3 * TOOL, atol=1e-15)
    np.testing.assert_allclose(drawn["tool"]["mount_zyx_rad"], np.radians(MOUNT), atol=1e-15)
    assert set(drawn["first"].values()) == {0.0}


def test_without_a_word_links_are_modified() -> None:
    data = robot_document("ur10")[1]
    geometry = {**data["geometry"], "convention": "modified"}
    named = robot_from({**data, "geometry": geometry}, "arm.yaml").model()
    plain = robot_from(data, "arm.yaml").model()
    np.testing.assert_array_equal(named.parameters.nominal, plain.parameters.nominal)


def test_other_conventions_are_refused() -> None:
    message = r"geometry\.convention: 'distal' is not allowed; choose from: modified, standard"
    with pytest.raises(ConfigError, match=message):
        arm(UR10, convention="distal")
