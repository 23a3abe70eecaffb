"""Observability: rank and redundancies of the real robot, indices of small matrices."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.estimation import chain_of, identify
from delta_calibration.estimation.observability import observe, strong_correlations
from identification_bench import ROBOT, found, rms
from six_rods import SixRods


@pytest.mark.parametrize(
    ("model", "rank", "columns"), [("six_rod_delta", 38, 75), ("rotary_delta", 24, 33)]
)
def test_rank_and_each_sentence_about_what_does_not_show(model, rank, columns):
    """The stated combination moves the readings as the parameter does.

    The derivatives are differences of the chain, for six rods those of the independent model.
    """
    _, poses, result = found(0)
    if model != "six_rod_delta":
        result = identify(poses, ROBOT, model)
    seen = result.observability
    assert (seen.rank, seen.columns) == (rank, columns)
    assert len(seen.redundancies) == columns - rank
    frame = result.chain.split(result.theta)[2]
    chain = chain_of(ROBOT, model)
    nominal = chain.join(chain.mechanism.parameters.nominal, chain.offset, frame)

    def column(name):
        h, row = 1e-6, chain.parameters.row(name)
        if model == "six_rod_delta" and row < 66:
            up, down = (SixRods({name: d}).point(poses.joint) for d in (h, -h))
            return (up - down).reshape(-1, 3) @ frame.rotation.T / (2 * h)
        d = h * (np.arange(len(nominal)) == row)
        up, down = (chain.predict(poses.conditions, t) for t in (nominal + d, nominal - d))
        return (up - down) / (2 * h)

    for redundancy in seen.redundancies:
        own = column(redundancy.parameter)
        mixture = sum((value * column(name) for name, value in redundancy.same_as), 0 * own)
        scale = max(rms(own), 1e-3 * rms(column("joint_zero_1")))
        assert rms(own - mixture) < 0.02 * scale, redundancy.sentence()


def test_neighbours_are_named():
    sentences = [r.sentence() for r in found(0)[2].observability.redundancies]
    assert any(
        s.startswith("platform_radial_1 has the same effect as -1 base_radial_1")
        for s in sentences
    )
    assert any(s.startswith("tracker_place_x has the same effect as") for s in sentences)


def test_a_doubled_and_a_silent_column_are_said_in_their_own_units():
    """c = 3 a - 2 b in the units of the columns, whatever their scales; d has no effect."""
    rng = np.random.default_rng(10)
    a, b = rng.normal(size=(2, 8, 3, 1))
    jacobian = np.concatenate([a, b, 3 * a - 2 * b, 0 * a], axis=-1)
    seen = observe(jacobian, np.array([1e-3, 1e-6, 0.25, 1.0]), ("a", "b", "c", "d"))
    assert (seen.rank, seen.columns) == (2, 4)
    assert [r.parameter for r in seen.redundancies] == ["c", "d"]
    assert dict(seen.redundancies[0].same_as) == pytest.approx({"a": 3, "b": -2})
    assert seen.redundancies[1].sentence() == "d has no visible effect"


def test_indices_of_singular_values_that_are_known():
    """Five poses with scaled singular values 8, 4 and 1."""
    u = np.linalg.qr(np.random.default_rng(11).normal(size=(15, 3)))[0]
    scale = np.array([0.5, 2.0, 1e-3])
    jacobian = (u * [8.0, 4.0, 1.0] / scale).reshape(5, 3, 3)
    indices = observe(jacobian, scale, ("a", "b", "c")).indices
    expected = {"O1": 32 ** (1 / 3) / np.sqrt(5), "O2": 1 / 8, "O3": 1.0, "O4": 1 / 8}
    assert indices == pytest.approx(expected)


def test_no_correlation_is_beyond_one():
    """The covariance is accurate to three digits only, which gives a correlation of -1.002."""
    pairs = strong_correlations(np.array([[1.0, -1.002], [-1.002, 1.0]]), ("a", "b"))
    assert pairs == (("a", "b", -1.0),)


def test_only_strong_correlations_are_named_strongest_first():
    correlation = np.array([[1, 0.96, 0.1], [0.96, 1, -0.99], [0.1, -0.99, 1]])
    sigma = np.array([1e-3, 2.0, 1e-6])
    pairs = strong_correlations(correlation * np.outer(sigma, sigma), ("a", "b", "c"))
    assert [(one, other) for one, other, _ in pairs] == [("b", "c"), ("a", "b")]
    assert [value for *_, value in pairs] == pytest.approx([-0.99, 0.96])
