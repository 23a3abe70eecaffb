"""Tests of signs, zeros and azimuths of the robot file: other readings of the same machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blind import hide
from delta_calibration.calibration_file import from_identification
from delta_calibration.compensation import JointCompensator
from delta_calibration.compensation.machine import IdentifiedMachine, Swarm
from delta_calibration.data import Conditions, at_rest, survey
from delta_calibration.description import describe
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.effects.base import SENSOR, Stage
from delta_calibration.errors import ConfigError
from delta_calibration.estimation import chain_of, identify
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.chain_constants import OF_INERTIA, OF_WEIGHT
from delta_calibration.plans import make_plan
from delta_calibration.plans.points import joints_toward
from delta_calibration.region import Region
from delta_calibration.robot import Robot, load_robot, robot_document, robot_from
from delta_calibration.simulation import draw_machine
from delta_calibration.simulation.climate import PARTS
from delta_calibration.simulation.machine import standing
from export_bench import Compiled, commands, machine, moving, needs_compiler
from other_drives import in_readings, other, other_document

SAME = 1e-9
MACHINES = [
    ("srbd", "rotary_delta"),
    ("srbd", "six_rod_delta"),
    ("linear_delta", None),
    ("cdpr8", None),
    ("five_axis", None),
    ("scara", None),
    ("ur10", None),
]
# Depend on the drive's own angle, or have its sign.
OF_READINGS = (
    "encoder_eccentricity",
    "transmission_error",
    "joint_zero_drift",
    "joint_error_curve",
    "counter_zero_offset",
)


def pair(name: str, model: str | None = None) -> tuple[Mechanism, Mechanism]:
    return tuple(chain_of(robot, model).mechanism for robot in other(name))  # type: ignore


@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_the_mechanism_is_the_same_in_other_readings(name, model) -> None:
    plain, driven = pair(name, model)
    drives, g = driven.drives, plain.parameters.nominal + 1e-4
    q = make_plan("identify", load_robot(name), count=12, both_sides=False).joint
    read = drives.read(q)
    np.testing.assert_allclose(driven.home, drives.read(plain.home), atol=SAME)
    x = plain.forward(q, g)
    np.testing.assert_allclose(driven.forward(read, g), x, atol=SAME)
    np.testing.assert_allclose(driven.start(read, g), plain.start(q, g), atol=SAME)
    np.testing.assert_allclose(
        driven.velocity_jacobian(read, x, g),
        plain.velocity_jacobian(q, x, g) * drives.sense,
        atol=SAME,
    )
    np.testing.assert_allclose(
        driven.closure_by_joints(read, x, g),
        plain.closure_by_joints(q, x, g) * drives.sense,
        atol=SAME,
    )
    np.testing.assert_allclose(
        driven.identification_jacobian(read, x, g),
        plain.identification_jacobian(q, x, g),
        atol=SAME,
    )
    task = x[:, : plain.task_size]
    np.testing.assert_allclose(
        driven.inverse(task, g, drives.read(q + 0.01)),
        drives.read(plain.inverse(task, g, q + 0.01)),
        atol=SAME,
    )


@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_torques_are_on_the_joint_as_the_drive_counts_it(name, model) -> None:
    plain, driven = pair(name, model)
    drives, g, masses = driven.drives, plain.parameters.nominal, load_robot(name).masses
    q = make_plan("identify", load_robot(name), count=12, both_sides=False).joint
    x, n = plain.forward(q, g), len(q)
    rate, more = np.full_like(q, 0.2), np.full_like(q, 0.5)
    rest = np.full(n, 1.5), np.zeros((n, 3))
    asked = OF_WEIGHT | OF_INERTIA
    known = plain.loads(masses, asked, q, x, g, rate, more, *rest)
    s = drives.sense
    found = driven.loads(masses, asked, drives.read(q), x, g, s * rate, s * more, *rest)
    np.testing.assert_allclose(found[0], known[0] * s, atol=1e-8)
    np.testing.assert_allclose(found[1], known[1] * s, atol=1e-8)
    np.testing.assert_allclose(found[2], known[2], atol=1e-6)


def as_read(at: Conditions, robot: Robot) -> Conditions:
    """The same conditions in the readings of a robot's drives."""
    drives = robot.drives
    return replace(
        at,
        joint=drives.read(at.joint),
        velocity=drives.sense * at.velocity,
        acceleration=drives.sense * at.acceleration,
        direction=drives.sense * at.direction,
    )


def same_effects(robot: Robot, model: str | None):
    """Effects that are described equally in any readings, with their values."""
    effects, values = [], []
    rng = np.random.default_rng(7)
    for effect in catalogue(robot, chain_of(robot, model).mechanism):
        value = 0.5 * effect.parameters.prior * rng.uniform(0.3, 0.9, len(effect.parameters))
        effect = effect.refined(value)
        if hasattr(effect, SENSOR):
            effect = replace(effect, sensor=effect.part)
            value = np.full(len(effect.parameters), 20e-6)
        known = effect.cause not in OF_READINGS and not effect.lacking
        live = known and machine(robot, model, [effect], [value]).live
        if live:
            effects.append(effect)
            values.append(value)
    return effects, values


@pytest.mark.parametrize(("name", "model"), MACHINES)
@pytest.mark.parametrize("burdened", [False, True])
def test_commands_are_compensated_alike(name, model, burdened) -> None:
    given = []
    for robot in other(name):
        effects, values = same_effects(robot, model) if burdened else ([], [])
        given.append(machine(robot, model, effects, values))
    plain, driven = given
    assert not burdened or len(plain.live) >= 4
    drives = driven.robot.drives
    q = commands(plain.robot, plain.chain.mechanism, 40, 0)
    parts = tuple(getattr(e, SENSOR, "") for e, _ in plain.live if getattr(e, SENSOR, ""))
    parts = tuple(dict.fromkeys(parts))
    at = moving(q, parts, plain.chain.mechanism.joint_size)
    told = as_read(at, driven.robot)
    known = JointCompensator(plain).compensate(q, at)
    found = JointCompensator(driven).compensate(told.joint, told)
    assert [v.value for v in found.verdicts] == [v.value for v in known.verdicts]
    assert sum(v.value == "corrected" for v in known.verdicts) > 20
    np.testing.assert_allclose(found.correction, drives.sense * known.correction, atol=SAME)


@needs_compiler
@pytest.mark.parametrize(("name", "model"), [("srbd", "six_rod_delta"), ("cdpr8", None)])
def test_exported_c_speaks_of_readings(name, model, tmp_path) -> None:
    robot = other(name)[1]
    calibration = machine(robot, model, *same_effects(robot, model))
    made = Compiled(calibration, tmp_path)
    q = robot.drives.read(commands(load_robot(name), calibration.chain.mechanism, 40, 0))
    at = moving(q, made.parts, calibration.chain.mechanism.joint_size)
    known = JointCompensator(calibration).compensate(q, at)
    out, _ = made.correct(q, at)
    assert np.abs(known.correction).max() > 1e-4
    np.testing.assert_allclose(out, known.joint, atol=SAME)


@pytest.fixture(scope="module")
def verdicts():
    """A session with backlash and a compliant joint, in the readings of both machines' drives."""
    trial = hide({"backlash": 1.0, "joint_compliance": 2.0}, 3, "still")
    found = []
    for robot, session in zip(
        other("srbd"), (trial.session, in_readings(trial.session, other("srbd")[1])), strict=True
    ):
        found.append((diagnose(survey(session, robot.joints.names), robot), session, robot))
    return found


def test_the_fit_is_the_same(verdicts) -> None:
    poses = [survey(session, robot.joints.names).poses for _, session, robot in verdicts]
    robots = [robot for *_, robot in verdicts]
    known, found = (identify(p, r) for p, r in zip(poses, robots, strict=True))
    np.testing.assert_allclose(found.theta, known.theta, atol=SAME)
    np.testing.assert_allclose(found.full.held_out, known.full.held_out, atol=SAME)


def test_the_verdict_is_the_same(verdicts) -> None:
    known, found = (diagnosis.verdict for diagnosis, *_ in verdicts)
    causes = [(f.cause, f.location) for f in known.findings]
    assert [(f.cause, f.location) for f in found.findings] == causes
    assert {"backlash", "joint_compliance"} & {cause for cause, _ in causes}
    for one, two in zip(found.findings, known.findings, strict=True):
        assert one.parameters.keys() == two.parameters.keys()
        for name, value in two.parameters.items():
            np.testing.assert_allclose(one.parameters[name].value, value.value, atol=SAME)
        np.testing.assert_allclose(one.gain, two.gain, atol=SAME)


def test_what_was_found_corrects_alike(verdicts) -> None:
    known, found = (
        JointCompensator(from_identification(d.identification, r, survey(s, r.joints.names).poses))
        for d, s, r in verdicts
    )
    drives = verdicts[1][2].drives
    q = make_plan("identify", verdicts[0][2], count=10, both_sides=False).joint
    expected = known.compensate(q)
    np.testing.assert_allclose(
        found.compensate(drives.read(q)).correction, drives.sense * expected.correction, atol=SAME
    )


@pytest.mark.parametrize("name", ["linear_delta", "cdpr8", "five_axis", "scara", "ur10"])
def test_plans_go_to_the_same_places(name) -> None:
    plain, driven = other(name)
    known, found = (make_plan("identify", robot, count=20) for robot in (plain, driven))
    np.testing.assert_allclose(found.joint, driven.drives.read(known.joint), atol=SAME)


def test_the_simulator_and_the_plans_speak_of_readings() -> None:
    plain, driven = other("srbd")
    plans = [make_plan("line", robot, count=5) for robot in (plain, driven)]
    np.testing.assert_allclose(plans[1].joint, driven.drives.read(plans[0].joint), atol=SAME)
    hidden = (("backlash", {"strength": "1"}), ("joint_compliance", {"strength": "2"}))
    made = [draw_machine(robot, 5, hidden=hidden) for robot in (plain, driven)]
    np.testing.assert_allclose(made[1].theta, made[0].theta, atol=SAME)
    at = moving(plans[0].joint, PARTS)
    seen = [
        one.readings(told, np.random.default_rng(2))
        for one, told in zip(made, (at, as_read(at, driven)), strict=True)
    ]
    still = made[0].readings(standing(plans[0].joint), np.random.default_rng(2))
    np.testing.assert_allclose(seen[1], seen[0], atol=SAME)
    assert np.abs(seen[0] - still).max() > 1e-4


@pytest.mark.parametrize("name", ["srbd", "linear_delta", "cdpr8", "five_axis", "ur10"])
def test_the_urdf_moves_by_readings(name) -> None:
    plain, driven = other(name)
    q = make_plan("identify", plain, count=3, both_sides=False).joint
    ends = []
    for robot, told in ((plain, q), (driven, driven.drives.read(q))):
        skeleton = describe(robot)
        values = skeleton.values(told)
        np.testing.assert_array_equal(values[robot.joints.names[0]], told[:, 0])
        ends.append(skeleton.tree.frames(values))
    for link, (rotation, place) in ends[0].items():
        np.testing.assert_allclose(ends[1][link][1], place, atol=SAME, err_msg=link)
        np.testing.assert_allclose(ends[1][link][0], rotation, atol=SAME, err_msg=link)
    assert "tool0" in ends[0]


def with_stands(azimuths) -> Robot:
    data = robot_document("srbd")[1]
    return robot_from({**data, "geometry": {**data["geometry"], "azimuths_deg": azimuths}}, "me")


@pytest.mark.parametrize("model", ["rotary_delta", "six_rod_delta"])
def test_legs_numbered_clockwise_are_the_same_machine(model) -> None:
    """Motors 2 and 3 have exchanged their names; nothing else has changed."""
    known, found = (
        chain_of(robot, model).mechanism
        for robot in (load_robot("srbd"), with_stands([0.0, 240.0, 120.0]))
    )
    swapped = np.array([0, 2, 1])
    q = make_plan("line", load_robot("srbd"), count=9).joint
    g = known.parameters.nominal + 1e-4 * np.sin(np.arange(len(known.parameters)))
    legs = g.reshape(3, -1)[swapped].ravel()
    x = known.forward(q, g)
    assert (x[:, 2] < -0.5).all()
    np.testing.assert_allclose(found.forward(q[:, swapped], legs), x, atol=SAME)
    task = x[:, :3]
    np.testing.assert_allclose(
        found.inverse(task, legs), known.inverse(task, g)[:, swapped], atol=SAME
    )


def test_a_machine_turned_about_z_is_turned() -> None:
    angle = np.radians(77.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    known, found = load_robot("srbd").commanded, with_stands([77.0, 197.0, -43.0]).commanded
    q = make_plan("line", load_robot("srbd"), count=9).joint
    g = known.parameters.nominal
    np.testing.assert_allclose(found.forward(q, g), known.forward(q, g) @ turn.T, atol=SAME)


def test_towers_may_be_numbered_clockwise() -> None:
    data = robot_document("linear_delta")[1]
    geometry = data["geometry"]
    first, second, third = geometry["angles_deg"]
    robot = robot_from(
        {**data, "geometry": {**geometry, "angles_deg": [first, third, second]}}, "me"
    )
    known, found = load_robot("linear_delta").commanded, robot.commanded
    q = known.home + 0.01 * np.array([[1.0, -2.0, 3.0], [0.0, 1.0, 2.0]])
    swapped = [0, 2, 1]
    np.testing.assert_allclose(
        found.forward(q[:, swapped], found.parameters.nominal),
        known.forward(q, known.parameters.nominal),
        atol=SAME,
    )


def test_the_middle_stays_where_the_drives_say_nothing() -> None:
    """Stating default values gives the same machine for a calibration; other values do not."""
    data = robot_document("srbd")[1]

    def told(**joints) -> Robot:
        return robot_from({**data, "joints": {**data["joints"], **joints}}, "me")

    plain = load_robot("srbd").machine_hash
    assert told(sign=[1, 1, 1], zero_deg=[0.0, 0, 0]).machine_hash == plain
    assert told(sign=[1, -1, 1]).machine_hash != plain
    assert told(zero_deg=[0.0, 0.0, 2.0]).machine_hash != plain
    assert with_stands([0.0, 120.0, 241.0]).machine_hash != plain


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("sign", [1, -1], r"joints\.sign: 2 values found, 3 are expected"),
        ("zero_deg", [1.0, 2.0, 3.0, 4.0], r"joints\.zero_deg: 4 values found, 3 are expected"),
        ("sign", [1, 0.5, 1], r"joints\.sign\[1\]: 0\.5 is not allowed; choose from: 1, -1"),
        ("zero_mm", [1.0, 2.0, 3.0], r"joints: unknown key zero_mm; allowed: .*zero_deg"),
    ],
)
def test_entries_that_are_none_are_refused(key, value, message) -> None:
    data = robot_document("srbd")[1]
    with pytest.raises(ConfigError, match=message):
        robot_from({**data, "joints": {**data["joints"], key: value}}, "cell.yaml")


def test_legs_in_one_place_are_refused() -> None:
    message = (
        r"geometry\.azimuths_deg: \[0, 120, 120\.5\] is not allowed; 3 legs at least 1 deg apart"
    )
    with pytest.raises(ConfigError, match=message):
        with_stands([0.0, 120.0, 120.5])


def test_limits_and_home_are_readings() -> None:
    data = other_document("srbd")
    joints = {**data["joints"], "lower_deg": [100.0, -65.0, 0.0], "upper_deg": [130.0, 90.0, 9.0]}
    with pytest.raises(ConfigError, match=r"joint_1 is at 90 degrees at home .* lower_deg 100"):
        robot_from({**data, "joints": joints}, "cell.yaml")


def test_points_are_asked_for_in_readings() -> None:
    plain, driven = other("srbd")
    points = np.array([[0.0, 0.0, -0.75], [0.1, -0.05, -0.8]])
    known = joints_toward(plain, points)
    np.testing.assert_allclose(joints_toward(driven, points), driven.drives.read(known), atol=SAME)


@pytest.mark.parametrize("method", ["apso", "newton", "table"])
@pytest.mark.parametrize("burdened", [False, True])
def test_every_way_of_compensating_answers_alike(method, burdened) -> None:
    found = []
    for robot in other("srbd"):
        effects, values = same_effects(robot, "rotary_delta")
        count = 2 if burdened else 0
        region = Region(np.array(list(np.ndindex(2, 2, 2))) * 0.04 + [-0.02, -0.02, -0.74])
        plain = [k for k, e in enumerate(effects) if e.stage is Stage.DRIVE][:count]
        given = [effects[k] for k in plain], [values[k] for k in plain]
        calibration = machine(robot, "rotary_delta", *given, region=region)
        q = joints_toward(robot, np.array([[0.0, 0.0, -0.72], [0.01, -0.01, -0.715]]))
        at = replace(at_rest(q), direction=robot.drives.sense * np.ones_like(q))
        compensator = JointCompensator(calibration, method, seed=3)
        found.append(compensator.compensate(q, replace(at, payload=np.ones(2))))
    known, answer = found
    sense = other("srbd")[1].drives.sense
    assert [v.value for v in answer.verdicts] == ["corrected"] * 2
    np.testing.assert_allclose(answer.correction, sense * known.correction, atol=SAME)
    assert np.abs(known.correction).max() > 1e-4


@pytest.mark.parametrize("burdened", [False, True])
def test_a_swarm_searches_alike(burdened) -> None:
    """Compared with itself: its result has the same error, in the drive's direction."""
    found = []
    for robot in other("srbd"):
        effects, values = same_effects(robot, "rotary_delta")
        kept = [k for k, e in enumerate(effects) if e.cause == "backlash"] if burdened else []
        calibration = machine(
            robot, "rotary_delta", [effects[k] for k in kept], [values[k] for k in kept]
        )
        made = IdentifiedMachine(calibration.chain, calibration.theta, robot.tool_offset)
        q = joints_toward(robot, np.array([[0.0, 0.0, -0.72], [0.1, -0.1, -0.8]]))
        target = made.stand(robot.drives.read(robot.drives.own(q) + 2e-4))[0]
        found.append(Swarm(made).correct(q, target).dq)
    sense = other("srbd")[1].drives.sense
    assert np.abs(found[0] - 2e-4).max() < 1e-6
    np.testing.assert_allclose(found[1], sense * found[0], atol=1e-12)
