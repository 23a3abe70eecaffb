from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.errors import DataError
from delta_calibration.region import Region

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def test_distance_to_a_cube():
    region = Region.of(CUBE)
    points = np.array(
        [[0.5, 0.5, 0.5], [0.5, 0.5, 0.9], [1.2, 0.5, 0.5], [0.5, -0.3, 0.5], [1, 1, 1]]
    )
    np.testing.assert_allclose(region.outside(points), [-0.5, -0.1, 0.2, 0.3, 0], atol=1e-9)
    corner = region.outside(np.array([1.1, 1.1, 1.1]))
    assert 0 < corner <= 0.1 * np.sqrt(3)


def test_only_corners_are_kept_and_all_points_are_inside():
    rng = np.random.default_rng(1)
    points = np.concatenate([CUBE, rng.random((200, 3))])
    region = Region.of(points)
    assert {tuple(v) for v in region.vertices} == {tuple(v) for v in CUBE}
    assert region.outside(points).max() < 1e-9
    again = Region(region.vertices)  # as read from a file
    np.testing.assert_allclose(again.outside(points), region.outside(points), atol=1e-9)


def test_any_shape_of_points():
    region = Region.of(CUBE)
    assert region.outside(np.zeros((4, 2, 3))).shape == (4, 2)


@pytest.mark.parametrize("bumps", [0.0, 1e-6, 1e-3])
def test_a_disc_ends_at_its_rim_in_its_own_plane_too(bumps):
    """Poses of the plans `disc` and `line` lie in one plane, except for encoder noise."""
    rng = np.random.default_rng(2)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    disc = np.stack(
        [0.4 * np.cos(turn), 0.4 * np.sin(turn), -0.7 + bumps * rng.random(60)], axis=1
    )
    region = Region.of(np.concatenate([disc, 0.5 * disc + [0, 0, -0.35]]))
    assert region.outside(disc).max() < 1e-9
    far = np.array([[0.9, 0, -0.7], [0.0, -0.45, -0.7], [0, 0, -0.68], [0, 0, -0.72]])
    np.testing.assert_allclose(region.outside(far), [0.5, 0.05, 0.02, 0.02], atol=2e-3)


def test_a_line_ends_at_its_ends_and_is_thin():
    x = np.linspace(-0.45, 0.45, 61)
    region = Region.of(np.stack([x, -x, np.full_like(x, -0.711)], axis=1))
    far = np.array([[0.5, -0.5, -0.711], [0.1, 0.1, -0.711], [0, 0, -0.69], [0.2, -0.2, -0.711]])
    expected = [0.05 * np.sqrt(2), 0.1 * np.sqrt(2), 0.021, 0.0]
    np.testing.assert_allclose(region.outside(far), expected, atol=1.5e-3)


def test_fewer_than_four_points_are_refused():
    for few in (CUBE[:3], CUBE[:0]):
        with pytest.raises(DataError, match=f"4 points or more, found {len(few)}"):
            Region.of(few)


@pytest.mark.parametrize("flat", [False, True])
def test_a_sample_fills_the_region_and_its_margin_and_nothing_else(flat):
    rng, margin = np.random.default_rng(4), 0.01
    points = rng.uniform(-0.3, 0.3, (60, 3))
    if flat:
        points = points * [1, 1, 0] @ Rotation.from_rotvec([0.4, -0.3, 0.1]).as_matrix().T
    region = Region.of(points)
    found = region.sample(3000, margin, np.random.default_rng(1))
    outside = region.outside(found)
    assert outside.max() <= margin
    boundary = np.abs(outside - margin) < 1e-8
    assert boundary[: len(region.vertices)].all()  # outside the corners
    assert boundary.sum() >= 1000
    assert (outside < 0.5 * margin).sum() > (100 if flat else 1000)
    # all directions are covered: each half space through the centre has its share
    middle = region.vertices.mean(axis=0)
    for way in rng.standard_normal((20, 3)):
        assert 0.2 < np.mean((found - middle) @ way > 0) < 0.8
    np.testing.assert_array_equal(found, region.sample(3000, margin, np.random.default_rng(1)))
