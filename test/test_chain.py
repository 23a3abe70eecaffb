"""Tests of the measurement chain against an independent six-rod machine."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data import at_rest
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from six_rods import Cell, SixRods, workspace

ROBOT = load_robot("srbd")


def chain(model):
    return Chain(ROBOT.model(model), np.zeros(3), 0.05)


def frame_of(cell):
    return Frame(cell.turn.as_matrix(), np.array(cell.place))


def scattered(rng, scale=3.0):
    parameters = ROBOT.model("six_rod_delta").parameters
    drawn = scale * parameters.prior * rng.standard_normal(len(parameters))
    return dict(zip(parameters.names, drawn, strict=True))


def test_readings_of_a_crooked_machine():
    """All sixty-six errors by name, a reflector 60 mm off, a rotated tracker: to a nanometre."""
    rng = np.random.default_rng(1)
    errors, q = scattered(rng), workspace(30, rng)
    cell = Cell(SixRods(errors), (0.06, -0.03, 0.02))
    six = chain("six_rod_delta")
    geometry = six.mechanism.parameters.nominal + np.array(list(errors.values()))
    theta = six.join(geometry, np.array(cell.offset), frame_of(cell))
    reading = six.predict(at_rest(q), theta)
    np.testing.assert_allclose(reading, cell.reading(q), atol=1e-12)


def test_every_parameter_moves_the_reading_as_its_name_says():
    """Columns of the Jacobian against differences of the other machine, one error at a time."""
    rng = np.random.default_rng(2)
    errors, q = scattered(rng), workspace(8, rng)
    cell = Cell(SixRods(errors), (0.06, -0.03, 0.02))
    six, h = chain("six_rod_delta"), 1e-6
    geometry = six.mechanism.parameters.nominal + np.array(list(errors.values()))
    theta = six.join(geometry, np.array(cell.offset), frame_of(cell))
    jacobian = six.jacobian(at_rest(q), theta)
    for column, name in enumerate(six.mechanism.parameters.names):
        up, down = ({**errors, name: errors[name] + d} for d in (h, -h))
        slope = Cell(SixRods(up), cell.offset).reading(q) - Cell(
            SixRods(down), cell.offset
        ).reading(q)
        np.testing.assert_allclose(jacobian[..., column], slope / (2 * h), atol=3e-8, err_msg=name)


@pytest.mark.parametrize("model", ["rotary_delta", "six_rod_delta"])
def test_jacobian_by_offset_and_frame(model):
    rng = np.random.default_rng(3)
    c, q, h = chain(model), workspace(6, rng), 1e-6
    theta = c.join(c.mechanism.parameters.nominal, rng.normal(size=3) * 0.05, Frame.identity())
    theta[-6:] = [0.3, -0.2, 1.9, -2.0, 1.0, 0.5]
    jacobian = c.jacobian(at_rest(q), theta)
    for column in range(c.layout.offset.start, len(theta)):
        d = h * (np.arange(len(theta)) == column)
        up, down = (c.predict(at_rest(q), theta + s * d) for s in (1, -1))
        slope = (up - down) / (2 * h)
        np.testing.assert_allclose(jacobian[..., column], slope, atol=1e-8)


@pytest.mark.parametrize("model", ["rotary_delta", "six_rod_delta"])
def test_slope_by_joints(model):
    rng = np.random.default_rng(4)
    c, q, h = chain(model), workspace(6, rng), 1e-6
    theta = c.join(c.mechanism.parameters.nominal, np.array([0.05, 0, -0.02]), Frame.identity())
    slope = c.see(at_rest(q), theta).by_joints
    for joint in range(3):
        d = h * np.eye(3)[joint]
        moved = c.predict(at_rest(q + d), theta) - c.predict(at_rest(q - d), theta)
        np.testing.assert_allclose(slope[..., joint], moved / (2 * h), atol=1e-8)


def test_theta_is_geometry_offset_frame():
    c = chain("rotary_delta")
    assert c.parameters.names[-9:] == (
        "reflector_x",
        "reflector_y",
        "reflector_z",
        "tracker_turn_x",
        "tracker_turn_y",
        "tracker_turn_z",
        "tracker_place_x",
        "tracker_place_y",
        "tracker_place_z",
    )
    assert np.isinf(c.parameters.prior[-6:]).all()
    assert np.isfinite(c.parameters.prior[:-6]).all()
    rng = np.random.default_rng(5)
    frame = Frame.from_vector(rng.normal(size=6))
    theta = c.join(rng.normal(size=24), rng.normal(size=3), frame)
    geometry, offset, again = c.split(theta)
    np.testing.assert_array_equal(np.concatenate([geometry, offset]), theta[:27])
    np.testing.assert_allclose(again.rotation, frame.rotation, atol=1e-14)


def test_out_of_reach_is_nan_in_its_row_alone():
    """Rods of 400 mm do not span the 465 mm from axis to elbow with the arms level."""
    c = chain("six_rod_delta")
    parameters = c.mechanism.parameters
    short = parameters.nominal
    short[[parameters.row(f"rod_{leg}") for leg in (1, 2, 3)]] = 0.4
    theta = c.join(short, np.zeros(3), Frame.identity())
    q = np.array([[1.2, 1.2, 1.2], [0.0, 0.0, 0.0], [1.3, 1.2, 1.25]])
    assert np.isfinite(c.predict(at_rest(q), theta)).all(axis=1).tolist() == [True, False, True]


def motions(rng):
    return [Frame.from_vector(rng.normal(size=6)) for _ in range(5)]


@pytest.mark.parametrize("model", ["rotary_delta", "six_rod_delta"])
def test_another_frame_moves_all_readings_as_one_rigid_body(model):
    rng = np.random.default_rng(6)
    c, q = chain(model), workspace(12, rng)
    geometry, offset = c.mechanism.parameters.nominal, np.array([0.05, 0.0, -0.02])
    seen = [
        c.predict(at_rest(q), theta)
        for theta in (c.join(geometry, offset, frame) for frame in motions(rng))
    ]
    for points in seen[1:]:
        between = [np.linalg.norm(p[:, None] - p, axis=2) for p in (seen[0], points)]
        np.testing.assert_allclose(between[1], between[0], atol=1e-13)
        a, b = (p - p.mean(axis=0) for p in (seen[0], points))
        assert np.linalg.det(np.linalg.lstsq(a, b, rcond=None)[0]) == pytest.approx(1)


def test_a_reflector_offset_is_a_translation_where_nothing_tilts():
    rng = np.random.default_rng(7)
    c, q, frame = chain("rotary_delta"), workspace(12, rng), motions(rng)[0]
    crooked = c.mechanism.parameters.nominal + c.mechanism.parameters.prior * rng.normal(size=24)
    offset = np.array([0.04, -0.03, 0.01])
    with_it, without = (
        c.predict(at_rest(q), theta)
        for theta in (c.join(crooked, o, frame) for o in (offset, 0 * offset))
    )
    np.testing.assert_allclose(
        with_it - without, np.tile(frame.rotation @ offset, (12, 1)), atol=1e-14
    )


def test_a_reflector_offset_turns_with_a_platform_that_tilts():
    """Unequal rods tilt by about d l / 2 c: 60 mm off, some micrometres per tenth of a mrad."""
    rng = np.random.default_rng(8)
    c, q = chain("six_rod_delta"), workspace(12, rng)
    g = c.mechanism.parameters.nominal
    g[c.mechanism.parameters.row("rod_mismatch_1")] = 1e-4
    offset = np.array([0.0, 0.06, 0.0])
    with_it, without = (
        c.predict(at_rest(q), theta)
        for theta in (c.join(g, o, Frame.identity()) for o in (offset, 0 * offset))
    )
    _, turn = SixRods({"rod_mismatch_1": 1e-4}).pose(q)
    np.testing.assert_allclose(with_it - without, turn.apply(offset), atol=1e-13)
    assert np.abs(with_it - without - offset).max() > 3e-6
