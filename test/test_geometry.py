"""Tests of rotations against scipy and complex steps, of frames, and of alignment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from delta_calibration.errors import DataError
from delta_calibration.geometry import Frame, align, rotations

SIZES = [0.0, 1e-9, 1e-5, 0.0099999, 0.0100001, 0.3, 2.0, np.pi - 1e-6, 3.1, 6.0]


def vectors(rng, size, n=6):
    w = rng.standard_normal((n, 3))
    return size * w / np.linalg.norm(w, axis=1, keepdims=True)


def frame(rng):
    return Frame(
        Rotation.random(random_state=int(rng.integers(1e6))).as_matrix(), rng.normal(size=3)
    )


@pytest.mark.parametrize("size", SIZES)
def test_exp_is_the_matrix_exponential(size):
    w = vectors(np.random.default_rng(1), size)
    exact = np.array([expm(rotations.skew(v)) for v in w])
    np.testing.assert_allclose(rotations.exp(w), exact, atol=3e-15 * max(1, size))
    np.testing.assert_allclose(rotations.exp(w), Rotation.from_rotvec(w).as_matrix(), atol=1e-14)


def test_skew_is_the_cross_product():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose((rotations.skew(a) @ b[..., None])[..., 0], np.cross(a, b))


@pytest.mark.parametrize("size", SIZES)
def test_derivative_of_a_turned_vector_by_complex_step(size):
    rng = np.random.default_rng(3)
    w, v = vectors(rng, size), rng.normal(size=(6, 3))
    columns = []
    for k in range(3):
        moved = w.astype(complex)
        moved[:, k] += 1e-30j
        columns.append(np.imag(rotations.exp(moved) @ v[..., None])[..., 0] / 1e-30)
    turned = (rotations.exp(w) @ v[..., None])[..., 0]
    written = -rotations.skew(turned) @ rotations.left_jacobian(w)
    np.testing.assert_allclose(written, np.stack(columns, -1), atol=1e-11)
    h = np.array([1e-6, 0, 0])
    by_hand = Rotation.from_rotvec(w + h).apply(v) - Rotation.from_rotvec(w - h).apply(v)
    np.testing.assert_allclose(written[..., 0], by_hand / 2e-6, atol=1e-8)


@pytest.mark.parametrize("size", [s for s in SIZES if s < np.pi])
def test_log_undoes_exp(size):
    w = vectors(np.random.default_rng(4), size)
    np.testing.assert_allclose(rotations.log(rotations.exp(w)), w, atol=1e-9)


def test_quaternions_are_x_y_z_w_and_of_any_length():
    half = np.sqrt(0.5)
    quarter = rotations.about_z(np.pi / 2)
    np.testing.assert_allclose(rotations.to_quaternion(quarter), [0, 0, half, half], atol=1e-15)
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    q = np.random.default_rng(5).normal(size=(2, 4, 4))
    matrix = rotations.from_quaternion(q)
    assert matrix.shape == (2, 4, 3, 3)
    back = rotations.to_quaternion(matrix)
    unit = q / np.linalg.norm(q, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.sum(back * unit, axis=-1)), 1, atol=1e-14)


def test_frames_compose_and_invert():
    rng = np.random.default_rng(6)
    T_a_b, T_b_c = frame(rng), frame(rng)
    points = rng.normal(size=(4, 2, 3))
    through = T_a_b.apply(T_b_c.apply(points))
    np.testing.assert_allclose((T_a_b @ T_b_c).apply(points), through, atol=1e-14)
    np.testing.assert_allclose(T_a_b.inverse().apply(T_a_b.apply(points)), points, atol=1e-14)
    np.testing.assert_allclose(Frame.identity().apply(points), points)
    again = Frame.from_vector(T_a_b.vector())
    np.testing.assert_allclose(again.rotation, T_a_b.rotation, atol=1e-14)
    np.testing.assert_allclose(again.translation, T_a_b.translation)


@pytest.mark.parametrize("flat", [False, True])
def test_align_recovers_a_motion_exactly_and_never_mirrors(flat):
    rng = np.random.default_rng(7)
    for _ in range(20):
        true, points = frame(rng), rng.normal(size=(5, 3)) * [1, 1, 0 if flat else 1]
        found = align(points, true.apply(points))
        np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-12)
        np.testing.assert_allclose(found.translation, true.translation, atol=1e-12)
        mirrored = align(points, points * [1, 1, -1])
        assert np.linalg.det(mirrored.rotation) == pytest.approx(1)


def test_align_is_the_least_of_all_motions_near_it():
    rng = np.random.default_rng(8)
    points, weights = rng.normal(size=(12, 3)), rng.uniform(0.1, 3, 12)
    target = frame(rng).apply(points) + 0.05 * rng.normal(size=(12, 3))

    def cost(motion):
        return np.sum(weights * np.sum((motion.apply(points) - target) ** 2, axis=1))

    best = align(points, target, weights)
    for _ in range(50):
        step = Frame.from_vector(1e-3 * rng.normal(size=6))
        assert cost(step @ best) > cost(best)
    assert cost(align(points, target)) > cost(best)  # weights matter


def test_align_refuses_what_leaves_a_turn_free():
    rng = np.random.default_rng(9)
    spread, line = rng.normal(size=(6, 3)), np.outer(np.arange(6.0), [1, -1, 0.5])
    with pytest.raises(DataError, match="3 points or more, found 2"):
        align(spread[:2], spread[:2])
    for source, target in ((line, line), (line, spread), (spread, line), (spread, 0 * spread)):
        with pytest.raises(DataError, match="points that do not lie on one line"):
            align(source, target)
