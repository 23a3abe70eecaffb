"""Diagnosis from observations of any kind: closures of a cable robot, points of a tracker.

The hidden causes are generated independently of the effects: spirals solved for their angle,
elastic cables solved for the pose of least energy.
"""

from __future__ import annotations

from dataclasses import fields, replace
from math import dist

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.cli.diagnose import describe
from delta_calibration.data import at_rest
from delta_calibration.diagnosis import Measured, Observed, diagnose_observations
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.search import find
from delta_calibration.documents import check_document, load_schema
from delta_calibration.effects import effect_named
from delta_calibration.effects.backlash import Backlash
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.tracker_scale import TrackerScale
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation.closures import ClosureAtPose, ClosureWithoutPose, spared
from delta_calibration.estimation.encoder_closures import EncoderClosure
from delta_calibration.estimation.image import PointInImage
from delta_calibration.estimation.measurements import (
    DistanceBetween,
    HeightAtContact,
    PlacedMachine,
    PointMeasured,
    PoseMeasured,
)
from delta_calibration.geometry import Camera, Frame
from delta_calibration.robot import load_robot
from real_hangprinter import ROBOT

CABLES = load_robot(ROBOT)
HUNG = CABLES.commanded
DELTA = load_robot("srbd")
BUILD_UP, NOISE = 70e-6, 0.3e-3


def conditions(joint):
    n = len(joint)
    return replace(
        at_rest(joint),
        time=60.0 * np.arange(n),
        payload=np.zeros(n),
        payload_centre=np.zeros((n, 3)),
    )


def hung(build_up, rng, n=60, seen=12, said=NOISE):
    """Closures of a machine with errors of its dimensions and, if given, drum build-up."""
    d = CABLES.dimensions
    anchors = d.anchors + rng.normal(0, 20e-3, (4, 3))
    x = rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 1.2], (n, 3))
    length = np.array([[dist(anchor, place) for anchor in anchors] for place in x])
    out = d.tackle * (length + rng.normal(0, NOISE, (n, 4)) - np.linalg.norm(anchors, axis=1))
    radius = 1.004 * d.drum_radius
    turn = out / radius
    if build_up:
        turn = (radius - np.sqrt(radius**2 - build_up * out)) / (build_up / 2)
    joint = turn * d.gear
    at = conditions(joint)
    first, last = np.arange(seen), np.arange(seen, n)
    return [
        Measured(ClosureAtPose(joint[first], x[first], 4, said), at.take(first)),
        Measured(ClosureWithoutPose(joint[last], 1, said), at.take(last)),
    ]


@pytest.mark.parametrize("stated", [True, False])
def test_hidden_build_up_is_named_from_closures(stated):
    said = NOISE if stated else 10 * NOISE  # if it is not stated, its size does not matter
    measured = hung(BUILD_UP, np.random.default_rng(3), said=said)
    found = diagnose_observations(measured, HUNG, CABLES, stated=stated)
    finding = found.verdict.findings[0]
    assert finding.cause == "drum_build_up"
    assert finding.confidence > 0.9
    (estimate,) = finding.parameters.values()
    assert abs(estimate.value - BUILD_UP) < 4 * estimate.std
    assert estimate.std < 0.2 * BUILD_UP
    assert found.verdict.extended.held_out_rms_mm < 0.6 * found.verdict.calibrated.held_out_rms_mm
    assert found.verdict.calibrated.model == "geometry"  # no frame is involved
    assert (found.verdict.unknown_structure.tests["lack_of_fit"] is None) is not stated
    check_document(found.verdict.as_dict(), load_schema("verdict"), "verdict")
    assert "drum_build_up" in describe(found.verdict)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_found_where_nothing_is(seed):
    found = diagnose_observations(
        hung(0.0, np.random.default_rng(seed), said=10 * NOISE), HUNG, CABLES, stated=False
    )
    assert not found.verdict.findings
    assert not found.verdict.unknown_structure.found
    assert found.verdict.noise_mm == pytest.approx(1e3 * NOISE, rel=0.3)


def test_a_cause_that_is_not_tried_is_not_given_another_name():
    """Without build-up in the list, drum scales and anchors must not be named instead."""
    harmless = [Backlash(CABLES, HUNG)]  # its conditions are not recorded
    measured = hung(BUILD_UP, np.random.default_rng(3))
    found = diagnose_observations(measured, HUNG, CABLES, effects=harmless)
    assert not [f for f in found.verdict.findings if f.kind != "geometry"]
    assert found.verdict.unknown_structure.found


def test_the_fit_is_that_of_plain_least_squares():
    """Compared with SciPy, with each unmeasured pose as an unknown."""
    from scipy.optimize import least_squares

    measured = hung(BUILD_UP, np.random.default_rng(5), n=24, seen=10)
    model = Observed.of(HUNG, measured)
    p, prior = HUNG.parameters, HUNG.parameters.prior
    known, alone = (m.observation for m in measured)

    def rows(z):
        g, x = p.nominal + prior * z[:16], z[16:].reshape(-1, 3)
        parts = [
            HUNG.closure(known.joint, known.pose, g).ravel(),
            HUNG.closure(alone.joint, x, g).ravel(),
        ]
        return np.concatenate([*(part / NOISE for part in parts), z[:16]])

    start = np.append(np.zeros(16), HUNG.forward(alone.joint, p.nominal).ravel())
    best = least_squares(rows, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = (model.theta[:16] - p.nominal) / prior
    np.testing.assert_allclose(found, best.x[:16], atol=2e-3)
    left = np.sum(model.beside.left() ** 2) + np.sum(found**2)
    assert left == pytest.approx(2 * best.cost, rel=1e-4)


def test_what_a_free_pose_spares_is_all_that_is_missed():
    """|N^T f| = |f| at the pose of least misfit, N^T f_x = 0, and derivatives by differences."""
    _, alone = (m.observation for m in hung(BUILD_UP, np.random.default_rng(4)))
    g = HUNG.parameters.nominal
    machine = PlacedMachine.of(HUNG, g, Frame.identity())
    x = machine.chain.mechanism.forward(alone.joint, machine.geometry)
    f = HUNG.closure(alone.joint, x, g)
    missed = alone.missed(machine)
    np.testing.assert_allclose(np.abs(missed[:, 0]), np.linalg.norm(f, axis=1), rtol=1e-6)
    across = spared(HUNG.closure_by_pose(alone.joint, x, g))
    np.testing.assert_allclose(across @ HUNG.closure_by_pose(alone.joint, x, g), 0, atol=1e-12)
    slope = alone.slopes(machine)
    for k, h in [(0, 1e-5), (3, 1e-8), (14, 1e-5)]:
        step = h * np.eye(len(g))[k]
        ahead, back = (
            alone.missed(PlacedMachine.of(HUNG, g + way, Frame.identity()))
            for way in (step, -step)
        )
        numeric = (back - ahead) / (2 * h)
        np.testing.assert_allclose(slope[..., k], numeric, atol=0.03 * np.abs(numeric).max())


def tracked(rng, scale=0.0, n=40):
    """Points of a nominal Delta, measured by a tracker with a relative error of its lengths."""
    drawn = DELTA.commanded
    sure = replace(
        drawn.tolerances, **{f.name: 1e-9 for f in fields(drawn.tolerances)}
    )  # exact dimensions, so that they cannot absorb the scale of the tracker
    delta = type(drawn)(drawn.dimensions, sure)
    frame = Frame.from_vector(np.array([0.1, -0.2, 1.0, 0.5, 2.0, 0.3]))
    joint = rng.uniform(-0.2, 0.9, (n, 3))
    g = delta.parameters.nominal
    x = delta.forward(joint, g)
    point = (1 + scale) * frame.apply(delta.position(x)) + 10e-6 * rng.standard_normal((n, 3))
    return delta, frame, Measured(PointMeasured(joint, point, np.zeros(3), 10e-6), at_rest(joint))


def test_slopes_by_joints_are_those_of_the_chain():
    """Differences of the residuals agree with the implicit function theorem of the chain."""
    delta, frame, measured = tracked(np.random.default_rng(1))
    model = Observed.of(delta, [measured], frame)
    evidence = model.evidence
    chain = evidence.chain
    seen = chain.see(evidence.at, model.theta)
    np.testing.assert_allclose(evidence.by_joints, seen.by_joints / 10e-6, rtol=1e-6, atol=1e-2)
    by_geometry = seen.jacobian[..., chain.layout.geometry] / 10e-6
    np.testing.assert_allclose(evidence.by_geometry, by_geometry, rtol=1e-8, atol=1e-4)
    assert model.placed
    assert model.reads


def test_an_effect_on_readings_is_fitted_where_there_are_readings():
    delta, frame, measured = tracked(np.random.default_rng(2), scale=3e-4)
    scale = TrackerScale(DELTA, delta)
    term = Candidate(scale.cause, scale.kind, None, scale, (0,))
    model = Observed.of(delta, [measured], frame).fitted((term,))
    assert model.values(term)[0] == pytest.approx(3e-4, rel=0.05)
    assert not Observed.of(HUNG, hung(0.0, np.random.default_rng(1))).reads


def test_a_sample_out_of_the_common_is_set_aside():
    measured = hung(0.0, np.random.default_rng(6))
    known = measured[0].observation
    pose = known.pose.copy()
    pose[3, 2] += 0.03
    bad = replace(known, pose=pose)
    model = Observed.of(HUNG, [Measured(bad, measured[0].at), measured[1]])
    clean = Observed.of(HUNG, measured)
    assert model.facts.rejected["outlier"] >= 1
    assert clean.facts.rejected["outlier"] == 0
    np.testing.assert_allclose(model.theta[:16], clean.theta[:16], atol=60e-3)


def test_what_cannot_be_diagnosed_is_refused():
    joint = np.full((3, 3), 0.1)
    pairs = DistanceBetween(joint, joint + 0.1, np.full(3, 0.1), 1e-4)
    with pytest.raises(InputError, match="distance: 2 sets of joints a number are not allowed"):
        Observed.of(DELTA.commanded, [Measured(pairs, at_rest(joint))])
    height = HeightAtContact(joint, np.zeros(3), 1e-4)
    with pytest.raises(InputError, match="height: conditions are of other joints"):
        Measured(height, at_rest(joint + 1))
    with pytest.raises(InputError, match="observations: none is not allowed"):
        Observed.of(DELTA.commanded, [])
    _, _, seen = tracked(np.random.default_rng(1))
    with pytest.raises(InputError, match="frame: none is not allowed with a tracker"):
        Observed.of(DELTA.commanded, [seen])
    far = HeightAtContact(np.full((3, 3), 3.0), np.zeros(3), 1e-4)
    with pytest.raises(DataError, match=r"height: sample 1 cannot be predicted: joints 3.0000"):
        Observed.of(DELTA.commanded, [Measured(far, at_rest(far.joint))])
    with pytest.raises(InputError, match="redundancy 0 is not allowed"):
        ClosureWithoutPose(joint, 0, 1e-3)
    with pytest.raises(InputError, match=r"closure: pose \(2, 3\) is not allowed; \(3, 3\)"):
        ClosureAtPose(joint, np.zeros((2, 3)), 4, 1e-3)


def test_a_joint_curve_is_any_smooth_function_of_the_angle():
    """It interpolates sin(11 q) to 2e-3, vanishes outside its range, and sums to one."""
    delta = DELTA.commanded
    q = np.random.default_rng(1).uniform(-0.3, 1.0, (400, 3))
    curve = JointCurve.over(DELTA, delta, q, 0.05)
    assert curve.wrong() == ""
    columns = curve.columns(at_rest(q))
    assert columns.shape == (400, 3, len(curve.parameters))
    np.testing.assert_allclose(columns.sum(axis=2), 1.0)
    own = [p.location == "joint_2" for p in curve.parameters]
    assert not columns[:, 1][:, np.logical_not(own)].any()
    design, wave = columns[:, 1][:, own], np.sin(11 * q[:, 1])
    left = wave - design @ np.linalg.lstsq(design, wave, rcond=None)[0]
    assert np.abs(left).max() < 2e-3
    assert not curve.columns(at_rest(q + 5.0)).any()
    assert "one a joint" in replace(curve, lower=(0.0,)).wrong()
    assert "over lower" in replace(curve, upper=curve.lower).wrong()


def kinds(cables, joint):
    """One observation of each kind of a machine with four cables; the values do not matter."""
    n = len(joint)
    turned = np.broadcast_to(np.eye(3), (n, 3, 3))
    camera = Camera(np.array([900.0, 900.0]), np.array([600.0, 500.0]))
    place = Frame.from_vector(np.array([np.pi, 0.0, 0.0, 0.0, 0.0, 6.0]))
    offset = np.array([0.02, 0.01, -0.03])
    return [
        PointMeasured(joint, np.zeros((n, 3)), offset, 1e-4),
        PoseMeasured(joint, np.zeros((n, 3)), offset, 1e-4, turned, 1e-4),
        HeightAtContact(joint, np.zeros(n), 1e-4),
        PointInImage(joint, np.zeros((n, 2)), offset, camera, 0.1, place),
        ClosureAtPose(joint, cables.forward(joint, cables.parameters.nominal) + 1e-3, 4, 1e-3),
        ClosureWithoutPose(joint, 1, 1e-3),
        EncoderClosure.of(cables, joint, 1e-3),
    ]


@pytest.mark.parametrize("number", range(7))
def test_every_kind_goes_with_effects_and_joints_as_differences_say(number):
    """Drum build-up and backlash shift the joints, and each kind sees that as differences do.

    The closures are met here. Otherwise the pose of least misfit moves by more than its slopes
    predict.
    """
    rng = np.random.default_rng(8)
    x = rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 1.2], (5, 3))
    joint = HUNG.inverse(x, HUNG.parameters.nominal)
    observation, at = kinds(HUNG, joint)[number], conditions(joint)
    at = replace(at, direction=np.where(rng.uniform(size=joint.shape) < 0.5, -1.0, 1.0))
    effects = (effect_named("drum_build_up", CABLES, HUNG, {}), Backlash(CABLES, HUNG))
    chain = Chain(HUNG, np.zeros(3), 1.0, effects)
    frame = Frame.from_vector(np.array([0.1, 0.2, -0.3, 0.4, 0.5, 0.6]))
    theta = chain.join(HUNG.parameters.nominal, np.zeros(3), frame)
    own = chain.layout.effects
    about = observation.linearized(chain.predictor(at), theta)
    size = np.abs(about.by_theta).max(axis=(0, 1))
    for k in range(own.start, own.stop):
        h = 1e-3 * chain.parameters.prior[k]
        ahead, back = (
            observation.linearized(chain.predictor(at), theta + way * np.eye(len(theta))[k]).missed
            for way in (h, -h)
        )
        numeric = (back - ahead) / (2 * h)
        np.testing.assert_allclose(about.by_theta[..., k], numeric, atol=2e-3 * size[k])


@pytest.mark.parametrize(("size", "seed"), [(3e-5, 1), (3e-5, 3), (5e-5, 3)])
def test_where_the_noise_is_estimated_a_step_is_no_settling(size, seed):
    """Each fit has chi square of one then; it is the spread of the noise that tells them apart."""
    drawn, rng = DELTA.commanded, np.random.default_rng(seed)
    frame = Frame.from_vector(np.array([0.1, -0.2, 1.0, 0.5, 2.0, 0.3]))
    joint = rng.uniform(-0.2, 0.9, (60, 3))
    at = conditions(joint)
    slip = size * (at.time > 1150.0)[:, None] * np.array([1.0, -0.8, 0.9])
    place = drawn.position(drawn.forward(joint + slip, drawn.parameters.nominal))
    point = frame.apply(place) + 10e-6 * rng.standard_normal((60, 3))
    seen = Measured(PointMeasured(joint, point, np.zeros(3), 10e-6), at)
    model = Observed.of(drawn, [seen], frame, stated=False)
    causes = ("joint_zero_drift", "backlash", "joint_scale", "tracker_scale", "tracker_drift")
    effects = [effect_named(cause, DELTA, drawn, {}) for cause in causes]
    (term,) = find(model, effects, np.random.default_rng(0)).model.terms
    assert term.cause == "joint_zero_drift"
    assert term.effect.step_at == pytest.approx(1150.0, abs=90.0)
