"""Tails of distributions and Halton points, compared with scipy.stats."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from delta_calibration.diagnosis import tails
from delta_calibration.fleet.shared import _log_beta_binomial
from delta_calibration.geometry.halton import halton


@pytest.mark.parametrize("k", [1, 3, 6, 0.7, 135.4])
@pytest.mark.parametrize("x", [-2.0, 0.0, 1e-3, 0.8, 4.0, 60.0, 1e5])
def test_logarithms_of_tails(x: float, k: float) -> None:
    assert tails.log_chi2(x, k) == pytest.approx(stats.chi2.logsf(x, k), rel=1e-12, abs=1e-12)
    assert tails.log_t(x, k) == pytest.approx(stats.t.logsf(x, k), rel=1e-12, abs=1e-12)
    for n in (2.5, 40.0, 1e6):
        theirs = stats.f.logsf(x, k, n)
        assert tails.log_f(x, k, n) == pytest.approx(theirs, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("skewness", [-3.0, -0.2, -1e-6, 0.0, 1e-6, 1e-4, 0.2, 3.0])
@pytest.mark.parametrize("x", [-9.0, -1.0, 0.0, 0.3, 2.0, 9.0])
def test_pearsons_law(x: float, skewness: float) -> None:
    theirs = stats.pearson3.sf(x, skewness)
    assert tails.pearson3(x, skewness) == pytest.approx(theirs, rel=1e-6, abs=1e-12)


def test_moments() -> None:
    x = np.random.default_rng(1).gamma(2.0, size=200)
    theirs = stats.skew(x), stats.kurtosis(x)
    assert tails.moments(x) == pytest.approx(theirs, rel=1e-12)


@pytest.mark.parametrize("size", [1, 3, 8, 30])
def test_points_of_halton(size: int) -> None:
    engine = stats.qmc.Halton(size, scramble=False)
    assert np.array_equal(halton(100, size), engine.random(100))
    assert np.array_equal(halton(700, size, 100), engine.random(700))


@pytest.mark.parametrize(("n", "a", "b"), [(1, 0.3, 8.0), (20, 0.02, 1.7), (108, 2.0, 5.0)])
def test_counts_of_rates_that_scatter(n: int, a: float, b: float) -> None:
    k = np.arange(n + 1)
    theirs = stats.betabinom.logpmf(k, n, a, b)
    np.testing.assert_allclose(_log_beta_binomial(k, n, a, b), theirs, rtol=1e-10, atol=1e-10)
