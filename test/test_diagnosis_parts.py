"""Tests of the parts of a diagnosis, each against a result computed in another way."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from scipy.stats import chi2, f_oneway, kstest, multivariate_normal

from blind.session import hide
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import (
    calibrated,
    cross_validation,
    findings,
    identifiability,
    model,
    model_selection,
    residual_tests,
    rivals,
    scores,
)
from delta_calibration.diagnosis.candidates import Candidate, columns_of, maps, subsets
from delta_calibration.diagnosis.columns import Plain
from delta_calibration.diagnosis.joint_fit import JointFit, as_score
from delta_calibration.diagnosis.scan import Scan
from delta_calibration.diagnosis.scores import Weighed
from delta_calibration.effects import EFFECTS, catalogue
from delta_calibration.effects.joint_compliance import JointCompliance
from delta_calibration.effects.unexplained import Unexplained
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")


def measured(count=24, both_sides=True, masses=(0.0, 2.0), model=None, radius=None, **streams):
    """Evidence of stops of a simulated machine without hidden causes."""
    part = {} if radius is None else {"radius": radius}
    plan = make_plan("identify", ROBOT, count=count, both_sides=both_sides, **part)
    payload = np.array(masses)[np.arange(len(plan)) // 2 % len(masses)]
    session = simulate_session(draw_machine(ROBOT, 5), replace(plan, payload=payload), 5)
    seen = survey(replace(session, **streams), ROBOT.joints.names)
    return calibrated(seen, ROBOT, model).evidence


@pytest.fixture(scope="module")
def evidence():
    """48 stops from both sides under two payloads; 3 coordinates each, 69 nuisance parameters."""
    return measured()


@pytest.fixture(scope="module")
def wide():
    """The same at 60 places."""
    return measured(count=60)


@pytest.fixture(scope="module")
def dense(evidence):
    """V^-1 with everything without prior projected out, and V of the rest, both (3 n, 3 n)."""
    flat = evidence.nuisance.reshape(evidence.size, -1)
    known = evidence.precision > 0
    V = np.eye(evidence.size) + flat[:, known] / evidence.precision[known] @ flat[:, known].T
    inverse, F = np.linalg.inv(V), flat[:, ~known]
    assert F.shape[1] == 6  # the tracker frame
    seen = inverse @ F
    return inverse - seen @ np.linalg.solve(F.T @ seen, seen.T), V


def candidate(evidence, cause, location=None):
    shape = next(iter(EFFECTS[cause](ROBOT, evidence.chain.mechanism).shapes(evidence.at)))
    return next(c for c in subsets(shape) if c.location == location)


def named_by(evidence, signal, *others):
    """The candidates that are equivalent to a signal."""
    return rivals.equivalents(evidence, signal, [SimpleNamespace(candidate=c) for c in others])


def with_residual(evidence, residual):
    return replace(evidence, residual=np.asarray(residual).reshape(-1, 3))


# Terms


def test_a_finer_map_takes_the_place_of_a_coarse_one_of_the_same_name() -> None:
    """Both are maps over the payload; each name has only one term."""
    trial = hide({"unknown:grip": 3.0}, 5, "still")
    model = calibrated(survey(trial.session, ROBOT.joints.names), ROBOT)
    effects = catalogue(ROBOT, model.problem.chain.mechanism)
    coarse, fine = (
        next(c for one in maps(model.evidence, effects[0]) for c in one if wanted(c.effect))
        for wanted in (
            lambda e: e.family == "payload" and not e.centres,
            lambda e: e.family == "payload" and e.centres,
        )
    )
    here = Scan((as_score(fine, ()),), 1)
    model = model.fitted((coarse,))
    terms = model_selection.improved(model, here, here.scores[0], here.scores)
    assert terms == (fine,)


# Noise


def test_what_a_cause_found_does_between_repeats_is_no_noise() -> None:
    """Noise of a compliant machine and of a stiff one; without a finding it is unchanged."""
    soft, stiff = (
        calibrated(survey(hide(causes, 41, "still").session, ROBOT.joints.names), ROBOT)
        for causes in ({"joint_compliance": 2.0, "backlash": 1.0}, {})
    )
    causes = [candidate(soft.evidence, cause) for cause in ("joint_compliance", "backlash")]
    quiet = soft.quieter(soft.fitted(tuple(causes)))
    assert soft.floor > 1.3 * stiff.floor
    assert quiet.floor == pytest.approx(stiff.floor, rel=0.02)
    assert soft.quieter(soft) is soft
    found = stiff.fitted((candidate(stiff.evidence, "joint_compliance"),))
    assert stiff.quieter(found) is stiff


# Evidence


def test_inner_products_are_those_under_the_whole_covariance(evidence, dense) -> None:
    rng = np.random.default_rng(1)
    a = rng.standard_normal((evidence.size, 4))
    np.testing.assert_allclose(evidence.weigh(a), dense[0] @ a, atol=1e-7)
    np.testing.assert_allclose(evidence.information(a), a.T @ dense[0] @ a, atol=1e-6)
    flat = evidence.nuisance.reshape(evidence.size, -1)
    frame = flat[:, evidence.precision == 0]
    assert np.abs(evidence.weigh(frame)).max() < 1e-6 * np.abs(frame).max()


def test_the_most_likely_nuisance_is_that_of_generalised_least_squares(evidence, dense) -> None:
    """The frame by Gauss-Markov, parameters with a prior by their regression on the rest."""
    flat, known = evidence.nuisance.reshape(evidence.size, -1), evidence.precision > 0
    r, V = evidence.column[:, 0], dense[1]
    F, K = flat[:, ~known], flat[:, known]
    frame = np.linalg.solve(F.T @ np.linalg.solve(V, F), F.T @ np.linalg.solve(V, r))
    rest = K.T @ np.linalg.solve(V, r - F @ frame) / evidence.precision[known]
    np.testing.assert_allclose(evidence.best()[~known], frame, atol=1e-7)
    np.testing.assert_allclose(evidence.best()[known], rest, atol=1e-7)
    left = r - F @ frame - K @ rest
    np.testing.assert_allclose(evidence.left().ravel(), left, atol=1e-7)
    np.testing.assert_allclose(left, dense[0] @ r, atol=1e-6)  # and therefore V^-1 r
    assert evidence.degrees == pytest.approx(np.trace(dense[0]), abs=1e-6)


def test_draws_have_the_covariance_of_the_model(evidence, dense) -> None:
    """In forty directions, each sample variance within five standard errors."""
    rng, count = np.random.default_rng(2), 4000
    u = rng.standard_normal((evidence.size, 40))
    u /= np.sqrt(np.einsum("ij,ik,kj->j", u, dense[1], u))
    spread = np.var(u.T @ evidence.draw(count, rng), axis=1)
    np.testing.assert_allclose(spread, 1.0, atol=5 * np.sqrt(2 / count))


@pytest.mark.parametrize("moving", [False, True])
def test_what_a_fit_leaves_of_noise_has_the_covariance_of_the_whole_fit(moving) -> None:
    """At the poses alone and in motion alone, although both are fitted together."""
    seen = survey(hide({}, 7, "rich").session, ROBOT.joints.names)
    evidence = calibrated(seen, ROBOT).beside
    assert 50 < evidence.poses < len(evidence) - 50
    rows = np.flatnonzero(
        evidence.believed & ((np.arange(len(evidence)) >= evidence.poses) == moving)
    )
    rng = np.random.default_rng(4)
    # lengthwise to the shapes that a fit takes most from, and across
    taken = evidence.nuisance[rows][..., :30].reshape(3 * len(rows), -1)
    u = np.concatenate([taken, rng.standard_normal((3 * len(rows), 10))], axis=1)
    u /= np.linalg.norm(u, axis=0)
    whole = np.zeros((*evidence.residual.shape, u.shape[1]))
    whole[rows] = u.reshape(len(rows), 3, -1)
    flat = whole.reshape(evidence.size, -1)
    expected = np.einsum("nk,nk->k", flat, evidence.weigh(flat))
    assert expected.min() < 0.5
    drawn = next(evidence.noise_left(rows, 4000, rng)).reshape(3 * len(rows), -1)
    np.testing.assert_allclose(np.var(u.T @ drawn, axis=1), expected, rtol=0.12, atol=1e-4)


# Scores


def test_decrease_is_that_of_two_nested_fits(evidence) -> None:
    """Chi square with and without the columns, both by least squares on rows."""
    columns = columns_of(candidate(evidence, "joint_scale"), evidence)
    rows = np.diag(np.sqrt(evidence.precision))
    flat = evidence.nuisance.reshape(evidence.size, -1)
    without = np.concatenate([flat, rows])
    extra = np.concatenate([columns, np.zeros((len(rows), 3))])
    y = np.concatenate([evidence.column[:, 0], np.zeros(len(rows))])
    square = [
        np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2)
        for A in (without, np.concatenate([without, extra], axis=1))
    ]
    b = columns.T @ evidence.weigh(evidence.column)
    (gained,) = scores.free_decrease(evidence.information(columns), b)
    assert gained == pytest.approx(square[0] - square[1], rel=1e-6)


def test_p_is_that_of_an_analysis_of_variance() -> None:
    rng = np.random.default_rng(3)
    groups = [rng.normal(shift, 1.0, 12) for shift in (0.0, 0.3, 0.9, 0.2)]
    every, n = np.concatenate(groups), 48
    means = np.repeat([g.mean() for g in groups], 12)
    variance = np.sum((every - means) ** 2) / (n - 4)
    gained = np.sum((means - every.mean()) ** 2) / variance
    by_both = [np.exp(scores.log_p_of(gained, 3, degrees)) for degrees in (n - 4, np.inf)]
    assert by_both == pytest.approx([f_oneway(*groups).pvalue, chi2.sf(gained, 3)], rel=1e-9)
    assert scores.log_p_of(5000.0, 3, np.inf) < -2000  # and no logarithm of zero


def test_the_bayes_factor_is_that_of_two_densities(evidence) -> None:
    """r ~ N(0, V) against r ~ N(0, V + 25 X X'), with all priors finite."""
    proper = replace(evidence, precision=np.where(evidence.precision > 0, evidence.precision, 1.0))
    flat = proper.nuisance.reshape(proper.size, -1)
    V = np.eye(proper.size) + flat / proper.precision @ flat.T
    for cause in ("joint_compliance", "tracker_scale"):
        X = columns_of(candidate(proper, cause), proper)
        r = proper.draw(1, np.random.default_rng(4))[:, 0] + X @ np.linspace(0.5, 1.0, X.shape[1])
        G, b = proper.information(X), X.T @ proper.weigh(r[:, None])[:, 0]
        free = np.full(len(b), np.inf)
        v = scores.most_likely(G, b, -free, free)
        null, other = (
            multivariate_normal(np.zeros(len(r)), C).logpdf(r) for C in (V, V + 25 * X @ X.T)
        )
        assert scores.log_bayes(G, b, v) == pytest.approx(other - null, abs=1e-4)


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("size", [0.0, 0.1, 0.5, 2.0])
def test_a_size_that_is_not_known_is_integrated_over(evidence, k: int, size: float) -> None:
    """Compared with densities at 400 sizes over three decades, r ~ N(0, V + s^2 X X')."""
    proper = replace(evidence, precision=np.where(evidence.precision > 0, evidence.precision, 1.0))
    flat = proper.nuisance.reshape(proper.size, -1)
    V = np.eye(proper.size) + flat / proper.precision @ flat.T
    X = columns_of(candidate(proper, "joint_compliance"), proper)[:, :k]
    r = proper.draw(1, np.random.default_rng(4))[:, 0] + size * X @ np.linspace(0.7, 1.3, k)
    inverse = np.linalg.inv(V)
    G, b = X.T @ inverse @ X, X.T @ inverse @ r
    each = np.geomspace(5.0 / 1000, 5.0, 400)
    log_b = [
        b @ np.linalg.solve(G + np.eye(k) / s**2, b) / 2
        - np.linalg.slogdet(np.eye(k) + s**2 * G)[1] / 2
        for s in each
    ]
    free = np.full(k, np.inf)
    v = scores.most_likely(G, b, -free, free)
    told = scores.log_bayes(G, b, v, [slice(0, k)])
    exact = logsumexp(log_b) - np.log(len(each))
    # Without a signal the most probable size is zero, and the sharp peak that is assumed is not
    # there.
    assert told == pytest.approx(exact, abs=0.3) if exact > 10 else exact - 2 < told < exact


def test_a_map_pays_for_every_size_and_width_that_it_could_have_had(evidence) -> None:
    """Compared with densities, r ~ N(0, V + 25 X X') of a map, all its forms equally probable."""
    proper = replace(evidence, precision=np.where(evidence.precision > 0, evidence.precision, 1.0))
    flat = proper.nuisance.reshape(proper.size, -1)
    V = np.eye(proper.size) + flat / proper.precision @ flat.T
    r = proper.column[:, 0]
    nothing = multivariate_normal(np.zeros(len(r)), V).logpdf(r)
    weighed = Weighed.of(proper, np.inf, 1, np.random.default_rng(0))
    groups = list(maps(proper, catalogue(ROBOT, proper.chain.mechanism)[0]))
    forms = Counter(one.label for group in groups for one in group)
    assert len(set(forms.values())) > 1
    for group in groups:
        (told,) = (s for s in weighed.explore([group]) if s.candidate is group[2])
        X = columns_of(group[2], proper)
        there = multivariate_normal(np.zeros(len(r)), V + 25 * X @ X.T).logpdf(r)
        among = np.log(forms[group[2].label])
        assert told.log_bayes == pytest.approx(there - nothing - among, abs=1e-4)
        together = JointFit.of(proper, [told]).fit((0,))[1]
        assert together == pytest.approx(there - nothing - among, abs=1e-4)


@pytest.fixture(scope="module")
def nothing(evidence):
    """p of one candidate, and of one that was searched over 24 shapes, in 300 clean sessions."""
    rng = np.random.default_rng(6)
    one = [[candidate(evidence, "encoder_eccentricity")]]
    effect = EFFECTS["transmission_error"](ROBOT, evidence.chain.mechanism)
    many = [[next(subsets(s))] for s in list(effect.shapes(evidence.at))[::2][:24]]
    drawn, p = evidence.draw(300, rng), []
    for column in drawn.T:
        clean = with_residual(evidence, column)
        weighed = Weighed.of(clean, np.inf, 64, rng)
        p.append([np.exp(weighed.explore(shapes)[0].log_p) for shapes in (one, many)])
    return np.array(p)


def test_p_is_uniform_where_there_is_nothing(nothing) -> None:
    """A little conservative: the value is limited to what is to be expected."""
    assert kstest(nothing[:, 0], "uniform").pvalue > 0.01


@pytest.mark.parametrize("size", [1e-6, 1e-5, 3e-4])
def test_p_of_a_map_is_uniform_however_short_it_is_held(evidence, size) -> None:
    """Bumps with a narrow prior explain less by chance than their number suggests."""
    rng = np.random.default_rng(11)
    effect = Unexplained.over(
        candidate(evidence, "backlash").effect, "position", evidence.at.joint, size, reach=0.25
    )
    (one,) = subsets(effect)
    columns = columns_of(one, evidence)
    G, chance = evidence.information(columns), []
    free = np.full(len(G), np.inf)
    for b in (columns.T @ evidence.weigh(evidence.draw(400, rng))).T:
        gained = scores.decrease(G, b, scores.most_likely(G, b, -free, free))
        chance.append(np.exp(scores.Chance.of(G).log_p(gained, np.inf)))
    assert kstest(chance, "uniform").pvalue > 0.01
    assert scores.Chance.of(G).degrees < len(G)


def test_p_of_a_search_is_paid_for(nothing) -> None:
    """The bootstrap gives about one p in twenty below 5 %, instead of one in three."""
    share = np.mean(nothing[:, 1] < 0.05)
    assert 0.015 < share < 0.09
    assert np.mean(nothing[:, 1] < 0.3) > 0.15


def test_effects_that_move_everything_alike_are_one_class(evidence, dense) -> None:
    """At rest friction is equivalent to half a gap, and a scale is not."""
    gap, stick, scale = (
        candidate(evidence, cause, "joint_2")
        for cause in ("backlash", "stick_slip", "joint_scale")
    )
    X, (y,), W = columns_of(stick, evidence), columns_of(scale, evidence).T, dense[0]
    alike = columns_of(gap, evidence)[:, 0]
    assert [c.cause for c in named_by(evidence, alike, scale, stick)] == ["stick_slip"]
    other = y - X[:, 0] * (X.T @ W @ y / (X.T @ W @ X)[0, 0])  # orthogonal to friction
    alike, other = (v / np.sqrt(v @ W @ v) for v in (alike, other))
    for same, apart, found in ((991, 9, 1), (91, 9, 1), (89, 11, 0), (979, 21, 0), (979, 19, 1)):
        signal = np.sqrt(same) * alike + np.sqrt(apart) * other
        assert len(named_by(evidence, signal, stick)) == found  # 18 degrees, chi square of 20


# Held-out data


def test_parts_are_disjoint_cover_and_lie_together(evidence) -> None:
    place = evidence.chain.mechanism.position(evidence.pose)
    bearing = np.arctan2(place[:, 1], place[:, 0])
    parts = cross_validation.sectors(evidence), cross_validation.stretches(evidence)
    for part, along in zip(parts, (bearing, evidence.at.time), strict=True):
        numbers, sizes = np.unique(part, return_counts=True)
        assert numbers.tolist() == [0, 1, 2, 3, 4]
        assert sizes.sum() == len(evidence)
        assert np.ptp(sizes) <= 2
        ends = [(along[part == k].min(), along[part == k].max()) for k in numbers]
        assert all(end < begin for (_, end), (begin, _) in pairwise(ends))
    cells = np.round(place / 0.05)
    for cell in np.unique(cells, axis=0):
        assert (
            len(np.unique(cross_validation.scattered(evidence)[(cells == cell).all(axis=1)])) == 1
        )


@pytest.mark.parametrize("name", ["five_axis", "scara", "srbd", "ur10"])
def test_sectors_are_alike_wherever_a_machine_works(name) -> None:
    """The five-axis machine works in a vertical plane, which has only two bearings about z."""
    robot = load_robot(name)
    mechanism = robot.commanded
    plan = make_plan("identify", robot, count=100, both_sides=False)
    place = mechanism.position(mechanism.forward(plan.joint, mechanism.parameters.nominal))
    bearing = cross_validation.bearings(place)
    assert len(np.unique(np.round(bearing, 6))) > 50  # they were two on the five-axis machine
    turned = place @ Rotation.from_euler("z", 0.3).as_matrix().T  # for any direction of x
    before, after = (cross_validation.bearings(each) for each in (place, turned))
    if name == "five_axis":
        np.testing.assert_allclose(np.sin(after), np.sin(before), atol=1e-9)
    else:
        np.testing.assert_allclose(np.mod(after - before, 2 * np.pi), 0.3)


@pytest.mark.parametrize("way", [(1.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.3, 0.5, 0.8)])
def test_sectors_of_a_line_lie_one_behind_the_other(way: tuple[float, float, float]) -> None:
    """Through the axis it has two bearings about z, and rounding would divide one of them."""
    along = np.linspace(-0.4, 0.4, 50)
    rounding = np.random.default_rng(1).uniform(-1e-13, 1e-13, (50, 3))
    place = along[:, None] * way + (0.0, 0.0, -0.7) + rounding
    bearing = cross_validation.bearings(place)
    assert abs(np.diff(np.sign(np.diff(bearing)))).sum() == 0


def test_motions_in_one_sector_of_the_poses_are_parted_by_their_own() -> None:
    """The poses stay unchanged: without one sector of either there is enough of both."""
    angle = np.concatenate([np.linspace(-3.1, 3.1, 100), np.linspace(0.1, 0.3, 50)])
    place = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)

    class Session(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.pose)

    mechanism = SimpleNamespace(position=lambda pose: pose)
    session = Session(pose=place, poses=100, chain=SimpleNamespace(mechanism=mechanism))
    by_poses = cross_validation.sectors(session)
    by_motions = cross_validation.sectors_of_motion(session)
    assert len(set(by_poses[100:])) == 1
    np.testing.assert_array_equal(by_motions[:100], by_poses[:100])
    assert np.bincount(by_motions[100:]).tolist() == [10] * 5


def test_sectors_of_a_single_place_are_one() -> None:
    for count in (1, 7):
        bearing = cross_validation.bearings(np.tile([0.1, 0.2, -0.7], (count, 1)))
        np.testing.assert_allclose(bearing, bearing[0])


def test_a_sector_is_predicted_by_the_others_alone(evidence) -> None:
    """Compared with ridge regression on the other rows; its own readings have no influence."""
    part = cross_validation.sectors(evidence)
    out = part == 2
    others = np.repeat(~out, 3)
    flat = evidence.nuisance.reshape(evidence.size, -1)
    prior = np.sqrt(max(1.0, evidence.misfit) * evidence.precision)
    rows = np.concatenate([flat[others], np.diag(prior)])
    y = np.append(evidence.column[others, 0], np.zeros(len(evidence.precision)))
    z = np.linalg.lstsq(rows, y, rcond=None)[0]
    missed = evidence.residual[out] - evidence.nuisance[out] @ z
    missed = np.linalg.solve(evidence.whiten[out], missed[..., None])[..., 0]
    found = cross_validation.held_out(evidence, part)
    np.testing.assert_allclose(found.square[out], np.sum(missed**2, axis=1), rtol=1e-4)
    wild = with_residual(evidence, evidence.residual + 1e3 * out[:, None])
    assert (cross_validation.held_out(wild, part).square[out] > 1e3 * found.square[out]).all()


def test_what_is_foretold_is_the_likelihood_of_what_was_not_seen(evidence, dense) -> None:
    """With all priors finite: p(part | others, v) from the densities of all and of the others."""
    proper = replace(evidence, precision=np.where(evidence.precision > 0, evidence.precision, 1.0))
    flat = proper.nuisance.reshape(proper.size, -1)
    V = np.eye(proper.size) + flat / proper.precision @ flat.T
    X = columns_of(candidate(proper, "joint_compliance"), proper)
    r = proper.draw(1, np.random.default_rng(12))[:, 0] + X @ np.array([0.1, 0.2, -0.1])
    proper, free = with_residual(proper, r), (np.full(3, -np.inf), np.full(3, np.inf))
    part, total, own = cross_validation.sectors(proper), 0.0, 0.0
    every = np.ones(len(r), dtype=bool)

    def learned(rows):
        W = np.linalg.inv(V[np.ix_(rows, rows)])
        G, b = X[rows].T @ W @ X[rows], X[rows].T @ W @ r[rows]
        return W, np.linalg.solve(G + scores.PRECISION * np.eye(3), b)

    def fallen(rows, v):
        W, off = learned(rows)[0], r[rows] - X[rows] @ v
        return r[rows] @ W @ r[rows] - off @ W @ off

    for number in range(5):
        others = np.repeat(part != number, 3)
        v = learned(others)[1]
        total += fallen(every, v) - fallen(others, v)
        own += fallen(every, learned(every)[1]) - fallen(others, learned(every)[1])
    found = cross_validation.foretold(proper, Plain(X), free, part)
    assert found.share == pytest.approx(total / fallen(every, learned(every)[1]), rel=1e-6)
    assert found.of_parts == pytest.approx(total / own, rel=1e-6)


def test_what_sits_in_one_sector_foretells_nothing(evidence) -> None:
    """A scale that is present in one sector only, and one that is present in all."""
    part = cross_validation.sectors(evidence)
    columns = columns_of(candidate(evidence, "joint_scale"), evidence)
    bounds = (np.full(3, -np.inf), np.full(3, np.inf))
    noise = evidence.draw(1, np.random.default_rng(13))
    signal = columns @ np.full((3, 1), 2.0)
    everywhere = with_residual(evidence, noise + signal)
    assert cross_validation.foretold(everywhere, Plain(columns), bounds, part).share > 0.8
    here = np.repeat(part == 0, 3)[:, None]
    somewhere = with_residual(evidence, noise + 3 * signal * here)
    found = cross_validation.foretold(somewhere, Plain(columns), bounds, part)
    assert max(found.share, found.of_parts) < 0.25


def test_what_only_the_priors_of_dimensions_speak_for_is_told_alike_by_all_parts(evidence) -> None:
    """A dimension would do the same, a hundred tolerances off: each part shows it already."""
    part, row = cross_validation.sectors(evidence), 1
    columns = np.asarray(evidence.geometry[:, [row]])
    seen = with_residual(evidence, evidence.draw(1, np.random.default_rng(15)) + 100 * columns)
    found = cross_validation.foretold(
        seen, Plain(columns), (np.full(1, -np.inf), np.full(1, np.inf)), part
    )
    assert found.share < 0.25
    assert found.of_parts > 0.9


def test_a_value_that_shows_in_one_sector_only_keeps_to_the_size_of_the_effect(
    evidence,
) -> None:
    """Without it, what little the other sectors say of the value is all that is foretold of it."""
    part = cross_validation.sectors(evidence)
    columns = columns_of(candidate(evidence, "joint_scale"), evidence).copy()
    known = evidence.information(columns)[2, 2]
    columns[np.repeat(part != 2, 3), 2] *= 0.2 / np.sqrt(known)  # known there to within 5
    bounds, size = (np.full(3, -np.inf), np.full(3, np.inf)), 0.3
    signal = columns @ np.full((3, 1), size)
    shares = []
    for seed in range(8):
        seen = with_residual(evidence, evidence.draw(1, np.random.default_rng(seed)) + signal)
        about = seen, Plain(columns), bounds, part
        alike = cross_validation.foretold(*about, size**-2).share
        shares.append((alike, cross_validation.foretold(*about).share))
    with_size, without = np.array(shares).T
    assert (with_size > 0.5).all()
    assert (without < 0.25).any()


def test_what_ends_at_its_bound_foretells_nothing(evidence) -> None:
    """A gap that would have to be negative in one of the parts, and therefore in all together."""
    part = cross_validation.sectors(evidence)
    columns = columns_of(candidate(evidence, "backlash"), evidence)[:, :1]
    noise = evidence.draw(1, np.random.default_rng(14))
    here = np.repeat(part == 2, 3)[:, None]
    less = with_residual(evidence, noise + columns * np.where(here, -9.0, 1.0))
    bounds = (np.zeros(1), np.full(1, np.inf))
    assert cross_validation.foretold(less, Plain(columns), bounds, part).share == 0.0


# Residuals, and what cannot be determined


def audited(evidence, residual):
    return residual_tests.audit(
        with_residual(evidence, residual), np.inf, np.random.default_rng(8)
    ).p


def test_an_audit_is_quiet_where_there_is_noise(evidence) -> None:
    """Slightly conservative, because insignificant structure is allowed."""
    drawn = evidence.draw(200, np.random.default_rng(9))
    p = np.array([list(audited(evidence, column).values()) for column in drawn.T])
    assert p.shape == (200, 5)
    assert (np.mean(p < 0.05, axis=0) < 0.1).all()
    assert (p.mean(axis=0) > 0.42).all()
    assert (p.mean(axis=0) < 0.85).all()


def test_p_of_likeness_is_as_rare_as_it_says() -> None:
    """Products of 60 neighbours have heavier tails than a normal: excess kurtosis 0.3."""
    rng = np.random.default_rng(1)
    draws = np.concatenate([_likeness(rng) for _ in range(11)])
    reference, others = draws[:20_000], draws[20_000:]
    at = np.linspace(3.0, 4.5, 301) * reference.std()
    p = np.array([residual_tests._beyond(float(own), reference, 0.0) for own in at])
    rare = 3.3e-4
    beyond = np.mean(others > np.interp(-rare, -p, at))
    assert rare / 1.7 < beyond < 1.7 * rare


def _likeness(rng: np.random.Generator) -> np.ndarray:
    left = rng.standard_normal((20_000, 60))
    return np.sum(left * np.roll(left, 1, axis=1), axis=1)


@pytest.mark.parametrize("shown", ["position", "joints", "direction", "time", "tails"])
def test_an_audit_says_what_structure_moves_with(wide, shown: str) -> None:
    """Structure added to noise: spatial waves, a sign per side, slow walk, wrong distribution."""
    rng, at = np.random.default_rng(11), wide.at
    place = wide.chain.mechanism.position(wide.pose)
    q, turn = at.joint, 2 * np.pi * at.time[:, None] / at.time.max()
    wave = {
        "position": 3 * np.sin(10 * place[:, [1, 2, 0]]),
        "joints": 3 * np.sin(3.5 * q @ [[1.0, 0.3, 0.0], [0.0, 1.0, 0.3], [0.3, 0.0, 1.0]]),
        "direction": 3 * at.direction * np.cos(4 * q),
        "time": 3 * np.sin(turn) * [1.0, -1.0, 0.5],
        "tails": 1.5 * rng.standard_t(2, q.shape),
    }[shown]
    p = audited(wide, wide.draw(1, rng).reshape(-1, 3) + wave)
    assert p["lack_of_fit"] < 1e-3
    others = {name for name in p if name not in ("lack_of_fit", f"moran_{shown}")}
    if shown != "tails":
        assert p[f"moran_{shown}"] < 1e-3
    quiet = {"time": others, "tails": others}.get(shown, {"moran_time"})
    assert min(p[name] for name in quiet) > 5e-3


@pytest.fixture(scope="module")
def moving():
    """Stops, slow sweeps and circles."""
    session = simulate_session(draw_machine(ROBOT, 5), make_plan("rich", ROBOT, seed=5), 5)
    return calibrated(survey(session, ROBOT.joints.names), ROBOT).evidence


def test_an_audit_sees_what_goes_along_with_motions_only(moving) -> None:
    """A ripple as large as the noise of a reading on the paths, none at the stops."""
    rng = np.random.default_rng(14)
    noise, on = moving.draw(1, rng).reshape(-1, 3), np.arange(len(moving)) >= moving.poses
    ripple = np.sin(40 * moving.at.joint) * (on & moving.believed)[:, None]
    quiet, loud = audited(moving, noise), audited(moving, noise + ripple)
    assert quiet["moran_motion"] > 5e-3
    assert loud["moran_motion"] < 1e-4
    assert loud["moran_position"] > 5e-3
    left = residual_tests.audit(with_residual(moving, noise + ripple), np.inf, rng)
    rows = np.flatnonzero(on & moving.believed)
    moved = np.linalg.solve(moving.whiten[rows], ripple[rows, :, None])[..., 0]
    share = left.in_motion / np.sqrt(np.mean(np.sum(moved**2, axis=1)))
    assert 0.4 < share < 1.1  # rest errors absorb some of it, and neighbours do not share all


def test_stops_on_the_way_of_motions_are_not_draws_of_their_own(moving) -> None:
    """A sweep rests where it turns; the joints were not positioned there anew."""
    time, stops = moving.at.time, np.arange(moving.poses)
    motions = np.unique(moving.rest.path[moving.poses :])
    first, last = (
        np.array([end(time[moving.rest.path == number]) for number in motions])
        for end in (np.min, np.max)
    )
    left_out = stops[~moving.believed[: moving.poses]]
    assert 5 <= len(left_out) < 0.3 * moving.poses
    for row in left_out:  # a motion ended and another began within a quarter of a minute
        assert (np.abs(time[row] - last) < 15.0).any()
        assert (np.abs(first - time[row]) < 15.0).any()
    kept = time[stops[moving.believed[: moving.poses]]]
    assert not ((kept > first.min()) & (kept < last.max())).any()


def test_an_interval_counts_how_far_a_sensor_is_behind_its_part() -> None:
    """Compared with the change of the value when the sensor's clock is set back by a minute."""
    trial = hide({"thermal_growth_arm": 1.2}, 1)
    growth = replace(
        next(e for e in catalogue(ROBOT, ROBOT.model()) if e.cause == "thermal_growth_arm"),
        sensor="arm",
    )
    term = next(subsets(growth))

    def grown(session):
        return model.fit(calibrated(survey(session, ROBOT.joints.names), ROBOT), (term,))

    late = tuple(
        replace(stream, stamp_ns=stream.stamp_ns - 60 * 10**9)
        for stream in trial.session.temperature
    )
    found, earlier = grown(trial.session), grown(replace(trial.session, temperature=late))
    own = found.terms[0]
    whole = findings.spread_of(found.evidence, found, own)[0]
    columns = columns_of(own, found.evidence)
    alone = np.sqrt(np.linalg.inv(found.evidence.information(columns))[0, 0])
    moved = (earlier.values(own) - found.values(own))[0] / growth.parameters.prior[0]
    assert whole > 1.3 * alone
    assert np.sqrt(whole**2 - alone**2) == pytest.approx(abs(moved), rel=0.25)


def reasons(evidence):
    """The reason why each cause cannot be determined, and the remedy."""
    said = identifiability.unseen(evidence, (), catalogue(ROBOT, evidence.chain.mechanism), ())
    return {name: entry for entry in said for name in entry.between}


def test_what_a_session_cannot_tell_is_what_it_did_not_vary(evidence) -> None:
    varied, poor = reasons(evidence), reasons(measured(both_sides=False, masses=(0.5,)))
    for cause in ("backlash", "forearm_compliance"):
        assert cause not in varied
    assert poor["forearm_compliance"].because == "one payload only"
    assert "second payload" in poor["forearm_compliance"].next
    assert poor["backlash"].because == "every pose was approached from one side"
    for told in (varied, poor):
        assert told["joint_lag"].because == "nothing was measured in motion"
    nobody_knows = reasons(measured(payload=None))
    assert nobody_knows["forearm_compliance"].because == "the payload is not known"
    assert nobody_knows["forearm_compliance"].next == "record it: payload"


def test_play_that_weight_holds_shut_is_said_to_be_a_zero(evidence) -> None:
    """In the middle of a Delta's workspace its drives rest on one flank everywhere."""
    backlash = EFFECTS["backlash"](ROBOT, evidence.chain.mechanism)
    assert "backlash held by weight" not in reasons(evidence)  # at its edges an arm is lifted
    told = reasons(measured(radius=0.15))["backlash held by weight"]
    assert told.between == ("backlash held by weight", "joint_zero_offset")
    assert told.because.startswith("the load of the weight on every joint has the same sign")
    assert "balanced" in told.next
    hanging, lifted = np.zeros(3), np.array([1.2, 0.0, 0.0])  # [rad] one arm past the vertical
    because = backlash.disguised(loaded(np.stack([hanging, lifted])))[2]
    assert because.startswith("the load of the weight on joints joint_2, joint_3 has")
    assert backlash.disguised(loaded(np.stack([lifted, lifted[[1, 0, 2]], lifted[::-1]]))) is None
    untold = backlash.disguised(at_rest(hanging[None]))  # the payload is not known
    assert untold[1] == "none"
    assert untold[2].startswith("the payload is not known")


def loaded(joint):
    """At rest, without payload."""
    nothing = {"payload": np.zeros(len(joint)), "payload_centre": np.zeros((len(joint), 3))}
    return replace(at_rest(joint), **nothing)


def test_exact_equivalences_are_classes_of_their_own(evidence) -> None:
    """One-sided backlash is a joint zero; an offset without tilt is a translation."""
    one_sided = reasons(measured(both_sides=False))["backlash"]
    assert {"backlash", "joint_zero_offset"} <= set(one_sided.between)
    assert "other side" in one_sided.next
    level = reasons(measured(model="rotary_delta"))["smr_offset"]
    assert set(level.between) == {"smr_offset", "tracker frame"}
    assert "smr_offset" not in reasons(evidence)


def test_what_does_not_grow_is_not_for_lack_of_motion(evidence) -> None:
    """The cell stayed at 20 degrees C all the time."""
    assert np.ptp(evidence.at.temperature) == 0
    told = reasons(evidence)
    for part in ("arm", "base"):
        assert told[f"thermal_growth_{part}"].because == "the temperature hardly changed"


@dataclass(frozen=True)
class GiveToEither(JointCompliance):
    """Drives that yield to weight by one number [rad/(N m)] and to inertia by another."""

    cause: ClassVar[str] = "give_to_either"

    @property
    def parameters(self) -> ParameterSet:
        of = ("to_weight", "to_inertia")
        return ParameterSet(
            tuple(Parameter(n, "rad/(N m)", 0.0, 4e-5, self.cause, None, 0.0, 1e-2) for n in of)
        )

    @staticmethod
    def law(s, v, c):
        del c
        return -v[0] * s[0] - v[1] * s[1]


def test_what_shows_at_rest_is_fitted_there_beside_what_shows_in_motion_only() -> None:
    """The optimum is reached; earlier, both were left after one step, 1.7 deviations off."""
    machine = draw_machine(ROBOT, 10, 1.0, {"joint_compliance": {"strength": "4"}})
    session = simulate_session(machine, make_plan("identify", ROBOT, count=40, seed=10), 10)
    bare = calibrated(survey(session, ROBOT.joints.names), ROBOT)
    effect = GiveToEither(ROBOT, bare.bare.mechanism)
    fitted = bare.fitted((Candidate(effect.cause, effect.kind, None, effect, (0, 1)),))
    step = (fitted.ahead(fitted.misfit) - fitted.theta)[fitted.layout.effects][0]
    known = fitted.evidence.information(fitted.evidence.columns(effect))[0, 0] + scores.PRECISION
    assert abs(step) < 0.1 * 4e-5 / np.sqrt(known)
