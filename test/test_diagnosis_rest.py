"""Tests of errors shared by a motion's readings, against the covariance written out in full."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import Conditions, at_rest
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.narrow import FEW
from delta_calibration.diagnosis.shared_path_error import AT_REST, SharedPathError

RNG = np.random.default_rng(1)
STOPS, EACH = 4, 6
# A sweep there and, shortly after, back; two more, elsewhere and later; and one after a stop.
BEGIN = {
    3: (0.0, 0.0, 0.3),
    4: (6.5, 0.3, 0.0),
    7: (14.0, 0.9, 0.6),
    8: (60.0, 0.6, 0.9),
    9: (82.0, 0.9, 0.6),
}
STOP = 75.0
SHARED = [(3, 4), (3, 4, 7, 8)]
PATH = np.repeat([AT_REST, *BEGIN], [STOPS, *[EACH] * 5])
OWN = RNG.standard_normal((len(PATH), 3, 2))


def conditions() -> Conditions:
    """Joint angles that continue where a path ended, or do not; a stop is in between."""
    angle, time = [np.zeros(STOPS)], [np.append(np.arange(1.0 - STOPS, 0.0), STOP)]
    for begin, first, last in BEGIN.values():
        angle.append(np.linspace(first, last, EACH))
        time.append(begin + np.arange(EACH))
    joint = np.column_stack([np.concatenate(angle)] * 3)
    return replace(at_rest(joint), time=np.concatenate(time))


@pytest.fixture(scope="module")
def rest() -> SharedPathError:
    return SharedPathError.of(PATH, conditions(), OWN)


@pytest.fixture(scope="module")
def covariance() -> np.ndarray:
    """1, and for each path its own u, what it passes on, and what it shares with others."""
    C = np.eye(3 * len(PATH))

    def add(on, factor):
        B = (factor[:, None, None] * OWN * on[:, None, None]).reshape(3 * len(PATH), -1)
        return B @ B.T

    for number in BEGIN:
        on = number == PATH
        course = np.zeros(len(PATH))
        course[on] = np.sqrt(2) * np.linspace(-0.5, 0.5, EACH)
        C += add(on, course) + add(on, np.ones(len(PATH)))
    for some in SHARED:
        C += add(np.isin(PATH, some), np.ones(len(PATH)))
    return C


@pytest.mark.parametrize("count", [1, FEW, FEW + 3])  # few columns have code of their own
def test_inner_products_are_those_under_the_covariance(rest, covariance, count) -> None:
    x = RNG.standard_normal((3 * len(PATH), count))
    solved = np.linalg.solve(covariance, x)
    np.testing.assert_allclose(rest.without(x), solved, atol=1e-12)
    np.testing.assert_allclose(rest.inner(x), x.T @ solved, atol=1e-12)
    seen = rest.seen(x)
    twice = x.T @ solved - seen.T @ (rest.weak[:, None] * seen)
    np.testing.assert_allclose(twice, solved.T @ solved, atol=1e-12)
    assert rest.taken(Plain(x)) == pytest.approx(np.sum(x**2) - np.sum(solved**2))
    assert rest.degrees == pytest.approx(len(covariance) - np.trace(np.linalg.inv(covariance)))


def test_draws_have_the_covariance(rest, covariance) -> None:
    """In forty directions, each within five standard errors."""
    count, rng = 8000, np.random.default_rng(2)
    u = rng.standard_normal((len(covariance), 40))
    chance = rng.standard_normal((len(covariance), count))
    rest.draw_into(chance, rng)
    drawn = u.T @ chance
    expected = np.einsum("ij,ik,kj->j", u, covariance, u)
    np.testing.assert_allclose(np.var(drawn, axis=1), expected, rtol=5 * np.sqrt(2 / count))


def test_some_of_the_samples_have_their_part_of_the_covariance(rest, covariance) -> None:
    """A sector may cut a path, or remove one from a sequence."""
    rows = np.flatnonzero(RNG.random(len(PATH)) < 0.6)
    kept = (3 * rows[:, None] + np.arange(3)).ravel()
    x = RNG.standard_normal((len(kept), 3))
    part = covariance[np.ix_(kept, kept)]
    np.testing.assert_allclose(rest.take(rows).without(x), np.linalg.solve(part, x), atol=1e-12)
