"""Places left out of a fit, against fits that are made without them."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.estimation.cross_validation import Known, left_out

RNG = np.random.default_rng(11)
POSES, NUMBERS, UNKNOWNS = 40, 3, 9
PLACE = np.repeat(np.arange(POSES // 4), 4)[RNG.permutation(POSES)]
SLOPE = RNG.standard_normal((POSES, NUMBERS, UNKNOWNS))
RESIDUAL = RNG.standard_normal((POSES, NUMBERS))
PRIOR = np.diag(np.r_[np.ones(6), np.zeros(3)])  # the last have none


def rows(own):
    return SLOPE[own].reshape(-1, UNKNOWNS), RESIDUAL[own].reshape(-1)


@pytest.mark.parametrize("spread", [0.7, 1.0, 3.5])
def test_a_place_left_out_is_one_that_the_fit_has_not_seen(spread) -> None:
    flat, residual = rows(slice(None))
    known = Known(flat.T @ flat, flat.T @ residual, np.diag(PRIOR))
    found = left_out(known, SLOPE, RESIDUAL, PLACE, spread)
    for place in np.unique(PLACE):
        own = np.flatnonzero(place == PLACE)
        flat, residual = rows(place != PLACE)
        stacked = np.vstack([flat, np.sqrt(PRIOR)])
        best = np.linalg.lstsq(stacked, np.r_[residual, np.zeros(UNKNOWNS)])[0]
        by = np.linalg.pinv(stacked)  # the unknowns from readings and priors
        noise = np.r_[np.full(len(flat), max(1.0, spread)), np.ones(UNKNOWNS)]
        uncertain = by @ np.diag(noise) @ by.T
        np.testing.assert_allclose(found.missed[own], RESIDUAL[own] - SLOPE[own] @ best, atol=1e-9)
        expected = SLOPE[own] @ uncertain @ np.swapaxes(SLOPE[own], 1, 2)
        np.testing.assert_allclose(found.covariance[own], expected, atol=1e-9)
