"""Columns kept as products do what the same columns do once they are multiplied out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.candidates import (
    all_columns,
    columns_of,
    dimensions,
    maps,
    subsets,
)
from delta_calibration.diagnosis.columns import Plain, Product, joined
from delta_calibration.effects import catalogue
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

N, D, M = 14, 3, 4


def multiplied(columns: Product) -> np.ndarray:
    """m phi, (d n, F m)."""
    every = np.einsum("ndm,nf->ndfm", columns.moved, columns.functions)
    return every.reshape(len(columns.moved) * columns.moved.shape[1], -1)


@pytest.fixture(name="kinds")
def kinds_fixture() -> list[tuple[object, np.ndarray]]:
    """Columns of every kind, with what they are when multiplied out."""
    rng = np.random.default_rng(4)
    moved, other = rng.standard_normal((2, N, D, M))
    one, two = (Product(moved, rng.standard_normal((N, count))) for count in (5, 2))
    odd = Product(other, rng.standard_normal((N, 3)))
    plain = Plain(rng.standard_normal((D * N, 6)))
    own = [(each, multiplied(each)) for each in (one, two, odd)] + [(plain, plain.values)]
    every = joined([each for each, _ in own]), np.concatenate([out for _, out in own], axis=1)
    return [*own, every]


def test_products_are_those_of_the_columns(kinds) -> None:
    y = np.random.default_rng(5).standard_normal((D * N, 7))
    for columns, out in kinds:
        assert columns.width == out.shape[1]
        np.testing.assert_allclose(columns.along(y), out.T @ y, atol=1e-12)
        np.testing.assert_allclose(columns.inner(), out.T @ out, atol=1e-12)
        some = slice(2 * D, 9 * D)
        np.testing.assert_allclose(columns.rows(some).along(y[some]), out[some].T @ y[some])
    for (columns, out), (other, beside) in product(kinds, kinds):
        np.testing.assert_allclose(columns.across(other), out.T @ beside, atol=1e-12)


@pytest.mark.parametrize("name", ["srbd", "five_axis"])
def test_maps_and_names_together_have_the_information_of_their_columns(name: str) -> None:
    """Of a session with motions, whose readings share errors, under every kind of map."""
    robot = load_robot(name)
    plan = make_plan("rich", robot, count=20, seed=3)
    session = simulate_session(draw_machine(robot, 3), plan, 3)
    evidence = calibrated(survey(session, robot.joints.names), robot).evidence
    assert evidence.rest.samples
    effects = catalogue(robot, evidence.chain.mechanism)
    slightest = [group[0] for group in maps(evidence, effects[0])]
    some = [slightest[0], next(dimensions(evidence)), *slightest[1:], *subsets(effects[0])]
    kept, out = all_columns(some, evidence), [columns_of(one, evidence) for one in some]
    every = np.concatenate(out, axis=1)
    assert kept.width == every.shape[1]
    y = evidence.column
    np.testing.assert_allclose(kept.along(y), every.T @ y, rtol=1e-9, atol=1e-9)
    whole = every.T @ every  # what is projected out can be all but all of a column
    size = np.sqrt(np.outer(np.diag(whole), np.diag(whole)))
    found, expected = evidence.information_of(kept), evidence.information(every)
    assert np.abs((found - expected) / size).max() < 1e-10
