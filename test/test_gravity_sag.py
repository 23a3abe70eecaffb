"""Tests of arms whose joints bear weight: they give way, or it closes their backlash."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.cli.main import run
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.candidates import Candidate, all_columns
from delta_calibration.diagnosis.constants import LIKELIER
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.diagnosis.findings import HeldOutModels, spread_of
from delta_calibration.diagnosis.fitted import beside
from delta_calibration.diagnosis.law_grammar import Grammar
from delta_calibration.diagnosis.law_search import doubts_of_names
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.effects.backlash import Backlash
from delta_calibration.effects.encoder_eccentricity import EncoderEccentricity
from delta_calibration.effects.gravity_sag import GravitySag
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from real_machines import DATA

REAL = DATA / "ur5_wam_lasertracker"
FILES = "benchmarks/real_arms"


def heights(arm, q, moments):
    """Sum of the heights of the links' first moments, by scipy's rotations alone."""
    turn, place, total = Rotation.identity(), np.zeros(3), 0.0
    for i, link in enumerate(arm.dimensions.links):
        turn = turn * Rotation.from_rotvec([link.twist, 0.0, 0.0])
        turn = turn * Rotation.from_rotvec([0.0, 0.0, q[i] + link.zero])
        total += (place + turn.apply(moments[i]))[2]
    return total


def test_a_joint_turns_by_the_slope_of_the_weights_height():
    """Torque is the derivative of potential energy; its effect on each joint, by differences."""
    robot = load_robot("ur10")
    arm = robot.model()
    effect = GravitySag(robot, arm)
    rng = np.random.default_rng(3)
    moments = rng.normal(size=(6, 3))
    names = [p.name.split("_")[1:] for p in effect.parameters]
    # The same moments for all joints, as for one arm with equal gears.
    values = np.array([moments[int(k[:-1]) - 1]["xyz".index(k[-1])] for _, k in names])
    for q in rng.uniform(-3.0, 3.0, (5, 6)):
        turned = (effect.columns(at_rest(q[None])) @ values)[0]
        slope = np.zeros(6)
        for j in range(6):
            step = np.zeros(6)
            step[j] = 1e-6
            more, less = (heights(arm, q + s * step, moments) for s in (1, -1))
            slope[j] = (more - less) / 2e-6
        np.testing.assert_allclose(turned, -slope, atol=1e-8)


def test_it_suits_arms_of_unknown_mass_that_bear_weight():
    robots = [load_robot(name) for name in ("scara", "ur10", "linear_delta", "srbd")]
    have = {r.name for r in robots if "gravity_sag" in {e.cause for e in catalogue(r, r.model())}}
    assert have == {"ur10"}  # a SCARA's axes are vertical


def weighing(robot: Robot, masses: tuple[float, ...]) -> Robot:
    links = tuple(
        replace(link, mass=mass) for link, mass in zip(robot.dimensions.links, masses, strict=True)
    )
    return replace(robot, dimensions=replace(robot.dimensions, links=links))


def test_weight_is_found_and_foretold_without_the_masses():
    """The machine has masses and compliant gears; the calibration knows neither."""
    plain = load_robot("ur10")
    heavy = weighing(plain, (7.8, 12.9, 4.3, 2.0, 2.0, 0.4))
    plan = make_plan("identify", plain, count=120, seed=5)
    machine = draw_machine(heavy, 5, hidden={"reducer_compliance": {"value": "3e-5"}})
    session = simulate_session(machine, plan, 5)
    arm = plain.model()
    effects = (GravitySag(plain, arm), EncoderEccentricity(plain, arm), Backlash(plain, arm))
    found = diagnose(survey(session, plain.joints.names), plain, effects=effects).verdict
    assert [f.cause for f in found.findings if f.kind == "drive"] == ["gravity_sag"]
    assert found.extended.held_out_rms_mm < 1.15 * found.noise_mm
    assert found.calibrated.held_out_rms_mm > 1.5 * found.noise_mm


def test_weight_is_found_where_masses_are_stated_but_no_payload():
    """As tables of other people are; torques cannot be computed, but they follow the links."""
    plain = load_robot("ur10")
    robot = weighing(plain, (7.8, 12.9, 4.3, 2.0, 2.0, 0.4))
    machine = draw_machine(robot, 9, hidden={"reducer_compliance": {"value": "3e-5"}})
    session = simulate_session(machine, make_plan("identify", plain, count=120, seed=9), 9)
    seen = survey(session, plain.joints.names)
    unknown = replace(seen.poses, payload=np.full(len(seen.poses), np.nan))
    of_path = seen.paths.conditions
    moving = replace(of_path, payload=np.full(len(of_path), np.nan))
    names = ("gravity_sag", "reducer_compliance", "encoder_eccentricity")
    effects = [e for e in catalogue(robot, robot.model()) if e.cause in names]
    for poses, on_paths, cause in (
        (seen.poses, of_path, "reducer_compliance"),
        (unknown, moving, "gravity_sag"),
    ):
        told = replace(seen, poses=poses, paths=replace(seen.paths, conditions=on_paths))
        found = diagnose(told, robot, effects=effects).verdict
        assert [f.cause for f in found.findings] == [cause]
        assert found.extended.held_out_rms_mm < 1.15 * found.noise_mm


def test_what_an_arm_carries_tells_how_its_joints_give_way():
    """Links of known mass on springs, and two payloads: springs found without those masses."""
    plain, spring = load_robot("ur10"), 3e-5
    heavy = weighing(plain, (7.8, 12.9, 4.3, 2.0, 2.0, 0.4))
    plan = make_plan("rich", plain, count=25, seed=8, payload=4.0)
    machine = draw_machine(heavy, 8, hidden={"reducer_compliance": {"value": str(spring)}})
    seen = survey(simulate_session(machine, plan, 8), plain.joints.names)
    (sag,) = GravitySag(plain, plain.model()).shapes(seen.poses.conditions)
    assert sag.settings == {"payload": "known"}
    whole = Candidate(sag.cause, sag.kind, None, sag, tuple(range(len(sag.parameters))))
    model = calibrated(seen, plain).fitted((whole,))
    gives = [n for n, name in enumerate(sag.parameters.names) if name.startswith("compliance")]
    found = model.values(whole)[gives]
    std = (spread_of(beside(model.evidence, ()), model, whole)[0] * sag.parameters.prior)[gives]
    assert (np.abs(found - spring) < 3 * std).all()
    assert (std[[1, 2]] < 0.1 * spring).all()  # of the joints that bear the weight


def test_a_payload_that_stays_is_a_part_of_the_arms_own_weight():
    robot = load_robot("ur10")
    at = at_rest(np.zeros((3, 6)))
    sag = GravitySag(robot, robot.model())
    for payload in (np.full(3, 2.0), np.array([0.0, np.nan, 2.0])):
        assert [s.settings for s in sag.shapes(replace(at, payload=payload))] == [
            {"payload": "unknown"}
        ]
    with pytest.raises(InputError, match="payload: 'heavy' is not allowed; unknown or known"):
        effect_named("gravity_sag", robot, robot.model(), {"payload": "heavy"})


def energy(arm, q):
    """Energy of weight [J] of uniform rods from joint to joint, by scipy's rotations alone."""
    turn, place, ends = Rotation.identity(), np.zeros(3), []
    for angle, link in zip(q, arm.links, strict=True):
        place = place + turn.apply([link.length, 0.0, 0.0])
        turn = turn * Rotation.from_rotvec([link.twist, 0.0, 0.0])
        turn = turn * Rotation.from_rotvec([0.0, 0.0, angle + link.zero])
        place = place + turn.apply([0.0, 0.0, link.offset])
        ends.append(place[2])
    ends.append((place + turn.apply(arm.tool))[2])
    middles = (np.array(ends[1:]) + ends[:-1]) / 2
    return 9.80665 * float(middles @ [link.mass for link in arm.links])


def test_backlash_that_weight_closes_on_either_side_is_named():
    """Joint 2 is off by half its gap: where weight lies, or by friction as it came there."""
    plain, gap, friction, step = load_robot("ur10"), 3e-4, 8.0, np.eye(6)[1] * 1e-5
    heavy = weighing(plain, (7.8, 12.9, 4.3, 2.0, 2.0, 0.4))
    machine, plan = draw_machine(heavy, 6), make_plan("identify", plain, count=60, seed=6)
    seen = survey(simulate_session(machine, plan, 6), plain.joints.names)
    start, rng, none = calibrated(seen, heavy), np.random.default_rng(6), np.zeros(0, int)
    places = rng.uniform([-3, -2.8, -1.5, -2, -2, -2], [3, -0.3, 1.5, 2, 2, 2], (200, 6))
    joint = places[seen.poses.place] + rng.normal(0.0, 2e-6, seen.poses.joint.shape)
    at = replace(seen.poses.conditions, joint=joint)
    point = start.bare.predict(at, start.theta) + rng.normal(0.0, 1e-5, seen.poses.point.shape)
    reading = joint.copy()
    for q, came in zip(reading, at.direction[:, 1], strict=True):
        more, less = (energy(heavy.dimensions, q + s * step) for s in (1, -1))
        torque = (more - less) / 2e-5
        q[1] += gap / 2 * (np.sign(torque) if abs(torque) > friction else came)
    paths = seen.paths
    paths = replace(paths, conditions=paths.conditions.take(none), count=none, path=none)
    seen = replace(seen, poses=replace(seen.poses, joint=reading, point=point), paths=paths)
    (said,) = [f for f in diagnose(seen, heavy).verdict.findings if f.kind == "drive"]
    assert (said.cause, said.location) == ("backlash", "joint_2")
    found = said.parameters["gap_2"]
    assert abs(found.value - gap) < 3 * found.std < 0.2 * gap


@pytest.mark.parametrize(("readings", "tried"), [(20, 0), (60, 1), (1000, 2)])
def test_a_curve_is_tried_as_finely_as_there_are_readings(readings: int, tried: int):
    robot = load_robot("ur10")
    joint = np.random.default_rng(0).uniform(-1.0, 1.0, (readings, 6))
    curve = JointCurve(robot, robot.model())
    assert len(list(curve.shapes(at_rest(joint)))) == tried


def imported(arm: str, folder) -> str:
    path = str(folder / arm)
    own = ("--robot", f"{FILES}/{arm}.yaml", "--mapping", f"{FILES}/{arm}_mapping.yaml")
    assert run(["import", str(REAL / f"{arm}_grid.csv"), *own, "--out", path]) == 0
    return path


@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="measurements of real machines are not there")
def test_a_cable_driven_arm_has_play_and_gives_way(tmp_path):
    """Barrett WAM: published is a mean of 2.92 mm with a graph network beside the geometry.

    No law is a reason to doubt the two: "an error by direction" is the play itself, and products
    of joint angles explain as much as weight does but predict unseen sectors no better.
    """
    robot = load_robot(f"{FILES}/wam.yaml")
    path = imported("wam", tmp_path)
    start = calibrated(survey(read_session(path), robot.joints.names), robot)
    play, sag = (
        Candidate(e.cause, e.kind, None, e, tuple(range(len(e.parameters))))
        for e in (Backlash(robot, robot.model()), GravitySag(robot, robot.model()))
    )
    models = [(), (play,), (sag,), (play, sag)]
    errors = {}
    for terms in models:
        held = HeldOutModels(start.fitted(terms) if terms else start)
        errors[terms] = held.mm(held.terms(terms, held.sectors))
    assert errors[()] < 2.8
    assert errors[play, sag] < 2.05
    assert errors[play, sag] < 0.9 * min(errors[play,], errors[sag,])
    both = start.fitted((play, sag)).rested()
    whole, grammar = both.evidence, Grammar.of(both.evidence, robot)
    part = held.parts_for(whole, all_columns(both.terms, whole))
    for i, term in enumerate(both.terms):
        without = beside(whole, (both.terms[1 - i],))
        assert doubts_of_names(without, (term,), grammar, part) < LIKELIER
