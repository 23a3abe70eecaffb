"""The noise of a measured pose is found from repeats, and only from what may be compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification_bench import ROBOT, errors, slope_of
from six_rods import (
    PER_METRE,
    RADIAL,
    REPEATABILITY,
    TRANSVERSE,
    Cell,
    SixRods,
    workspace,
)

from delta_calibration.identification import identify
from delta_calibration.identification.noise import estimate_noise


def test_known_noise_is_given_back_within_its_sampling_error():
    """400 poses of 11 readings: 4000 degrees of freedom along, 8000 across; 600 for rest."""
    rng = np.random.default_rng(1)
    q = np.repeat(workspace(200, rng), 2, axis=0)
    for factor, rest in ((1.0, 12e-6), (1.7, 25e-6)):
        poses = Cell(SixRods()).measure(q, rng, count=11, repeatability=rest, noise=factor)
        noise = estimate_noise(poses, slope_of(poses), ROBOT)
        assert noise.measured
        assert noise.degrees == 200
        assert noise.radial_scale == pytest.approx(factor, rel=4 / np.sqrt(2 * 4000))
        assert noise.transverse_scale == pytest.approx(factor, rel=4 / np.sqrt(2 * 8000))
        assert noise.repeatability == pytest.approx(rest, rel=4 / np.sqrt(2 * 600) * 1.3)
        distance = np.linalg.norm(poses.point, axis=1)
        reading = (RADIAL**2 + 2 * (TRANSVERSE + PER_METRE * distance) ** 2) * factor**2 / 11
        motion = rest**2 * np.sum(slope_of(poses) ** 2, axis=(1, 2))
        assert noise.floor == pytest.approx(
            np.sqrt(np.mean(reading + motion)), rel=4 / np.sqrt(1200)
        )


def test_covariance_of_a_reading_lies_along_and_across_the_beam():
    rng = np.random.default_rng(2)
    poses = Cell(SixRods()).measure(workspace(2, rng), rng)
    noise = replace(
        estimate_noise(poses, slope_of(poses), ROBOT), radial_scale=1, transverse_scale=1
    )
    covariance = noise.reading(poses.point, ROBOT.tracker)
    for point, matrix in zip(poses.point, covariance, strict=True):
        values, axes = np.linalg.eigh(matrix)
        across = TRANSVERSE + PER_METRE * np.linalg.norm(point)
        np.testing.assert_allclose(np.sqrt(values), [RADIAL, across, across])
        assert abs(axes[:, 0] @ point) == pytest.approx(np.linalg.norm(point))


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_sides_are_pooled_only_where_they_agree(gap):
    """Half a gap of 0.1 mrad either way is no noise; without it the sides are repeats."""
    rng = np.random.default_rng(3)
    q = np.repeat(workspace(20, rng), 4, axis=0)
    side = np.tile([1.0, 1.0, -1.0, -1.0], 20)[:, None] * np.ones(3)
    cell = Cell(SixRods())
    poses = cell.measure(q - side * gap / 2, rng, direction=side)
    poses = replace(poses, joint=q, command=q, place=np.repeat(np.arange(20), 4))
    noise = estimate_noise(poses, slope_of(poses), ROBOT)
    assert noise.degrees == (20 * 3 if gap == 0 else 20 * 2)
    assert noise.repeatability == pytest.approx(REPEATABILITY, rel=0.3)


def test_without_repeats_the_files_figures_are_taken_and_said():
    rng = np.random.default_rng(4)
    poses = Cell(SixRods()).measure(workspace(30, rng), rng, repeatability=50e-6)
    noise = estimate_noise(poses, slope_of(poses), ROBOT)
    assert not noise.measured
    assert noise.degrees == 0
    assert noise.repeatability == ROBOT.joints.repeatability
    alone = Cell(SixRods()).measure(workspace(30, rng), rng, count=1)
    noise = estimate_noise(alone, slope_of(alone), ROBOT)
    assert (noise.radial_scale, noise.transverse_scale) == (1.0, 1.0)


def test_one_knocked_repeat_is_not_noise():
    rng = np.random.default_rng(5)
    poses = Cell(SixRods()).measure(np.repeat(workspace(40, rng), 2, axis=0), rng)
    point = poses.point.copy()
    point[17, 1] += 2e-3
    knocked = replace(poses, point=point)
    clean, noise = (estimate_noise(p, slope_of(p), ROBOT) for p in (poses, knocked))
    assert clean.degrees == 40
    assert noise.degrees == 39
    assert noise.repeatability == pytest.approx(clean.repeatability, rel=0.1)
    assert noise.floor == pytest.approx(clean.floor, rel=0.1)


@pytest.mark.parametrize("rest", [12e-6, 200e-6])
def test_a_rest_error_that_the_encoders_saw_is_no_noise(rest):
    """The fit knows where the joints were, so repeats are compared there: the tracker is left."""
    rng = np.random.default_rng(6)
    command, place = np.repeat(workspace(40, rng), 2, axis=0), np.repeat(np.arange(40), 2)
    joint = command + rest * rng.standard_normal(command.shape)
    poses = Cell(SixRods(errors(rng))).measure(joint, rng, repeatability=0.0)
    poses = replace(poses, command=command, place=place, repeat=place)
    result = identify(poses, ROBOT)
    distance = np.linalg.norm(poses.point, axis=1)
    reading = (RADIAL**2 + 2 * (TRANSVERSE + PER_METRE * distance) ** 2) / 21
    assert result.noise.floor == pytest.approx(np.sqrt(reading.mean()), rel=4 / np.sqrt(240))
    assert result.noise.repeatability < 2e-6
    assert result.chi_square == pytest.approx(1, abs=0.25)
