"""Tests of effects on cable robots, each against an independent formulation."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from casadi import DM
from scipy.integrate import quad
from scipy.optimize import brentq, least_squares
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from blind.cables import over_pulley
from cables import (
    EIGHT_CABLES,
    FOUR_CABLES,
    TOLERANCES,
    workspace,
)
from delta_calibration.chain import Chain
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.effects.cable_elasticity import CableElasticity
from delta_calibration.effects.cable_sag import CableSag, slack_of_sag
from delta_calibration.effects.counter_zero_offset import CounterZeroOffset
from delta_calibration.effects.drum_build_up import DrumBuildUp, let_out
from delta_calibration.effects.drum_eccentricity import DrumEccentricity
from delta_calibration.effects.drum_scale import DrumScale
from delta_calibration.effects.pretension_loss import PretensionLoss
from delta_calibration.effects.pulley_radius import ABOVE, BELOW, PulleyRadius, excess
from delta_calibration.errors import InputError, ReachError
from delta_calibration.mechanisms import CableRobot
from delta_calibration.robot import load_robot
from study.judge import judge, scaled
from study.trials import Task

GRAVITY = 9.80665
ROBOT = load_robot("cdpr8")
DRUMS = DrumBuildUp, DrumEccentricity, DrumScale
ALL = (CableElasticity, CableSag, *DRUMS, PulleyRadius)  # zero at home
CABLES = CableRobot(EIGHT_CABLES, TOLERANCES)
G = CABLES.parameters.nominal
ASIDE = replace(  # no anchor right above the platform
    FOUR_CABLES, anchors=np.vstack([FOUR_CABLES.anchors[:3], [1.2, 0.3, 2.5]])
)
X = workspace(EIGHT_CABLES, 12, np.random.default_rng(1))


def conditions(x, payload=5.0):
    n = len(x)
    at = at_rest(CABLES.inverse(x, G))
    centre = np.tile([0.02, -0.01, 0.05], (n, 1))
    return replace(at, payload=np.full(n, payload), payload_centre=centre)


AT = conditions(X)
HOME = conditions(EIGHT_CABLES.home[None], payload=0.0)


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.cause)
def test_what_every_effect_on_cables_keeps_to(kind):
    """Shape of the columns, units, a prior, zero at home; another mechanism is refused."""
    effect = kind(ROBOT, CABLES)
    count = len(effect.parameters)
    assert effect.columns(AT).shape == (len(X), 8, count)
    assert np.abs(effect.columns(AT)).max() > 0
    np.testing.assert_allclose(effect.columns(HOME), 0, atol=1e-7)
    assert {p.cause for p in effect.parameters} == {kind.cause}
    assert all(p.prior > 0 and p.lower <= 0 < p.upper for p in effect.parameters)
    assert {p.location for p in effect.parameters} <= {None, *(f"cable_{i}" for i in range(1, 9))}
    delta = load_robot("srbd")
    assert kind.cause not in {e.cause for e in catalogue(delta, delta.model())}
    with pytest.raises(InputError, match=f"effect {kind.cause}: robot srbd has no such part"):
        effect_named(kind.cause, delta, delta.model(), {})


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.cause)
def test_a_typical_effect_moves_the_platform_by_no_more_than_machines_do(kind):
    """From a hundredth of a millimetre to some centimetres, as a check of the units."""
    effect = kind(ROBOT, CABLES)
    size = np.array([p.prior for p in effect.parameters])
    q = AT.joint + effect.columns(AT) @ size
    moved = np.linalg.norm(CABLES.forward(q, G)[:, :3] - X[:, :3], axis=1)
    assert 1e-5 < moved.max() < 50e-3


def test_drum_scale_is_an_error_of_k():
    effect, share = DrumScale(ROBOT, CABLES), np.linspace(-2e-3, 2e-3, 8)
    wrong = G.copy()
    wrong[CABLES.parameters.row("gain_1") :: 7] *= 1 + share
    shifted = AT.joint + effect.columns(AT) @ share
    np.testing.assert_allclose(CABLES.closure(shifted, X, G), CABLES.closure(AT.joint, X, wrong))


def test_a_counter_that_is_not_zero_at_home_is_off_everywhere_alike():
    effect = CounterZeroOffset(ROBOT, CABLES)
    off = np.linspace(-1.0, 1.0, 8)
    np.testing.assert_allclose(effect.columns(AT) @ off, np.tile(off, (len(X), 1)))
    zeros = CableRobot(EIGHT_CABLES, replace(TOLERANCES, zero=1e-3))
    assert not CounterZeroOffset(ROBOT, zeros).suits  # then they are dimensions


@pytest.mark.slow
def test_a_homing_error_is_no_drift():
    """It had been named a drift of the counters, up to 98 % sure."""
    said = judge(Task("single", 8820, (("counter_zero_offset", 400.0),), robot="cdpr8").key)
    assert [f["cause"] for f in said["findings"]] == ["counter_zero_offset"]
    assert not said["unknown"]


def test_build_up_is_a_spiral_summed_over_its_turns():
    """Turn by turn: a circle of the current radius, less a layer per turn (in thin slices)."""
    radius, build_up, turns, slices = 75e-3, 68.75e-6, 12, 4000
    length = 0.0
    area = np.pi * radius**2  # of the wound drum, seen along its axis
    for _ in range(turns * slices):
        here = np.sqrt(area / np.pi)
        piece = 2 * np.pi * here / slices
        length += piece
        area -= np.pi * build_up * piece  # the cable let out takes its cross-section with it
    turn = np.array(2 * np.pi * turns)
    assert let_out(turn, np.array(radius), build_up) == pytest.approx(length, rel=1e-5)
    assert length < 0.99 * radius * turn


def test_build_up_acts_through_gear_and_tackle():
    """With two lines on the drum per line at the platform the drum winds twice as much."""
    d = replace(FOUR_CABLES, gear=np.full(4, 12.75), tackle=np.array([1.0, 2.0, 2.0, 4.0]))
    robot, turn = CableRobot(d, TOLERANCES), np.array([[50.0, -80.0, 120.0, 200.0]])
    build_up = 70e-6
    shift = DrumBuildUp(ROBOT, robot).columns(at_rest(turn))[..., 0] * build_up
    drum = turn / 12.75
    wanted = (0.05 * drum - build_up * drum**2 / 4) / d.tackle
    np.testing.assert_allclose(d.gain * (turn + shift), wanted, rtol=1e-12)


def test_an_eccentric_drum_lets_out_what_an_eccentric_circle_does():
    """A circle about a point beside its centre: it winds r phi, and carries the cable with it."""
    d = replace(FOUR_CABLES, gear=np.full(4, 12.75), tackle=np.array([1.0, 2.0, 2.0, 4.0]))
    robot, turn = CableRobot(d, TOLERANCES), np.array([[50.0, -80.0, 120.0, 200.0]])
    sine, cosine = 2e-4, -1e-4
    values = np.repeat([sine, cosine], 4)
    shift = DrumEccentricity(ROBOT, robot).columns(at_rest(turn)) @ values
    phi = turn / 12.75
    # The cable leaves along x. Where the middle of the groove goes, the tangent point goes.
    ahead = np.real((cosine - 1j * sine) * np.exp(1j * phi))
    np.testing.assert_allclose(d.gain * shift, (ahead - cosine) / d.tackle, atol=1e-15)


def test_elasticity_is_what_unstretched_lengths_under_tension_give():
    """l_u (1 + T/EA), each cable let out from an unstretched home length; second order 1e-3."""
    stiffness, effect = 4e5, CableElasticity(ROBOT, CABLES)
    home_pull = CABLES.tensions(EIGHT_CABLES.home[None], G, weight(EIGHT_CABLES.home[None], 0.0))
    pull = CABLES.tensions(X, G, weight(X, 5.0))
    home = CABLES.lengths(EIGHT_CABLES.home[None], G) / (1 + home_pull / stiffness)
    length = (home + EIGHT_CABLES.gain * AT.joint) * (1 + pull / stiffness)
    added = length - CABLES.lengths(X, G)
    shift = EIGHT_CABLES.gain * (effect.columns(AT)[..., 0] / stiffness)
    np.testing.assert_allclose(shift, added, atol=3e-3 * np.abs(added).max())
    assert 1e-4 < np.abs(added).max() < 5e-3  # as on a real machine


def weight(x, payload):
    """dU/dx by finite differences of the height of the masses, (n, 6)."""

    def energy(pose):
        arm = CABLES.rotation(pose[None])[0] @ [0.02, -0.01, 0.05]
        return GRAVITY * ((20.0 + payload) * pose[2] + payload * arm[2])

    h = 1e-6
    return np.array(
        [[(energy(p + d) - energy(p - d)) / (2 * h) for d in h * np.eye(6)] for p in x]
    )


def test_a_pretension_that_is_lost_is_a_stretch_that_is_lost():
    """Tensions found by a convex fit at the lower pretension, in steel cables."""
    stiffness, loss, constant = 4e5, 0.3, 1800.0
    at = replace(AT, time=np.linspace(0.0, 5400.0, len(X)))
    effect = PretensionLoss(ROBOT, CABLES, time_constant=constant)
    share = loss * (1 - np.exp(-at.time / constant))
    lower = [
        replace(EIGHT_CABLES, pretension=EIGHT_CABLES.pretension * (1 - float(s))) for s in share
    ]
    load = weight(X, 5.0)
    before = CABLES.tensions(X, G, load)
    after = np.concatenate(
        [
            CableRobot(d, TOLERANCES).tensions(X[i : i + 1], G, load[i : i + 1])
            for i, d in enumerate(lower)
        ]
    )
    for x, pull, now in zip(X, before, after, strict=True):  # both bear the load
        by_x = CABLES.closure_by_pose(np.zeros((1, 8)), x[None], G)[0]
        np.testing.assert_allclose(by_x.T @ (now - pull), 0, atol=1e-8)
    shorter = (after - before) / stiffness * CABLES.lengths(X, G)
    strain = loss * EIGHT_CABLES.pretension / stiffness
    shift = EIGHT_CABLES.gain * (effect.columns(at)[..., 0] * strain)
    np.testing.assert_allclose(shift, shorter, rtol=1e-9, atol=1e-12)
    assert np.abs(shorter[0]).max() == 0.0  # at the start
    assert 1e-4 < np.abs(shorter).max() < 2e-3


def test_who_has_no_pretension_to_lose_is_not_told_so():
    """Three cables that hold a point, or cables without pretension."""
    assert PretensionLoss(ROBOT, CABLES).suits
    assert not PretensionLoss(
        ROBOT, CableRobot(replace(EIGHT_CABLES, pretension=0.0), TOLERANCES)
    ).suits
    d = FOUR_CABLES
    three = replace(
        d,
        **{n: getattr(d, n)[:3] for n in ("anchors", "joints", "drum_radius", "gear", "tackle")},
    )
    assert not PretensionLoss(ROBOT, CableRobot(three, TOLERANCES)).suits


@pytest.mark.slow
def test_a_pretension_that_is_lost_is_named():
    """Hidden by an independent generator with lambda 400: 4 % of the pretension."""
    said = judge(Task("test", 3, (("pretension_loss", 400.0),), robot="cdpr8").key)
    assert [finding["cause"] for finding in said["findings"]] == ["pretension_loss"]
    assert not said["unknown"]
    (strain,) = said["intervals"]
    assert abs(strain["value"] - strain["true"]) < 3 * strain["std"]


@pytest.mark.parametrize(("level", "rise"), [(3.0, 0.0), (3.0, 1.5), (1.0, 2.5), (4.0, -1.0)])
def test_sag_is_a_catenary_integrated_along_its_arc(level, rise):
    """y = a cosh((s - s_0) / a) through both ends; T: tension along the chord in the middle."""
    weight_each, level_force = 0.6, 60.0
    a = level_force / weight_each
    start = brentq(lambda s: a * (np.cosh((s + level) / a) - np.cosh(s / a)) - rise, -500, 500)
    arc = quad(lambda s: np.cosh((s + start) / a), 0, level, epsabs=1e-13)[0]
    chord = np.hypot(level, rise)
    along = level_force * chord / level
    written = weight_each**2 * slack_of_sag(np.array(chord), np.array(level), np.array(along))
    assert written == pytest.approx(arc - chord, rel=2e-3)
    assert arc - chord > 1e-6


def test_sag_is_shared_out_by_horizontal_span_and_pull():
    effect = CableSag(ROBOT, CABLES)
    pull = CABLES.tensions(X, G, weight(X, 5.0))
    vector = (
        EIGHT_CABLES.anchors
        - X[:, None, :3]
        - np.einsum("nij,mj->nmi", CABLES.rotation(X), EIGHT_CABLES.joints)
    )
    chord, level = np.linalg.norm(vector, axis=-1), np.linalg.norm(vector[..., :2], axis=-1)
    slack = level**2 * chord / (24 * pull**2)
    shift = -EIGHT_CABLES.gain * effect.columns(AT)[..., 0]
    at_home = (slack - shift)[:1]  # the same for all poses: absorbed by the zero
    np.testing.assert_allclose(shift + at_home, slack, rtol=1e-6)
    assert (at_home > 0).all()


def test_sag_of_a_slack_cable_is_refused():
    loose = CableRobot(replace(EIGHT_CABLES, pretension=0.0), TOLERANCES)
    effect = CableSag(ROBOT, loose)
    assert effect.missing(AT) == "a cable is slack"
    assert not CableSag(ROBOT, CABLES).missing(AT)
    assert CableSag(ROBOT, CABLES).missing(at_rest(AT.joint)) == "the payload is not known"
    with pytest.raises(ReachError, match=r"cable_\d is slack"):
        effect.columns(AT)


@pytest.mark.parametrize("side", [BELOW, ABOVE])
@pytest.mark.parametrize(("level", "above"), [(2.0, -1.0), (1.5, 1.0), (0.5, -2.0), (3.0, 0.0)])
def test_pulley_is_a_taut_string_around_a_disc(level, above, side):
    """Convex hull of the disc, a distant point along the swivel axis and the joint."""
    radius, far, count = 0.05, 20.0, 100_000
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    disc = radius * np.column_stack([1 + np.cos(turn), np.sin(turn)])
    start, joint = np.array([0.0, -far if side == BELOW else far]), np.array([level, above])
    points = np.vstack([disc, start, joint])
    hull = ConvexHull(points).vertices.tolist()
    first, last = hull.index(count), hull.index(count + 1)
    ring = [hull[(first + step) % len(hull)] for step in range(len(hull) + 1)]
    cut = (last - first) % len(hull)
    sides = ring[: cut + 1], ring[cut:]
    lengths = [np.linalg.norm(np.diff(points[side], axis=0), axis=1).sum() for side in sides]
    over = max(zip(map(len, sides), lengths, strict=True))[1]  # the side that contains the disc
    string = over - far
    away = DM([0.6 * level, 0.8 * level, above])
    written = np.hypot(level, above) + float(excess(away, radius, side))
    assert written == pytest.approx(string, abs=1e-8)


@pytest.mark.parametrize(("upper", "lower"), [*product([BELOW, ABOVE], repeat=2)])
def test_cables_come_to_upper_and_lower_pulleys_from_their_sides(upper, lower):
    """Three low anchors and one above the platform, by the formula of the blind generator."""
    d, radius, h = ASIDE, 0.03, 1e-6
    robot, x = CableRobot(d, TOLERANCES), workspace(d, 12, np.random.default_rng(6))
    rising = np.array([lower, lower, lower, upper]) == BELOW

    def over(r):
        here, home = x[:, None] - d.anchors, d.home - d.anchors
        return over_pulley(here, r, rising) - over_pulley(home, r, rising)

    effect = PulleyRadius(ROBOT, robot, radius=radius, upper=upper, lower=lower)
    columns = effect.columns(at_rest(robot.inverse(x, robot.parameters.nominal)))[..., 0]
    more = (over(radius + h) - over(radius - h)) / (2 * h)
    np.testing.assert_allclose(columns * d.gain, -more, atol=1e-7)


@pytest.mark.parametrize("d", [ASIDE, EIGHT_CABLES], ids=["four", "eight"])
def test_the_platform_rests_where_squares_of_the_lengths_over_pulleys_are_least(d):
    """Cables pull along their ways from the pulleys, which the commands do not know of.

    By minimisation of what the lengths of the blind generator miss, for commands of the drawing
    to another machine: along ways from the anchors the platform is up to 0.2 mm off.
    """
    rng, radius = np.random.default_rng(12), 0.03
    robot, x = CableRobot(d, TOLERANCES), workspace(d, 8, rng)
    cables = robot.parameters.nominal.reshape(len(d.anchors), -1)  # anchor, joint, gain of each
    real, (m, k) = cables.copy(), (len(cables), x.shape[1])
    real[:, :-1] += rng.normal(scale=3e-3, size=real[:, :-1].shape)

    def over(pose):
        turn = Rotation.from_rotvec(pose[3:]) if k == 6 else Rotation.identity()
        joints = turn.apply(real[:, 3:6] if k == 6 else d.joints)
        return over_pulley(pose[:3] + joints - real[:, :3], radius, np.ones(m, dtype=bool))

    def rests(motors):
        wanted = over(d.home) + real[:, -1] * motors
        start = dict(x_scale=1e-3, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        return least_squares(lambda pose: over(pose) - wanted, d.home, **start).x

    chain = Chain(robot, np.zeros(3), 1e-3, (PulleyRadius(ROBOT, robot),))
    theta = np.zeros(chain.layout.size)
    theta[chain.layout.geometry], theta[chain.layout.effects] = real.ravel(), radius
    motors = robot.inverse(x, cables.ravel())
    found = chain.pose(at_rest(motors), theta)
    np.testing.assert_allclose(found, [rests(one) for one in motors], atol=1e-7)


@pytest.mark.parametrize("d", [ASIDE, EIGHT_CABLES], ids=["four", "eight"])
def test_readings_follow_the_radius_along_the_ways_from_the_pulleys(d):
    """Up to terms of what the lengths miss; along ways from the anchors up to 0.06 are missing."""
    robot, x = CableRobot(d, TOLERANCES), workspace(d, 50, np.random.default_rng(0))
    chain = Chain(robot, np.zeros(3), 1e-3, (PulleyRadius(ROBOT, robot),))
    theta, own, step = np.zeros(chain.layout.size), chain.layout.effects, 1e-5
    theta[chain.layout.geometry], theta[own] = robot.parameters.nominal, 0.03
    at = at_rest(robot.inverse(x, robot.parameters.nominal))
    more, less = theta.copy(), theta.copy()
    more[own], less[own] = 0.03 + step, 0.03 - step
    slope = (chain.predict(at, more) - chain.predict(at, less)) / (2 * step)
    written = chain.jacobian(at, theta)[:, :, own][:, :, 0]
    assert np.abs(written - slope).max() < 0.035 * np.abs(slope).max()


def test_pulleys_that_cables_come_to_from_above_are_told():
    seed = 8804
    trial, _ = scaled(Task("single", seed, (("pulley_radius", 400.0),), robot="cdpr8"))
    assert trial.cell.causes[0].values["rise"] == (False, True)  # at the upper, the lower ones
    found = diagnose(survey(trial.session, ROBOT.joints.names), ROBOT, seed=seed)
    (finding,) = found.verdict.findings
    assert finding.cause == "pulley_radius"
    assert finding.shape["cables_from_above"] == "at the upper pulleys"
    radius, true = finding.parameters["radius"], trial.cell.causes[0].values["radius"]
    assert abs(radius.value - true) < 4 * radius.std


def test_a_side_that_is_neither_is_refused():
    with pytest.raises(InputError, match=r"upper: 0.4 is not allowed; -1 or 1"):
        effect_named("pulley_radius", ROBOT, CABLES, {"upper": 0.4})


def test_drums_without_a_gear_have_no_eccentricity_beside_their_encoders():
    gear = np.array([10.0, 1.0, 10.0, 10.0])
    effect = DrumEccentricity(ROBOT, CableRobot(replace(FOUR_CABLES, gear=gear), TOLERANCES))
    assert {p.location for p in effect.parameters} == {"cable_1", "cable_3", "cable_4"}
    columns = effect.columns(at_rest(np.array([[5.0, -8.0, 12.0, 20.0]])))[0]
    assert not columns[1].any()
    assert (np.abs(columns[[0, 2, 3]]) > 0).sum(axis=1).tolist() == [2, 2, 2]
    direct = CableRobot(replace(FOUR_CABLES, gear=np.ones(4)), TOLERANCES)
    assert not DrumEccentricity(ROBOT, direct).suits


def test_pulley_is_exact_at_the_radius_that_was_found():
    effect, radius = PulleyRadius(ROBOT, CABLES), np.array([0.03])
    refined = effect.refined(radius)
    assert refined.settings == {"radius": 0.03, "upper": BELOW, "lower": BELOW}
    roughly, exactly = (e.columns(AT) @ radius * EIGHT_CABLES.gain for e in (effect, refined))
    second = 0.03**2  # over a length of about a metre or more
    assert 1e-6 < np.abs(roughly - exactly).max() < second
    assert 1e-3 < np.abs(exactly).max() < 60e-3
    assert effect.refined(np.array([-0.1])).radius == 0.0
