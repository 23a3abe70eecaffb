"""Tests of recommended measurements: they are computed and confirmed when carried out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.candidates import Candidate, columns_of, dimensions, subsets
from delta_calibration.diagnosis.contrast import Pair
from delta_calibration.diagnosis.experiments import (
    ALREADY,
    NOTHING,
    Outlook,
    next_experiment,
    visibility,
)
from delta_calibration.diagnosis.geometry import without_geometry
from delta_calibration.diagnosis.predicted_information import (
    AT_REST,
    Foresight,
    Products,
    Samples,
    stacked,
)
from delta_calibration.effects import EFFECTS, catalogue
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from recording_helpers import SHARED

ROBOT = load_robot("srbd")


def measured(plan, seed=5):
    """Evidence of a simulated session."""
    session = simulate_session(draw_machine(ROBOT, seed), plan, seed)
    return calibrated(survey(session, ROBOT.joints.names), ROBOT).evidence


@pytest.fixture(scope="module")
def poor():
    """Thirty poses from one side, no payload, nothing in motion."""
    return measured(make_plan("identify", ROBOT, count=30, both_sides=False))


def effect(cause, evidence, location=None):
    shape = next(iter(EFFECTS[cause](ROBOT, evidence.chain.mechanism).shapes(evidence.at)))
    return next(c for c in subsets(shape) if c.location == location)


def dimension(cause, evidence, location="joint_1"):
    found = (c for c in dimensions(evidence) if (c.cause, c.location) == (cause, location))
    return next(found)


def contrast(evidence, first, second):
    pair = Pair(first, second)
    layout = evidence.chain.layout
    return pair.contrast(pair.products(evidence), evidence.precision[layout.base], layout.geometry)


# Recommendations


def test_a_second_payload_shows_compliance_beside_geometry(poor):
    said = next_experiment(poor, effect("joint_compliance", poor), None)
    assert said == "repeat ten of the poses with a second payload of 2 kg"


def test_the_other_side_parts_backlash_from_a_zero_offset(poor):
    first = effect("backlash", poor, "joint_2")
    second = dimension("joint_zero_offset", poor, "joint_2")
    assert contrast(poor, first, second).cosine > 0.99
    said = next_experiment(poor, first, second)
    assert said == "approach ten of the poses from the other side"
    assert next_experiment(poor, second, first) == said


def test_motion_shows_what_depends_on_speed(poor):
    said = next_experiment(poor, effect("joint_lag", poor), None)
    assert said == "record circles of 200 mm at three speeds, both ways round"
    assert next_experiment(poor, effect("dynamic_deflection", poor), None).startswith(said)


def test_warmth_shows_what_grows(poor):
    said = next_experiment(poor, effect("thermal_growth_arm", poor), None)
    assert said.startswith("repeat ten of the poses after the machine has warmed by 10 K")


@pytest.mark.parametrize("against", [None, "forearm_length", "every length"])
def test_a_common_scale_takes_a_scale_bar(poor, against):
    """No motion of the cell separates the tracker's scale from a scale of all lengths."""
    first = effect("tracker_scale", poor)
    second = None
    if against == "every length":
        names = poor.chain.mechanism.parameters.names
        rows = [i for i, name in enumerate(names) if name.startswith(("arm_", "rod_"))]
        second = Candidate("forearm_length", "geometry", None, None, tuple(rows))
    elif against:
        second = dimension(against, poor)
    assert next_experiment(poor, first, second) == first.effect.outside


def test_equal_lags_are_a_latency_whatever_is_driven(poor):
    first, second = effect("timestamp_latency", poor), effect("joint_lag", poor)
    assert next_experiment(poor, first, second) == first.effect.outside


def test_play_and_friction_that_is_as_strong_at_any_speed_take_a_push_by_hand(poor):
    friction = effect("stick_slip", poor)
    alike = replace(friction, effect=replace(friction.effect, level=1.0))
    assert next_experiment(poor, effect("backlash", poor), alike) == alike.effect.outside


def test_base_and_platform_joints_are_one_and_the_same(poor):
    names = poor.chain.mechanism.parameters.names
    each = {c.rows[0]: c for c in dimensions(poor)}
    base, platform = (each[names.index(f"{part}_radial_1")] for part in ("base", "platform"))
    assert next_experiment(poor, base, platform) == NOTHING


def test_what_is_parted_needs_nothing():
    both = measured(make_plan("identify", ROBOT, count=30))
    first = effect("backlash", both, "joint_1")
    assert next_experiment(both, first, dimension("joint_zero_offset", both)) == ALREADY


def test_a_second_payload_is_another_where_one_was_there(poor):
    plan = make_plan("identify", ROBOT, count=30, both_sides=False)
    mass = np.where(np.arange(30) % 2, 1.0, 0.0)
    two = measured(replace(plan, payload=mass))
    assert "repeat ten of the poses with a payload of 3 kg" in Outlook.on(two, ROBOT).sentences
    assert "repeat ten of the poses with a second payload of 2 kg" in (
        Outlook.on(poor, ROBOT).sentences
    )


# Basis of the recommendations


def test_products_of_parts_add_up_to_the_evidences_own(poor):
    """Compared with the inner products of the whole evidence, computed in another way."""
    both = measured(make_plan("rich", ROBOT, count=14, dwell=0.3))
    for evidence in (poor, both):
        columns = columns_of(effect("encoder_eccentricity", evidence), evidence)
        every = np.ones(evidence.chain.layout.base.stop, dtype=bool)
        precision = evidence.precision[: len(every)]
        whole = Products.of(evidence, columns).information(precision, every)
        np.testing.assert_allclose(whole, evidence.information(columns), rtol=1e-6, atol=1e-6)
    half = np.arange(len(poor)) % 2 == 0
    parts = [np.flatnonzero(half), np.flatnonzero(~half)]
    columns = columns_of(effect("encoder_eccentricity", poor), poor)
    each = [
        Products.of(poor.take(rows), columns.reshape(len(poor), 3, -1)[rows].reshape(-1, 6))
        for rows in parts
    ]
    added = (each[0] + each[1]).information(poor.precision, np.ones(len(poor.precision), bool))
    np.testing.assert_allclose(added, poor.information(columns), rtol=1e-6, atol=1e-6)


def test_poses_foreseen_where_poses_were_have_their_columns(poor):
    """Geometry, reflector offset and frame alike, in the same units."""
    foresight = Foresight.about(poor)
    samples = Samples(poor.at, np.full(len(poor), AT_REST))
    again = foresight.evidence(samples, foresight.pose(samples))
    np.testing.assert_allclose(again.nuisance, poor.nuisance, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(again.precision, poor.precision)


def test_the_signal_foreseen_is_the_one_that_is_then_measured(poor):
    """A session of the same machine that includes the recommended stops, fitted again."""
    first = effect("joint_compliance", poor)
    outlook = Outlook.on(poor, ROBOT)
    number = next(i for i, said in enumerate(outlook.sentences) if "payload" in said)
    options = dict(outlook.options(Pair(first, None)))
    now, foreseen = options[ALREADY], options[outlook.sentences[number]]
    added = outlook.foreseen.take(np.flatnonzero(outlook.number == number))
    plan = make_plan("identify", ROBOT, count=30, both_sides=False)
    near = np.argmin(np.linalg.norm(plan.joint[:, None] - added.at.joint[None], axis=-1), axis=0)
    rows = np.concatenate([np.arange(30), near])
    after = measured(
        replace(
            plan,
            target=plan.target[rows],
            joint=plan.joint[rows],
            direction=plan.direction[rows],
            payload=np.repeat([0.0, 2.0], [30, 10]),
        )
    )
    real = contrast(after, effect("joint_compliance", after), None)
    assert real.signal - now.signal == pytest.approx(foreseen.signal, rel=0.3)
    assert real.signal > 3 * now.signal


def test_visibility_is_the_information_of_a_typical_size(poor):
    """Beside the frame alone and beside geometry too; the geometry absorbs a scale."""
    scale = effect("tracker_scale", poor)
    columns = columns_of(scale, poor)
    expected = [e.information(columns)[0, 0] for e in (without_geometry(poor), poor)]
    np.testing.assert_allclose(visibility(poor, scale.effect), expected, rtol=1e-5, atol=1e-6)
    before, after = visibility(poor, scale.effect)
    assert before > 1
    assert after < 1e-2 * before
    lag = EFFECTS["joint_lag"](ROBOT, poor.chain.mechanism)
    assert visibility(poor, lag) == (0.0, 0.0)


def test_signs_are_free_where_a_parameter_may_have_either(poor):
    """Compliances add up because none is negative; zero drifts do not."""
    for cause, together_ in (("joint_compliance", True), ("joint_zero_drift", False)):
        candidate = effect(cause, poor)
        information = poor.information(columns_of(candidate, poor))
        expected = information.sum() if together_ else np.trace(information)
        assert visibility(poor, candidate.effect)[1] == pytest.approx(expected, rel=1e-5)


# Recommendations are feasible


def test_proposals_keep_to_limits_and_reach(poor):
    outlook = Outlook.on(poor, ROBOT)
    joint = outlook.foreseen.at.joint
    assert (joint >= ROBOT.joints.lower).all()
    assert (joint <= ROBOT.joints.upper).all()
    mechanism = poor.chain.mechanism
    nominal = mechanism.parameters.nominal
    assert (mechanism.condition(joint, mechanism.forward(joint, nominal), nominal) < 20).all()
    assert (outlook.foreseen.at.time > poor.at.time.max()).all()
    used = Outlook.on(poor).foreseen.at.joint  # without a robot: no farther than the session
    assert (used >= poor.at.joint.min(axis=0)).all()
    assert (used <= poor.at.joint.max(axis=0)).all()


def test_farther_out_is_farther_out(poor):
    outlook = Outlook.on(poor, ROBOT)
    number = next(i for i, said in enumerate(outlook.sentences) if "farther" in said)
    new = outlook.foreseen.pose[outlook.number == number, :3]
    beyond = Region.of(poor.pose[:, :3]).outside(new)
    assert np.median(beyond) > 0.05


def test_paths_of_several_experiments_stay_apart(poor):
    one = Samples(poor.at, np.repeat([0, 1, AT_REST], [10, 10, 10]))
    both = stacked([one, one, Samples(poor.at, np.full(len(poor), AT_REST))])
    assert len(both) == 3 * len(poor)
    assert sorted(set(both.path.tolist())) == [AT_REST, 0, 1, 2, 3]
    assert (both.path[:30] != both.path[30:60])[:20].all()


# Sessions with missing data


def test_nothing_known_of_payload_or_direction_is_no_crash(poor):
    unknown = np.full(len(poor), np.nan)
    at = replace(
        poor.at,
        payload=unknown,
        payload_centre=np.full((len(poor), 3), np.nan),
        direction=np.zeros_like(poor.at.direction),
        travel=np.full_like(poor.at.travel, np.inf),
    )
    bare = replace(poor, at=at)
    for cause in (e.cause for e in catalogue(ROBOT, poor.chain.mechanism)):
        said = next_experiment(bare, effect(cause, poor), None)
        assert said
    payload = next_experiment(bare, effect("joint_compliance", poor), None)
    assert payload == "repeat ten of the poses with a second payload of 2 kg"
    side = next_experiment(bare, effect("backlash", poor), None)
    assert side == "approach ten of the poses from the other side"


@pytest.mark.skipif(not SHARED.is_dir(), reason="no shared sessions beside the repository")
def test_a_long_session_is_thinned_without_losing_what_it_tells():
    session = read_session(SHARED / "sessions" / "none")
    whole = calibrated(survey(session, ROBOT.joints.names), ROBOT).evidence
    outlook = Outlook.on(whole, ROBOT)
    assert len(outlook.measured) < len(whole) / 4
    for cause in ("joint_lag", "joint_compliance", "transmission_error", "backlash"):
        full = contrast(whole, effect(cause, whole), None)
        thin = contrast(outlook.measured, effect(cause, whole), None)
        assert thin.signal == pytest.approx(full.signal, rel=0.1)
    assert outlook.next_experiment(effect("tracker_scale", whole), None).startswith(
        "measure a scale bar"
    )
    assert outlook.next_experiment(effect("backlash", whole), None) == ALREADY
