"""Studentized residuals, compared with random draws and with fits without a place."""

from __future__ import annotations

import numpy as np

from delta_calibration.estimation.cross_validation import Known, studentized

RNG = np.random.default_rng(11)
POSES, NUMBERS, UNKNOWNS = 40, 3, 30
PLACE = np.repeat(np.arange(POSES // 4), 4)[RNG.permutation(POSES)]
SLOPE = RNG.standard_normal((POSES, NUMBERS, UNKNOWNS))
FLAT = SLOPE.reshape(-1, UNKNOWNS)
PRIOR = np.r_[np.full(20, 4.0), np.zeros(10)]  # no prior for the last


def known(residual: np.ndarray) -> Known:
    return Known(FLAT.T @ FLAT, FLAT.T @ residual.reshape(-1), PRIOR)


def test_their_covariance_is_that_of_the_noise_at_every_place() -> None:
    """4000 draws of unknowns from their priors, with noise of variance 1."""
    std = np.where(PRIOR > 0, 1 / np.sqrt(np.maximum(PRIOR, 1e-9)), 10.0)
    drawn = []
    for _ in range(4000):
        truth = std * RNG.standard_normal(UNKNOWNS)
        residual = SLOPE @ truth + RNG.standard_normal((POSES, NUMBERS))
        drawn.append(studentized(known(residual), SLOPE, residual, PLACE))
    for place in np.unique(PLACE):
        own = np.array(drawn)[:, place == PLACE].reshape(4000, -1)
        np.testing.assert_allclose(own.T @ own / 4000, np.eye(own.shape[1]), atol=0.12)
    whole = FLAT.T @ FLAT + np.diag(PRIOR)
    left = np.eye(len(FLAT)) - FLAT @ np.linalg.solve(whole, FLAT.T)
    assert np.trace(left @ left) < 0.85 * len(FLAT)  # plain residuals would be clearly smaller


def test_they_lie_between_residuals_and_what_is_missed_without_the_place() -> None:
    """u^T u = e^T f, where f is from a fit of the other places alone."""
    residual = RNG.standard_normal((POSES, NUMBERS))
    found = studentized(known(residual), SLOPE, residual, PLACE)
    for place in np.unique(PLACE):
        own, z = place == PLACE, []
        for rows in (slice(None), ~own):
            flat = SLOPE[rows].reshape(-1, UNKNOWNS)
            stacked = np.vstack([flat, np.diag(np.sqrt(PRIOR))])
            data = np.r_[residual[rows].reshape(-1), np.zeros(UNKNOWNS)]
            z.append(np.linalg.lstsq(stacked, data)[0])
        by_all, without = ((residual[own] - SLOPE[own] @ each).reshape(-1) for each in z)
        np.testing.assert_allclose(np.sum(found[own] ** 2), by_all @ without, rtol=1e-9)
