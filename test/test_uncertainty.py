"""Uncertainty of positions, compared with GTC, Monte Carlo (GUM S1) and true errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("GTC", reason="needs the extra [test]")

import GTC

from certified_coverage import coverage, later
from delta_calibration.data import collect
from delta_calibration.estimation import Rest, identify
from delta_calibration.estimation.positions import _kurtosis, _split
from delta_calibration.plans import make_plan
from delta_calibration.report import (
    About,
    Certificate,
    Decision,
    Examined,
    Provenance,
    examined_fit,
    page_of_certificate,
)
from delta_calibration.report.budget import budget_of, certified, standard
from delta_calibration.report.certificate_figures import histogram_figure
from delta_calibration.report.drawing import Rule
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.uncertainty import Uncertainty, _divided, radius95

ALPHA, KELVIN = 11.5e-6, 0.5
ABOUT = About(
    {
        "machine": {"expansion_um_per_m_k": 1e6 * ALPHA},
        "instrument": {"u_along_um": 1.0, "u_across_um": 3.0, "u_reflector_um": 1.5},
        "ambient": {"u_temperature_k": KELVIN},
    }
)
ROW = 7


@cache
def examined(name: str = "srbd") -> Examined:
    """A random machine, measured and fitted."""
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=24, seed=5)
    session = simulate_session(draw_machine(robot, 5), plan, 5)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    return examined_fit(identify(poses, robot, seed=5), poses, robot)


def drawn(covariance: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Normal vectors with a covariance that may be singular, (n, k)."""
    value, way = np.linalg.eigh(covariance)
    return (rng.standard_normal((n, len(value))) * np.sqrt(np.maximum(value, 0.0))) @ way.T


def turned_back(w: list, v: list) -> list:
    """R(w)^T v by Rodrigues' formula, with uncertain numbers of GTC."""
    angle = GTC.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    k = [each / angle for each in w]
    cross = [k[1] * v[2] - k[2] * v[1], k[2] * v[0] - k[0] * v[2], k[0] * v[1] - k[1] * v[0]]
    along = k[0] * v[0] + k[1] * v[1] + k[2] * v[2]
    c, s = GTC.cos(angle), GTC.sin(angle)
    return [v[i] * c - cross[i] * s + k[i] * along * (1 - c) for i in range(3)]


def test_budget_of_a_measured_point_is_that_of_gtc() -> None:
    """The tracker measures range and two angles; GTC propagates all inputs to the base."""
    found = examined()
    poses, noise, own = found.poses, found.noise, found.identified
    point, count = poses.point[ROW], float(poses.count[ROW])
    distance = float(np.linalg.norm(point))
    along, across = (float(s[0]) for s in found.robot.tracker.sigmas(np.array([distance])))
    u_range = np.hypot(noise.radial_scale * along / np.sqrt(count), 1e-6)
    u_angle = np.hypot(noise.transverse_scale * across / np.sqrt(count), 3e-6) / distance
    azimuth = float(np.arctan2(point[1], point[0]))
    height = float(np.arcsin(point[2] / distance))
    d = GTC.ureal(distance, u_range)
    e = GTC.ureal(height, u_angle)
    a = GTC.ureal(azimuth, u_angle / np.cos(height))
    y = [d * GTC.cos(e) * GTC.cos(a), d * GTC.cos(e) * GTC.sin(a), d * GTC.sin(e)]

    rest, _ = _divided(own.uncertainty.covariance, own.chain)
    vector = own.theta[own.chain.layout.frame]
    sigma = np.sqrt(np.diag(rest))
    frame = GTC.multiple_ureal(vector.tolist(), sigma.tolist(), float("inf"))
    for i in range(6):
        for j in range(i):
            GTC.set_correlation(float(rest[i, j] / (sigma[i] * sigma[j])), frame[i], frame[j])
    place = turned_back(frame[:3], [y[i] - frame[3 + i] for i in range(3)])

    seen = own.chain.see(poses.conditions, own.theta)
    turned = own.chain.split(own.theta)[2].rotation
    by_joints = turned.T @ seen.by_joints[ROW]
    rests = [GTC.ureal(0.0, noise.repeatability) for _ in range(by_joints.shape[1])]
    warm = GTC.ureal(0.0, KELVIN)
    middle, target = found.place, found.target[ROW]
    whole = [
        place[i]
        + GTC.ureal(0.0, 1.5e-6)
        + ALPHA * warm * float(target[i] - middle[i])
        + sum(float(by_joints[i, m]) * rests[m] for m in range(len(rests)))
        for i in range(3)
    ]
    by_gtc = [GTC.variance(each) for each in whole]
    np.testing.assert_allclose(np.diag(budget_of(found, ABOUT).measured[ROW]), by_gtc, rtol=2e-3)


@pytest.mark.parametrize(("name", "scale"), [("srbd", 0.1), ("scara", 1.0)])
def test_what_a_fit_leaves_open_by_monte_carlo(name: str, scale: float) -> None:
    """GUM S1: machines drawn from the covariance, predicted by the full nonlinear model.

    For rods and reflector of a Delta the data determine products, which machines far from the fit
    do not preserve. Therefore a tenth of the spread is drawn for the Delta.
    """
    found, rng, n = examined(name), np.random.default_rng(1), 1500
    own, at = found.identified, found.poses.conditions.take(slice(0, 3))
    size = at.joint.shape[1]
    theta = own.theta + scale * drawn(own.uncertainty.covariance, n, rng)
    rest = scale * own.uncertainty.repeatability * rng.standard_normal((n, 1, size))
    reached = [
        own.chain.predict(replace(at, joint=at.joint + e), one)
        for one, e in zip(theta, rest, strict=True)
    ]
    parts = own.parts(at)
    expected = np.sqrt(np.trace(parts.fit + parts.repeatability, axis1=1, axis2=2))
    spread = np.sqrt(np.sum(np.var(reached, axis=0), axis=-1)) / scale
    np.testing.assert_allclose(spread, expected, rtol=0.06)


def test_radius_by_monte_carlo() -> None:
    """Exact along a line and for equal axes, otherwise within 2 %."""
    rng = np.random.default_rng(2)
    for sigma in ([1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.5, 0.2], [1.0, 1.0, 0.1]):
        r = np.linalg.norm(rng.standard_normal((400_000, 3)) * sigma, axis=1)
        found = radius95(np.diag(np.square(sigma))[None])[0]
        assert found == pytest.approx(np.quantile(r, 0.95), rel=0.02), sigma
    alike = radius95(np.eye(3)[None])[0]
    assert alike == pytest.approx(np.sqrt(chi2.ppf(0.95, 3)), rel=1e-12)
    assert radius95(np.zeros((1, 3, 3)))[0] == 0.0
    assert np.isnan(radius95(np.full((1, 3, 3), np.nan))[0])


def test_radius_about_either_side_by_monte_carlo() -> None:
    """Backlash of three joints, each on one of two sides, plus a normal error."""
    rng, n = np.random.default_rng(3), 400_000
    sided = np.array([[60.0, 10.0, -30.0], [0.0, 70.0, 20.0], [15.0, -5.0, 80.0]])
    for sigma in ([5.0, 5.0, 5.0], [40.0, 20.0, 5.0], [0.0, 0.0, 0.0]):
        way = rng.choice([-1.0, 1.0], (n, 3)) @ sided.T
        r = np.linalg.norm(way + rng.standard_normal((n, 3)) * sigma, axis=1)
        found = radius95(np.diag(np.square(sigma))[None], sided[None])[0]
        assert found == pytest.approx(np.quantile(r, 0.95), rel=0.02), sigma


def sines(amplitude: list[float], n: int, rng: np.random.Generator) -> np.ndarray:
    """Independent sines of random phase along the axes, (n, 3), like gear errors."""
    return np.array(amplitude) * np.sqrt(2) * np.sin(rng.uniform(0, 2 * np.pi, (n, 3)))


def fourth_of(error: np.ndarray) -> float:
    """Variance of |e|^2 minus that of a normal distribution with the same covariance."""
    covariance = error.T @ error / len(error)
    return float(np.var(np.sum(error**2, axis=1)) - 2 * np.sum(covariance**2))


def test_radius_of_bounded_errors_by_monte_carlo() -> None:
    """Sines have a smaller radius than normal errors of the same size, by their fourth moment."""
    rng, n = np.random.default_rng(6), 400_000
    for amplitude in ([1.0, 1.0, 1.0], [1.0, 0.7, 0.3], [1.0, 0.2, 0.0]):
        error = sines(amplitude, n, rng) + 0.3 * rng.standard_normal((n, 3))
        r = np.linalg.norm(error, axis=1)
        covariance = (error.T @ error / n)[None]
        found = radius95(covariance, fourth=fourth_of(error))
        assert np.mean(r <= found) == pytest.approx(0.95, abs=0.015), amplitude
        assert np.mean(r <= radius95(covariance)) > np.mean(r <= found) + 0.01, amplitude


def test_fourth_moment_of_what_a_model_leaves_out_is_found_from_its_errors() -> None:
    """A sine along one axis has k = 1.5 - 3, three sines a third of that, and noise 0."""
    rng, n = np.random.default_rng(7), 20_000
    place, noise = np.arange(n), np.tile(0.04 * np.eye(3), (n, 1, 1))
    for amplitude, expected in (([1.0, 0.0, 0.0], -1.5), ([1.0, 1.0, 1.0], -0.5)):
        error = sines(amplitude, n, rng) + 0.2 * rng.standard_normal((n, 3))
        model = np.tile(np.diag(np.square(amplitude)), (n, 1, 1))
        found = _kurtosis(error, model + noise, model, place)
        assert found == pytest.approx(expected, abs=0.05), amplitude
    normal = rng.standard_normal((n, 3))
    assert abs(_kurtosis(normal, np.tile(np.eye(3), (n, 1, 1)), model, place)) < 0.05


def test_radius_of_a_variance_from_few_repeats_by_monte_carlo() -> None:
    """Coverage on average over many estimates of the variance."""
    rng, n, degrees = np.random.default_rng(4), 200_000, 12.0
    estimate = rng.chisquare(degrees, n) / degrees
    r = np.linalg.norm(rng.standard_normal((n, 3)), axis=1)
    covariance = estimate[:, None, None] * np.eye(3)
    doubt = 3 * estimate * np.sqrt(2 / degrees)
    assert np.mean(r <= radius95(covariance, None, doubt)) == pytest.approx(0.95, abs=0.004)
    assert np.mean(r <= radius95(covariance)) < 0.925


def split_of(repeated: float, model: float, rng: np.random.Generator, freedom: float = 8.0):
    """Errors of 40 places from two sides; s_q is 1, and few repeats give `repeated`."""
    n, moving = 80, np.tile(np.diag([1.0, 0.5, 0.2]), (80, 1, 1))
    place = np.arange(n) // 2
    error = rng.standard_normal((n, 3)) * np.sqrt([1.0, 0.5, 0.2])
    error += np.sqrt(model) * rng.standard_normal((n // 2, 3))[place]
    known = repeated**2 * moving
    return _split(error, known, moving, Rest(repeated, freedom), place)


def whole_of(found) -> tuple[float, float]:
    """Trace of M and of the rest errors together, and its standard error."""
    still = 1.7 * found.rest.repeatability**2
    doubt = np.hypot(found.doubt, still * np.sqrt(2 / found.rest.freedom))
    return np.trace(found.covariance) + still, doubt


def test_residuals_tell_beside_few_repeats_where_joints_come_to_rest() -> None:
    """The variance is less than a third of that of repeats; a stated repeatability is kept."""
    rng, few = np.random.default_rng(4), 8
    repeated = rng.chisquare(few, 400) / few
    whole = [whole_of(split_of(np.sqrt(each), 0.0, rng))[0] / 1.7 for each in repeated]
    assert np.var(whole) < np.var(repeated) / 3
    assert abs(np.mean(whole) - 1) < 0.05
    sure = split_of(0.5, 0.0, rng, np.inf).rest
    assert (sure.repeatability, sure.freedom) == (0.5, np.inf)


@pytest.mark.parametrize("repeated", [0.6, 1.0, 1.5])
def test_the_sum_of_model_and_rest_goes_by_the_residuals_where_a_model_errs(
    repeated: float,
) -> None:
    """If one of them is estimated too small, the other is too large."""
    rng, true = np.random.default_rng(6), 1.7 + 3 * 4.0
    found = [split_of(repeated, 4.0, rng) for _ in range(50)]
    whole, doubt = zip(*map(whole_of, found), strict=True)
    assert abs(np.mean(whole) / true - 1) < 0.06
    assert 0.7 < np.std(whole) / np.mean(doubt) < 1.4


def test_frame_and_dimensions_add_up_to_the_fit() -> None:
    """Neither is negative, and their sum is J C J^T."""
    own, at = examined().identified, examined().poses.conditions
    parts = own.parts(at)
    turned = own.chain.split(own.theta)[2].rotation
    jacobian = turned.T @ own.chain.jacobian(at, own.theta)
    whole = jacobian @ own.uncertainty.covariance @ np.swapaxes(jacobian, 1, 2)
    np.testing.assert_allclose(parts.fit, whole, atol=1e-3 * np.abs(whole).max())
    for part in (parts.frame, parts.dimensions, parts.model, parts.play):
        assert np.linalg.eigvalsh(part).min() > -1e-16
    assert (standard(parts.frame) > 0.1e-6).all()


def test_nothing_is_certified_outside_the_region() -> None:
    found = examined()
    places = found.place + np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 0.0, -0.4]])
    radius = certified(found, ABOUT, places)
    assert np.isfinite(radius[0])
    assert np.isnan(radius[1:]).all()
    bare = certified(found, About(), places)
    assert radius[0] > bare[0]


@pytest.mark.parametrize(
    ("robot", "cause", "least", "most"),
    [
        ("srbd", "none", 0.93, 0.995),
        ("srbd", "encoder_eccentricity", 0.90, 0.995),
        ("scara", "transmission_error", 0.90, 0.995),
        ("linear_delta", "none", 0.90, 0.995),
        ("srbd", "backlash", 0.90, 0.985),  # on either side: two values
    ],
)
def test_true_errors_lie_within_what_is_certified(
    robot: str, cause: str, least: float, most: float
) -> None:
    """At places that were not measured, with a hidden cause that is not in the model."""
    share = np.mean([coverage(robot, cause, seed).covered for seed in range(5)])
    assert least <= share <= most


@pytest.mark.parametrize(
    ("robot", "cause", "least", "most"),
    [
        ("srbd", "none", 0.93, 0.985),
        ("srbd", "backlash", 0.92, 0.985),
        ("scara", "transmission_error", 0.91, 0.995),
    ],
)
def test_true_errors_after_a_change_lie_within_what_is_certified(
    robot: str, cause: str, least: float, most: float
) -> None:
    """By a calibration from before the change, and a later session with another tracker frame."""
    share = np.mean([later(robot, cause, seed).covered for seed in range(5)])
    assert least <= share <= most


def test_a_calibration_that_holds_keeps_its_radius() -> None:
    grown = [
        later("srbd", "none", s).radius / coverage("srbd", "none", s).radius for s in range(6)
    ]
    assert 0.97 < np.median(grown) < 1.03
    assert np.mean(grown) < 1.08


def test_a_hidden_cause_widens_what_is_certified() -> None:
    clean, hidden = (coverage("srbd", cause, 2) for cause in ("none", "backlash"))
    assert hidden.radius > 4 * clean.radius


def test_uncertainty_follows_its_covariance() -> None:
    """With four times the variance of all parts, the radius doubles."""
    own, at = examined().identified, examined().poses.conditions
    told = own.uncertainty
    model = replace(told.model, covariance=4 * told.model.covariance, play=2 * told.model.play)
    wide = Uncertainty(4 * told.covariance, 2 * told.repeatability, model)
    np.testing.assert_allclose(
        replace(own, uncertainty=wide).radius(at), 2 * own.radius(at), rtol=1e-9
    )


def test_a_pose_that_was_set_aside_leaves_the_machine_undecided() -> None:
    """It is listed but not judged, so excluding bad poses cannot give a pass."""
    source = Provenance("session", "0" * 64, 0, "srbd", "srbd.yaml", "0" * 64, 0)
    wide = About({"tolerance_mm": 10.0})
    whole = Certificate(examined(), wide, source)
    assert whole.decision is Decision.PASS
    believed = whole.examined.believed.copy()
    believed[3] = False
    less = Certificate(replace(whole.examined, believed=believed), wide, source)
    assert less.decision is Decision.NOT_DECIDED
    assert less.points is not None
    assert less.points[3] is Decision.NOT_DECIDED
    page = page_of_certificate(less)
    said = {each.question: each.answer for each in page.statements}
    assert "1 of 48 poses is a gross error according to the fit, and not judged" in said["Errors"]
    conditions = next(table for table in page.tables() if table.name == "conditions")
    assert ("poses set aside", "1 of 48") in conditions.rows
    points = next(table for table in page.tables() if table.name == "points")
    assert [row[-1] for row in points.rows].count("set aside") == 1


@pytest.mark.parametrize(
    ("tolerance", "said", "drawn"),
    [(50.0, "outside the plot, to the right", 0), (0.01, "", 1), (None, "", 0)],
)
def test_a_tolerance_off_the_scale_is_said_not_drawn(
    tolerance: float | None, said: str, drawn: int
) -> None:
    """Otherwise its label would leave no room for the axes in the PDF."""
    source = Provenance("session", "0" * 64, 0, "srbd", "srbd.yaml", "0" * 64, 0)
    about = About({} if tolerance is None else {"tolerance_mm": tolerance})
    figure = histogram_figure(Certificate(examined(), about, source))
    assert said in figure.caption
    assert sum(isinstance(mark, Rule) for mark in figure.panels[0].marks) == drawn
