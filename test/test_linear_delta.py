"""Linear Delta: nominal positions, reach, and what heights and distances can identify."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.errors import ReachError
from delta_calibration.mechanisms.linear_delta import (
    LinearDelta,
    LinearDeltaDimensions,
    LinearDeltaTolerances,
)
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot, robot_document, robot_from
from delta_calibration.simulation import draw_machine, simulate_session

DRAWING = LinearDeltaDimensions(0.160, np.radians([210.0, 330.0, 90.0]), 0.345, 0.415)
TOLERANCES = LinearDeltaTolerances(1e-3, 5e-3, 3e-3, 1e-3)


@pytest.fixture
def delta():
    return LinearDelta(DRAWING, TOLERANCES)


def carriages(rng, n):
    return rng.uniform(0.3, 0.42, (n, 3))


def test_on_the_drawing(delta):
    """With the carriages at their endstops the platform is centred at its nominal height."""
    g = delta.parameters.nominal
    x = delta.forward(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]), g)
    np.testing.assert_allclose(x, [[0, 0, 0.415], [0, 0, 0.315]], atol=1e-14)


def test_arms_have_their_lengths(delta):
    """Pythagoras from each tower to the platform, with the tower positions as plain numbers."""
    rng = np.random.default_rng(1)
    q = carriages(rng, 20)
    x = delta.forward(q, delta.parameters.nominal)
    top = 0.415 + np.sqrt(0.345**2 - 0.160**2)
    for tower, degrees in enumerate((210, 330, 90)):
        across = x[:, :2] - 0.160 * np.array(
            [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]
        )
        down = top - q[:, tower] - x[:, 2]
        assert (down > 0).all()
        np.testing.assert_allclose(np.hypot(np.hypot(*across.T), down), 0.345, atol=1e-14)


def test_out_of_reach_is_nan_alone_and_refused_by_name(delta):
    targets = np.array([[0.0, 0.0, 0.1], [0.4, 0.0, 0.1]])
    q = delta.inverse(targets, delta.parameters.nominal)
    assert np.isfinite(q[0]).all()
    assert np.isnan(q[1]).any()
    with pytest.raises(ReachError, match=r"target 2 \(0.4, 0, 0.1 m\)"):
        delta.require_reach(q, targets, "target", "m")


def test_condition_grows_where_an_arm_lies_level(delta):
    """There the carriage cannot move the platform along the arm."""
    g = delta.parameters.nominal
    level = np.array([[0.0, -(0.345 - 0.160) + 1e-6, 0.1]])
    q = delta.inverse(np.concatenate([level, [[0.0, 0.0, 0.1]]]), g)
    condition = delta.condition(q, delta.forward(q, g), g)
    assert condition[0] > 50
    assert condition[1] < 3


def rank(matrix):
    values = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    return int((values > 1e-9 * values[0]).sum())


def test_nine_of_ten_show_in_heights_and_distances(delta):
    rng = np.random.default_rng(5)
    g = delta.parameters.nominal
    q, other = carriages(rng, 60), carriages(rng, 60)
    x, y = delta.forward(q, g), delta.forward(other, g)
    here = delta.identification_jacobian(q, x, g)
    there = delta.identification_jacobian(other, y, g)
    along = (y - x) / np.linalg.norm(y - x, axis=1)[:, None]
    apart = np.einsum("ni,nip->np", along, there - here)
    assert rank(here.reshape(-1, 10)) == 10
    assert rank(np.concatenate([here[:, 2], apart])) == 9


def test_towers_lean_as_they_are_turned():
    """Carriages go down the axes of rotated towers; the arms have their lengths everywhere."""
    rng = np.random.default_rng(8)
    delta = LinearDelta(DRAWING, LinearDeltaTolerances(1e-3, 5e-3, 3e-3, 1e-3, 0.5e-3))
    p = delta.parameters
    g = p.nominal + 20 * p.prior * np.array(["lean" in name for name in p.names])
    g[-6:] *= rng.uniform(-1, 1, 6)
    q = rng.uniform(0.1, 0.42, (20, 3))
    x = delta.forward(q, g)
    for tower in range(3):
        out, aside = g[10 + tower], g[13 + tower]
        tilt = np.arctan(np.hypot(out, aside))
        lean = Rotation.from_rotvec(tilt / np.tan(tilt) * np.array([-aside, out, 0.0]))
        turn = Rotation.from_euler("z", g[1 + tower])
        top = turn.apply([g[0], 0.0, 0.0]) + np.array([0.0, 0.0, g[4 + tower]])
        down = q[:, tower, None] * (turn * lean).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(np.linalg.norm(x - (top - down), axis=1), 0.345, atol=1e-14)
    np.testing.assert_allclose(delta.inverse(x, g), q, atol=1e-14)
    jacobian = delta.identification_jacobian(q, x, g).reshape(-1, 16)
    axes = np.broadcast_to(np.eye(3), (len(x), 3, 3))
    turns = np.stack([np.cross(np.eye(3)[k], x) for k in range(3)], -1)
    motion = np.concatenate([turns, axes], -1).reshape(-1, 6)
    assert rank(jacobian) == 16
    assert rank(np.hstack([jacobian, motion])) == 18


def test_towers_lean_if_the_robot_file_has_a_tolerance_for_it():
    """Half a milliradian is neither a cause nor unknown structure then; it is without."""
    upright = load_robot("linear_delta")
    _, document = robot_document(upright.source)
    document["tolerances"]["lean_mrad"] = 0.5
    leaning = robot_from(document, "leaning")
    plan = make_plan("identify", leaning, count=40, seed=3)
    session = simulate_session(draw_machine(leaning, 3), plan, 3)
    seen = survey(session, upright.joints.names, upright.commanded.joint_size)
    known, missing = (diagnose(seen, robot, seed=3).verdict for robot in (leaning, upright))
    assert not known.findings
    assert not known.unknown_structure.found
    assert missing.unknown_structure.found
    assert known.calibrated.held_out_rms_mm < 0.8 * missing.calibrated.held_out_rms_mm


def circle_through(foot):
    """Centre (..., 2) of the circle through three feet (..., 3, 2), and the radii to the feet."""
    across, square = 2 * np.diff(foot, axis=-2), np.diff(np.sum(foot**2, axis=-1))
    middle = np.linalg.solve(across, square[..., None])[..., 0]
    return middle, foot - middle[..., None, :]


def feet(radius, angle):
    return radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def test_towers_have_their_tolerances_on_the_circle_through_them():
    """Each tower has its own error of radius and direction; check the directions on the circle."""
    rng, drawn = np.random.default_rng(7), np.radians([210.0, 330.0, 90.0])
    radius, turn = rng.normal(0.160, 1e-3, (20000, 3)), rng.normal(0.0, 5e-3, (20000, 3))
    _, spoke = circle_through(feet(radius, drawn + turn))
    off = np.arctan2(spoke[..., 1], spoke[..., 0]) - drawn
    off = np.mod(off + np.pi, 2 * np.pi) - np.pi
    shape = off - off.mean(axis=1, keepdims=True)  # the mean only rotates the base
    delta = LinearDelta(DRAWING, LinearDeltaTolerances(1e-3, 5e-3, 1e-3, 1e-3))
    expected = delta.parameters.prior[1:4]
    np.testing.assert_allclose(np.sqrt(np.sum(shape**2, axis=1).mean() / 2), expected, rtol=0.02)


def test_three_radii_are_one_and_a_shift_of_the_base():
    """Displaced towers are still on a circle; one radius and the angles give the distances."""
    rng = np.random.default_rng(6)
    angle, radius = np.radians([210.0, 330.0, 90.0]), np.array([0.1612, 0.1590, 0.1604])
    foot = feet(radius, angle)
    middle, spoke = circle_through(foot)
    size = np.linalg.norm(spoke, axis=1)
    np.testing.assert_allclose(size, size[0], atol=1e-15)
    turned = np.mod(np.arctan2(spoke[:, 1], spoke[:, 0]), 2 * np.pi)
    delta = LinearDelta(LinearDeltaDimensions(size[0], turned, 0.345, 0.415), TOLERANCES)
    q = carriages(rng, 20)
    x = delta.forward(q, delta.parameters.nominal) + np.append(middle, 0.0)
    top = 0.415 + np.sqrt(0.345**2 - size[0] ** 2)
    for tower in range(3):
        across = x[:, :2] - foot[tower]
        down = top - q[:, tower] - x[:, 2]
        np.testing.assert_allclose(np.hypot(np.hypot(*across.T), down), 0.345, atol=1e-13)
