"""Columns kept as products give the same results as the multiplied columns."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated, narrow
from delta_calibration.diagnosis.candidates import (
    all_columns,
    columns_of,
    dimensions,
    maps,
    products_of,
    subsets,
)
from delta_calibration.diagnosis.columns import Plain, Product, Sparse, joined
from delta_calibration.diagnosis.geometry import without_geometry
from delta_calibration.diagnosis.joint_fit import JointFit, as_score
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.model import Model
from delta_calibration.diagnosis.scores import Weighed
from delta_calibration.diagnosis.set_aside import set_aside
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.effects import Stage, catalogue
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

N, D, M = 14, 3, 4


def multiplied(columns: Product) -> np.ndarray:
    """The product m phi, (d n, F m)."""
    every = np.einsum("ndm,nf->ndfm", columns.moved, columns.functions)
    return every.reshape(len(columns.moved) * columns.moved.shape[1], -1)


@pytest.fixture(name="kinds")
def kinds_fixture() -> list[tuple[object, np.ndarray]]:
    """Columns of every kind, with their multiplied form."""
    rng = np.random.default_rng(4)
    moved, other = rng.standard_normal((2, N, D, M))
    one, two = (Product(moved, rng.standard_normal((N, count))) for count in (5, 2))
    odd = Product(other, rng.standard_normal((N, 3)))
    plain = Plain(rng.standard_normal((D * N, 6)))
    own = [(each, multiplied(each)) for each in (one, two, odd)] + [(plain, plain.values)]
    for where, joint in ((moved, [2, 0, 3, 0, 3]), (other, [1, 2, 1])):  # some joints without
        functions = rng.standard_normal((len(joint), N)) * (rng.random((len(joint), N)) < 0.3)
        curves = Sparse.of(where, functions, np.array(joint))
        out = where[:, :, joint] * functions.T[:, None]
        own.append((curves, out.reshape(D * N, -1)))
    every = joined([each for each, _ in own]), np.concatenate([out for _, out in own], axis=1)
    return [*own, every]


def test_products_are_those_of_the_columns(kinds) -> None:
    y = np.random.default_rng(5).standard_normal((D * N, 7))
    for columns, out in kinds:
        assert columns.width == out.shape[1]
        np.testing.assert_allclose(columns.along(y), out.T @ y, atol=1e-12)
        np.testing.assert_allclose(columns.inner(), out.T @ out, atol=1e-12)
        np.testing.assert_allclose(columns.dense, out, atol=1e-12)
        values = np.random.default_rng(6).standard_normal((out.shape[1], 3))
        np.testing.assert_allclose(columns.times(values), out @ values, atol=1e-12)
        each = out.reshape(N, D, -1)
        np.testing.assert_allclose(columns.squares(D), np.sum(each**2, axis=(1, 2)))
        for some in (slice(2, 9), np.array([1, 7, 4]), np.arange(N) % 3 == 0):
            part = each[some].reshape(-1, out.shape[1])
            np.testing.assert_allclose(columns.part(some, D).dense, part, atol=1e-12)
        m, f = np.random.default_rng(7).standard_normal((N, D)), np.linspace(-1.0, 2.0, N)
        along = (m * f[:, None]).ravel() @ out
        np.testing.assert_allclose(f @ columns.through(m).dense, along, atol=1e-12)
        np.testing.assert_allclose(columns.through(m).along(f[:, None])[:, 0], along, atol=1e-12)
        root = np.linspace(0.0, 2.0, N)[:, None, None]
        heavy = (root * each).reshape(out.shape)
        np.testing.assert_allclose(columns.weighed(root).dense, heavy, atol=1e-12)
    for (columns, out), (other, beside) in product(kinds, kinds):
        np.testing.assert_allclose(columns.across(other), out.T @ beside, atol=1e-12)


@cache
def fit_of(name: str) -> Model:
    """Fit to a session with motions, whose readings share errors."""
    robot = load_robot(name)
    plan = make_plan("rich", robot, count=20, seed=3)
    session = simulate_session(draw_machine(robot, 3), plan, 3)
    return calibrated(survey(session, robot.joints.names), robot)


def evidence_of(name: str) -> LinearizedModel:
    """Evidence of that fit."""
    return fit_of(name).evidence


@pytest.mark.parametrize("few", [1, narrow.FEW])
@pytest.mark.parametrize("rows", [800, 801, 803])  # four at a time, and what remains
def test_few_columns_have_the_products_of_a_library(few: int, rows: int) -> None:
    rng = np.random.default_rng(few)
    x, many = rng.standard_normal((rows, few)), rng.standard_normal((rows, 60))
    exact = x.T @ many
    for some in (x, np.asfortranarray(x)):
        assert narrow.along(some, many) == pytest.approx(exact, abs=1e-11)
    assert narrow.along(x, np.asfortranarray(many)) == pytest.approx(exact, abs=1e-11)


def test_evidence_that_was_let_go_comes_back() -> None:
    fit = fit_of("five_axis")
    before = fit.evidence
    assert "evidence" in fit.memo
    fit.forget()
    assert "evidence" not in fit.memo
    assert "evidence" not in replace(fit).memo
    np.testing.assert_allclose(fit.evidence.residual, before.residual, atol=1e-9)
    np.testing.assert_allclose(fit.evidence.by_joints, before.by_joints, atol=1e-9)


def test_a_fit_that_set_nothing_aside_is_that_to_everything() -> None:
    fit = fit_of("five_axis")
    assert fit.everything() is fit
    weight = fit.cell.weight.copy()
    weight[4] = 0.0
    fewer = replace(fit, cell=replace(fit.cell, weight=weight))
    assert not fewer.evidence.believed[4]
    assert fewer.everything().evidence.believed[4]
    np.testing.assert_array_equal(set_aside(fewer.evidence, fewer.everything().evidence), [4])


def test_a_map_beside_the_geometry_is_there_as_its_columns_would_be() -> None:
    """Without multiplication: products, values, draws, degrees of freedom, subsets of samples."""
    evidence = evidence_of("five_axis")
    effect = catalogue(load_robot("five_axis"), evidence.chain.mechanism)[0]
    mapped = next(group[0] for group in maps(evidence, effect))
    kept, prior = products_of(mapped, evidence), np.full(len(mapped.rows), 0.04)
    assert isinstance(kept, Product)
    one, two = (evidence.beside(x, prior) for x in (kept, Plain(columns_of(mapped, evidence))))
    rows = np.flatnonzero(np.arange(len(evidence)) % 3 != 1)
    for a, b in ((one, two), (one.take(rows), two.take(rows))):
        assert a.degrees == pytest.approx(b.degrees, rel=1e-9)
        assert a.misfit == pytest.approx(b.misfit, rel=1e-9)
        np.testing.assert_allclose(a.best(), b.best(), atol=1e-7)
        np.testing.assert_allclose(a.left(), b.left(), atol=1e-7)
        drawn = [of.draw(3, np.random.default_rng(1)) for of in (a, b)]
        np.testing.assert_allclose(*drawn, atol=1e-8)
        np.testing.assert_allclose(a.weigh(a.column), b.weigh(b.column), atol=1e-8)
    fewer = [without_geometry(of) for of in (one, two)]
    assert len(fewer[0].precision) == len(one.precision) - evidence.geometry.shape[1]
    np.testing.assert_allclose(fewer[0].best(), fewer[1].best(), atol=1e-7)


@pytest.mark.parametrize("name", ["srbd", "five_axis"])
def test_maps_and_names_together_have_the_information_of_their_columns(name: str) -> None:
    """For every kind of map."""
    robot, evidence = load_robot(name), evidence_of(name)
    assert evidence.rest.samples
    effects = catalogue(robot, evidence.chain.mechanism)
    slightest = [group[0] for group in maps(evidence, effects[0])]
    some = [slightest[0], next(dimensions(evidence)), *slightest[1:], *subsets(effects[0])]
    kept, out = all_columns(some, evidence), [columns_of(one, evidence) for one in some]
    every = np.concatenate(out, axis=1)
    assert kept.width == every.shape[1]
    y = evidence.column
    np.testing.assert_allclose(kept.along(y), every.T @ y, rtol=1e-9, atol=1e-9)
    whole = every.T @ every  # projection may remove almost all of a column
    size = np.sqrt(np.outer(np.diag(whole), np.diag(whole)))
    found, expected = evidence.information_of(kept), evidence.information(every)
    assert np.abs((found - expected) / size).max() < 1e-10


def test_an_error_curve_is_there_as_its_columns_would_be() -> None:
    evidence = evidence_of("scara")
    effects = catalogue(load_robot("scara"), evidence.chain.mechanism)
    curve = next(e for e in effects if e.cause == "joint_error_curve")
    for shape in curve.shapes(evidence.at):
        for candidate in subsets(shape):
            kept, out = products_of(candidate, evidence), columns_of(candidate, evidence)
            assert isinstance(kept, Sparse)
            np.testing.assert_allclose(kept.dense, out, atol=1e-12)


def test_all_but_some_samples_are_those_that_remain() -> None:
    """Their sums are all sums minus the others'; results equal those of the samples alone."""
    evidence = evidence_of("five_axis")
    effect = catalogue(load_robot("five_axis"), evidence.chain.mechanism)[0]
    mapped = next(group[0] for group in maps(evidence, effect))
    evidence = evidence.beside(products_of(mapped, evidence), np.full(len(mapped.rows), 0.04))
    rows = np.flatnonzero(np.arange(len(evidence)) % 5 == 2)
    some, alone = evidence.but(rows), evidence.take(np.delete(np.arange(len(evidence)), rows))
    length = np.sqrt(np.diag(alone.normal) + 0.04)
    assert np.abs((some.normal - alone.normal) / np.outer(length, length)).max() < 1e-12
    np.testing.assert_allclose(some.best(), alone.best(), atol=1e-7)


def test_a_map_of_another_size_is_scored_as_if_its_own_products_were_known() -> None:
    """All sizes share the products of one: value, gain, evidence and probability of each."""
    evidence = evidence_of("five_axis")
    effect = catalogue(load_robot("five_axis"), evidence.chain.mechanism)[0]
    weighed = Weighed.of(evidence, np.inf, 4, np.random.default_rng(3))
    sizes = next(iter(maps(evidence, effect)))
    together = weighed.explore([sizes])
    for candidate, score in zip(sizes, together, strict=True):
        (alone,) = weighed.explore([[candidate]])
        assert score.gain == pytest.approx(alone.gain, rel=1e-9)
        assert score.log_bayes == pytest.approx(alone.log_bayes, rel=1e-9)
        assert score.log_p == pytest.approx(alone.log_p, rel=1e-6)
        np.testing.assert_allclose(score.value, alone.value, atol=1e-6)
        assert np.shares_memory(score.information, together[0].information)


def test_a_shape_without_searched_fields_pays_less_than_searched_ones() -> None:
    """Backlash that no load closes has prior odds of 4 against all frictions together."""
    evidence = evidence_of("srbd")
    effects = catalogue(load_robot("srbd"), evidence.chain.mechanism)
    weighed = Weighed.of(evidence, np.inf, 64, np.random.default_rng(3))
    backlash = next(e for e in effects if e.cause == "backlash")
    shapes = [list(subsets(shape)) for shape in backlash.shapes(evidence.at)]
    for score in weighed.explore(shapes):
        plain, searched = score.tries_of
        assert plain == 1.25
        assert searched > 2 * 5
        assert score.tries == (plain if score.candidate.plain else searched)
    lag = next(e for e in effects if e.cause == "joint_lag")
    assert {s.tries_of for s in weighed.explore([list(subsets(lag))])} == {(1.0, 1.0)}


def test_a_curve_contains_one_of_the_same_joint_and_another_resolution() -> None:
    evidence = evidence_of("scara")
    effects = catalogue(load_robot("scara"), evidence.chain.mechanism)
    curve = next(e for e in effects if e.cause == "joint_error_curve")
    fine, coarse = (list(subsets(shape)) for shape in list(curve.shapes(evidence.at))[:2])
    assert len(fine[0].rows) != len(coarse[0].rows)
    for some, others in ((fine, coarse), (coarse, fine)):
        for one in some:
            for other in others:
                inside = one.location in (None, other.location)
                assert one.contains(other) == inside


def test_what_was_recorded_is_what_the_standing_machine_has_of_it() -> None:
    evidence = fit_of("five_axis").evidence
    effects = catalogue(load_robot("five_axis"), evidence.chain.mechanism)
    moving = [e for e in effects if not e.stands and e.stage is not Stage.MEASUREMENT]
    before = [replace(evidence).columns(effect) for effect in moving]
    known = replace(evidence)
    known.columns(moving[0])
    assert "recorded" in known.memo
    assert len(known.standing) == len(known)
    for effect, columns in zip(moving, before, strict=True):
        np.testing.assert_array_equal(known.columns(effect), columns)
    assert "recorded" not in known.memo


def test_shapes_by_functions_and_on_a_grid_are_those_of_their_columns() -> None:
    """For many orders of a gear, of all joints and of one, beside a map in the nuisance."""
    evidence = bare = evidence_of("five_axis")
    effects = catalogue(load_robot("five_axis"), evidence.chain.mechanism)
    mapped = next(group[0] for group in maps(evidence, effects[0]))
    evidence = evidence.beside(products_of(mapped, evidence), np.full(len(mapped.rows), 0.04))
    gear = next(effect for effect in effects if effect.cause == "transmission_error")
    orders = np.linspace(8.0, 60.0, 30) / gear.mechanism.joint_size
    shapes = [list(subsets(replace(gear, cycles=order))) for order in orders.tolist()]
    y = np.random.default_rng(8).standard_normal((evidence.size, 3))
    for about in (Shapes(evidence, y), Shapes(bare, y)):
        for candidates in (shapes[:5], shapes):  # few by functions, many on a grid
            for each in ([group[0] for group in candidates], [group[-1] for group in candidates]):
                columns = np.concatenate([columns_of(c, about.evidence) for c in each], axis=1)
                k = len(each[0].rows)
                expected = about.evidence.information_of_each(columns, k)
                found, along = (
                    np.concatenate(part) for part in list(zip(*about.each(each), strict=True))[1:]
                )
                scale = np.abs(expected).max()
                np.testing.assert_allclose(found, expected, atol=1e-10 * scale)
                beside = (columns.T @ y).reshape(along.shape)
                np.testing.assert_allclose(along, beside, atol=1e-10 * np.abs(beside).max())


def test_one_beside_what_is_kept_is_as_likely_as_among_all() -> None:
    evidence = evidence_of("five_axis")
    effects = catalogue(load_robot("five_axis"), evidence.chain.mechanism)
    mapped = next(group[0] for group in maps(evidence, effects[0]))
    scores = [as_score(c, ()) for e in effects[:6] for c in list(subsets(e))[:2]]
    scores.append(as_score(mapped, ()))
    whole = JointFit.of(evidence, scores)
    for kept in (0, 2):
        some = JointFit.one_beside(evidence, scores[:kept], scores[kept:])
        for i in range(kept, len(scores)):
            together = (*range(kept), i)
            np.testing.assert_allclose(some.fit(together), whole.fit(together), rtol=1e-6)
