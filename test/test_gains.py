"""Tests of the largest and smallest gain of a matrix, used by the guard against singular poses."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.compensation.command_kernel import gains_of
from delta_calibration.model.jit import compiled


@compiled(alone=True)
def gains(values, found):
    """`gains_of` for callers that are not compiled."""
    found[0], found[1] = gains_of(values)


@pytest.mark.parametrize("shape", [(3, 3), (6, 6), (6, 8), (8, 6), (3, 1), (1, 1), (2, 3)])
@pytest.mark.parametrize("least", [1.0, 1e-3, 1e-7, 0.0])
def test_gains_are_the_singular_values(shape: tuple[int, int], least: float) -> None:
    draws = np.random.default_rng(sum(shape))
    for _ in range(20):
        u, s, vt = np.linalg.svd(draws.normal(size=shape), full_matrices=False)
        s[-1] *= least
        matrix, found = np.ascontiguousarray(u * s @ vt), np.empty(2)
        expected = np.linalg.svd(matrix, compute_uv=False)
        gains(matrix.copy(), found)
        assert found[0] == pytest.approx(expected[0], rel=1e-12, abs=1e-300)
        assert found[1] == pytest.approx(expected[-1], rel=1e-9, abs=1e-14 * expected[0])
