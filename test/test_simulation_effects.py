"""Hidden effects in a simulated machine, compared with typical sizes and independent results.

The effect is the difference to the same seed without it, in a cell without noise. Jacobians of the
platform are those of `six_rods`, which shares no code.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from delta_calibration.effects import EFFECTS as EVERY
from delta_calibration.effects import catalogue
from delta_calibration.errors import InputError
from delta_calibration.estimation import chain_of
from delta_calibration.plans import legs, make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import (
    draw_machine,
    effect_options,
    hideable_causes,
    simulate_session,
    standing,
)
from delta_calibration.simulation.hidden import hide
from six_rods import SixRods

ROBOT, CABLES = load_robot("srbd"), load_robot("cdpr8")
EFFECTS = [effect.cause for effect in catalogue(ROBOT, ROBOT.model())]
RATE, PERIOD = 20.0, 120.0
GRAVITY = 9.80665


def without_noise(robot):
    return replace(
        robot,
        joints=replace(robot.joints, repeatability=0.0, encoder=0.0),
        tracker=replace(robot.tracker, radial=0.0, transverse=0.0, transverse_per_metre=0.0),
    )


QUIET = without_noise(ROBOT)


def both_payloads(plan):
    return replace(plan, payload=np.where(np.arange(len(plan)) // 2 % 2, 2.0, 0.0))


# 30 places across 560 mm, from both sides, in an hour; then a sweep and the fastest circles
STOPS = both_payloads(make_plan("disc", QUIET, count=15, dwell=0.3, radius=0.28))
PATHS = make_plan("rich", QUIET, count=1).paths
PLAN = replace(STOPS, paths=(PATHS[0], *PATHS[-2:]))
LEGS = list(legs(PLAN, QUIET, RATE))
RESTING = np.concatenate([leg.resting for leg in LEGS])
NUMBER = np.repeat(np.arange(len(LEGS)), [len(leg.time) for leg in LEGS])
CIRCLE = (len(LEGS) - 1 == NUMBER) & ~RESTING


def machine_with(*effects, seed=2, robot=QUIET, scatter=1.0):
    return draw_machine(robot, seed, scatter, [effect_options(text) for text in effects])


def measured(*effects, seed=2, plan=PLAN, **options):
    options = {"rate": RATE, "period": PERIOD} | options
    return simulate_session(machine_with(*effects, seed=seed), plan, seed, **options)


def moved_by(*effects, **options):
    """Displacement of all readings by the effects, (n, 3) [m]."""
    with_them, without = measured(*effects, **options), measured(**options)
    return with_them.tracker.position - without.tracker.position


def rms(distances):
    return np.sqrt(np.mean(np.sum(distances**2, axis=1)))


def by_name(machine):
    return dict(zip(machine.chain.parameters.names, machine.theta.tolist(), strict=True))


def values_of(machine):
    return {
        name.partition(".")[2]: value for name, value in by_name(machine).items() if "." in name
    }


def slopes(q):
    """d(platform)/dq of the nominal machine, (n, 3, 3) [m/rad]."""
    step = 1e-5
    columns = [
        (SixRods().point(q + step * e) - SixRods().point(q - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    return np.stack(columns, axis=-1)


# Root mean square at rest over a workspace of 560 mm [um], for the sizes that the effects expect
# (20 ppm, 0.2 mrad, 1 minute of arc, 25 kN m/rad, ...), from a linearised Delta of six rods; those
# that grow with time at half of their final size. Correct within a factor of 2.5.
AT_REST = {
    "tracker_scale": 60,
    "tracker_drift": 25,
    "encoder_eccentricity": 76,
    "transmission_error": 47,
    "joint_scale": 50,
    "backlash": 65,
    "joint_compliance": 53,
    "joint_zero_drift": 22,
    "stick_slip": 11,
    "thermal_growth_arm": 15,
    "thermal_growth_base": 4,
    "thermal_growth_forearm": 60,
    "forearm_compliance": 4,
    "base_compliance": 17,  # 7 kg on feet of 0.25 um/N, nearly the same everywhere
    "ball_joint_clearance": 40,  # twice its own size: a pair under opposite forces rotates
}
# On a circle at 0.5 m/s, 1.3 m/s^2.
IN_MOTION = {"timestamp_latency": 2500, "joint_lag": 2500, "dynamic_deflection": 20}


def test_every_effect_has_an_expected_size():
    assert {*AT_REST, *IN_MOTION} == set(EFFECTS)
    offered = hideable_causes(ROBOT, machine_with().chain)
    assert set(EFFECTS) | {"geometry", "smr_offset", "arm_length"} < set(offered)


@pytest.mark.parametrize("cause", EFFECTS)
def test_every_effect_moves_the_readings_by_its_usual_size(cause):
    moved = moved_by(cause)
    if cause in AT_REST:
        assert 0.4 < rms(moved[RESTING]) / (1e-6 * AT_REST[cause]) < 2.5
    else:
        # With loads the pose is solved once more, which may change the last bit of a reading.
        np.testing.assert_allclose(moved[RESTING], 0.0, atol=1e-15)
        assert 0.4 < rms(moved[CIRCLE]) / (1e-6 * IN_MOTION[cause]) < 2.5
    assert rms(moved_by(f"{cause}:strength=0.1")) == pytest.approx(0.1 * rms(moved), rel=0.03)


@pytest.mark.parametrize("name", known_robots())
def test_what_a_machine_cannot_have_is_refused_in_words(name):
    robot = load_robot(name)
    chain = chain_of(robot)
    suited = {e.cause for e in catalogue(robot, chain.mechanism) if not e.lacking}
    for cause in EVERY:
        if cause in suited:
            assert len(hide(robot, chain, {cause: {}}, 1).effects) == 1
        else:
            with pytest.raises(InputError, match=f"effect {cause}: [^:]+"):
                hide(robot, chain, {cause: {}}, 1)


def encoders(name, **stated):
    robot = load_robot(name)
    return replace(robot, joints=replace(robot.joints, **stated))


@pytest.mark.parametrize(
    ("robot", "cause", "why"),
    [
        (ROBOT, "encoder_interpolation", "the robot file does not state joints.encoder_lines;"),
        (
            encoders("linear_delta", encoder_lines=2 * np.pi * 1e6),
            "encoder_interpolation",
            "joints.encoder_periods_per_m: the periods are too short .*; at most [0-9.]+ can",
        ),
        (load_robot("scara"), "gravity_sag", "all its axes are vertical and carry no weight"),
        (
            replace(CABLES, dimensions=replace(CABLES.dimensions, pretension=0.0)),
            "pretension_loss",
            "geometry.pretension_n is 0",
        ),
    ],
)
def test_it_is_said_what_a_machine_lacks(robot, cause, why):
    with pytest.raises(InputError, match=f"effect {cause}: .*{why}"):
        hide(robot, chain_of(robot), {cause: {}}, 1)


def test_the_most_periods_that_are_told_can_be_seen():
    few = encoders("linear_delta", encoder_lines=2 * np.pi * 1e6)
    with pytest.raises(InputError, match="at most") as refused:
        hide(few, chain_of(few), {"encoder_interpolation": {}}, 1)
    most = float(str(refused.value).split("at most ")[1].split()[0])
    seen = encoders("linear_delta", encoder_lines=0.999 * 2 * np.pi * most)
    assert hide(seen, chain_of(seen), {"encoder_interpolation": {}}, 1).effects


def test_a_scale_is_a_share_of_every_reading():
    plain = measured().tracker.position
    np.testing.assert_allclose(moved_by("tracker_scale:value=3e-5"), 3e-5 * plain, atol=1e-15)


def test_latency_is_the_way_of_a_moment_back():
    """Compared with the readings of that moment."""
    plain = measured().tracker
    time = (plain.stamp_ns - plain.stamp_ns[0]) * 1e-9
    course = CubicSpline(time[CIRCLE], plain.position[CIRCLE])
    back = (course(time[CIRCLE] - 0.008) - course(time[CIRCLE]))[5:-5]
    assert np.linalg.norm(back, axis=1).max() > 0.003
    moved = moved_by("timestamp_latency:value=0.008")
    np.testing.assert_allclose(moved[CIRCLE][5:-5], back, rtol=0.002, atol=1.6e-5)
    assert not moved[RESTING].any()


@pytest.mark.parametrize("rate", [2.0, 7.0])
def test_a_slow_recording_is_of_the_same_motion(rate):
    moved, plain = moved_by("timestamp_latency:value=0.01", rate=rate), measured(rate=rate)
    on_path = plain.tracker.stamp_ns > plain.payload.stamp_ns[-1]
    assert np.linalg.norm(moved[on_path], axis=1).max() > 0.004


def test_backlash_parts_the_two_sides_by_the_gap():
    """Coming from below, a joint stays half a gap below; the gap is crossed on the way."""
    gap = 4e-4
    effect = f"backlash:location=joint_2,value={gap}"
    machine = machine_with(effect, scatter=0.0)
    session = simulate_session(machine, STOPS, 2, RATE)
    frame = machine.chain.split(machine.theta)[2]
    point = frame.inverse().apply(session.tracker.position)
    ends = np.cumsum([len(leg.time) for leg in LEGS[: len(STOPS)]]) - 1
    above, below = point[ends][STOPS.direction < 0], point[ends][STOPS.direction > 0]
    want = gap * slopes(STOPS.joint[STOPS.direction > 0])[:, :, 1]
    assert np.abs(want).max() > 5e-5
    np.testing.assert_allclose(above - below, want, atol=1e-7)


@pytest.mark.parametrize("cause", ["backlash", "stick_slip", "joint_lag", "timestamp_latency"])
def test_what_was_there_at_rest_is_carried_from_leg_to_leg(cause):
    """If the command does not change between two legs, the readings do not change either."""
    session = measured(cause)
    command, point = session.command.position, session.tracker.position
    begins = np.flatnonzero(np.diff(NUMBER)) + 1
    held = begins[(command[begins] == command[begins - 1]).all(axis=1)]
    assert len(held) > 25
    np.testing.assert_allclose(point[held], point[held - 1], atol=1e-12)


def test_a_drive_sags_under_its_payload():
    """By virtual work: torque = m g dz/dq, twist = torque / k."""
    compliance = 6e-5
    loads = []
    for mass in (0.0, 2.0):
        plan = replace(STOPS, payload=np.full(len(STOPS), mass))
        machine = machine_with(f"joint_compliance:value={compliance}", scatter=0.0)
        loads.append(simulate_session(machine, plan, 2, RATE).tracker.position)
    back = machine.chain.split(machine.theta)[2].rotation.T
    ends = np.cumsum([len(leg.time) for leg in LEGS[: len(STOPS)]]) - 1
    sag = (loads[1] - loads[0])[ends] @ back.T
    slope = slopes(STOPS.joint)
    twist = -compliance * 2.0 * GRAVITY * slope[:, 2]
    np.testing.assert_allclose(sag, (slope @ twist[..., None])[..., 0], rtol=0, atol=5e-8)
    assert sag[:, 2].max() < -1e-5


def test_one_arm_can_grow_alone():
    machine = machine_with(
        "thermal_growth_arm:alike=0,location=joint_2,value=2e-4,time_constant=1", scatter=0.0
    )
    session = simulate_session(machine, STOPS, 2, RATE, PERIOD)
    frame = machine.chain.split(machine.theta)[2]
    want = frame.apply(SixRods({"arm_2": 0.32 * 2e-4}).point(STOPS.joint[-1:]))
    end = np.flatnonzero(len(STOPS) - 1 == NUMBER)[-1]
    np.testing.assert_allclose(session.tracker.position[end], want[0], atol=1e-8)
    with pytest.raises(InputError, match="alike 0 is not allowed; 1"):
        machine_with("thermal_growth_base:alike=0,time_constant=600")


def test_arms_grow_with_the_temperature_that_is_recorded():
    """Compared with a machine whose arms have the length at that temperature."""
    expansion = 23e-6
    machine = machine_with(f"thermal_growth_arm:value={expansion}", scatter=0.0)
    session = simulate_session(machine, STOPS, 2, RATE, PERIOD)
    arm = next(part for part in session.temperature if part.part == "arm")
    assert arm.celsius[0] == 20.0
    assert arm.celsius[40] == pytest.approx(20 + 13 * (1 - np.exp(-1)), abs=0.01)
    end = np.flatnonzero(len(STOPS) - 1 == NUMBER)[-1]
    warm = np.interp(session.tracker.stamp_ns[end], arm.stamp_ns, arm.celsius) - 20.0
    assert warm > 9.0
    longer = {f"arm_{leg}": 0.32 * expansion * warm for leg in (1, 2, 3)}
    frame = machine.chain.split(machine.theta)[2]
    want = frame.apply(SixRods(longer).point(STOPS.joint[-1:]))
    np.testing.assert_allclose(session.tracker.position[end], want[0], atol=1e-8)


def test_effects_add():
    one, other = "joint_compliance", "transmission_error"
    both = moved_by(one, other)
    assert rms(both) > 5e-5
    # to first order: the former is up to 3 mm, and the latter rotates it by 0.15 mrad
    np.testing.assert_allclose(both, moved_by(one) + moved_by(other), atol=5e-7)
    with_dimension = moved_by(one, "arm_length:location=joint_3")
    apart = moved_by(one) + moved_by("arm_length:location=joint_3")
    np.testing.assert_allclose(with_dimension, apart, atol=6e-6)


def test_a_cause_given_twice_is_in_both_places():
    gaps = ("backlash:location=joint_1,value=3e-4", "backlash:location=joint_3,value=1e-4")
    machine = machine_with(*gaps)
    assert values_of(machine) == {"gap_1": 3e-4, "gap_2": 0.0, "gap_3": 1e-4}
    assert machine.chain.effects[0].width == (3e-4, 0.0, 1e-4)  # backlash is crossed over its gap
    with pytest.raises(InputError, match="growth_arm is given twice, with different settings"):
        machine_with("thermal_growth_arm:time_constant=600", "thermal_growth_arm:time_constant=9")
    geared = machine_with("transmission_error:cycles=33", "transmission_error:cycles=50")
    assert [effect.cycles for effect in geared.chain.effects] == [33.0, 50.0]
    arms = machine_with("arm_length:location=joint_1", "arm_length:location=joint_2", scatter=0.0)
    values = by_name(arms)
    assert [values[f"arm_{leg}"] - 0.32 for leg in (1, 2, 3)] == pytest.approx([45e-5, 45e-5, 0])


def test_a_value_is_taken_as_it_is():
    scale = {f"scale_{leg}": -1e-4 for leg in (1, 2, 3)}
    assert values_of(machine_with("joint_scale:value=-1e-4")) == scale
    assert values_of(machine_with("thermal_growth_base:value=2e-5")) == {"expansion": 2e-5}
    wave = values_of(machine_with("encoder_eccentricity:location=joint_2,value=3e-4"))
    assert np.hypot(wave["sine_2"], wave["cosine_2"]) == pytest.approx(3e-4)
    assert wave["sine_1"] == wave["cosine_3"] == 0.0
    drift = values_of(machine_with("tracker_drift:value=9e-5"))
    shift, turn = (np.linalg.norm([drift[f"{k}_{a}"] for a in "xyz"]) for k in ("shift", "turn"))
    assert (shift, turn) == (pytest.approx(9e-5), pytest.approx(3e-5))  # 10 urad belong to 30 um
    offset = machine_with("smr_offset:value=0.02", scatter=0.0)
    place = offset.chain.split(offset.theta)[1] - machine_with(scatter=0.0).chain.offset
    assert np.linalg.norm(place) == pytest.approx(0.02)


def test_a_strength_is_in_typical_sizes_with_shares_signs_and_phases_drawn():
    draws = [values_of(machine_with("joint_scale:strength=2", seed=seed)) for seed in range(40)]
    sizes = np.array([list(draw.values()) for draw in draws]) / (2 * 200e-6)
    assert 0.7 <= np.abs(sizes).min() < 0.75
    assert 1.25 < np.abs(sizes).max() <= 1.3
    assert 0.3 < np.mean(sizes > 0) < 0.7
    gaps = [values_of(machine_with("backlash", seed=seed)).values() for seed in range(40)]
    assert min(min(each) for each in gaps) >= 0.7 * 0.3e-3  # no gap is negative
    growth = [values_of(machine_with("thermal_growth_forearm", seed=s)) for s in range(20)]
    assert {g["growth"] for g in growth} == {150e-6}  # and thermal growth is not negative
    waves = [values_of(machine_with("transmission_error", seed=seed)) for seed in range(40)]
    phase = np.array([np.arctan2(w["cosine_1"], w["sine_1"]) for w in waves])
    assert np.abs(np.exp(1j * phase).mean()) < 0.4
    scales = [values_of(machine_with("tracker_scale", seed=s))["scale"] for s in range(9)]
    assert set(np.sign(scales)) == {-1.0, 1.0}


def test_an_effect_leaves_the_rest_of_the_machine_and_the_draws_of_others():
    plain = machine_with()
    one, two = "transmission_error", "joint_lag"
    alone, second = machine_with(one), machine_with(two, one)
    size = len(plain.theta)
    for machine in (alone, second):
        np.testing.assert_array_equal(machine.theta[:size], plain.theta)
    assert values_of(alone).items() < values_of(second).items()
    there = values_of(machine_with(f"{one}:location=joint_2"))
    assert there["sine_2"] == values_of(alone)["sine_2"] != 0.0
    assert there["sine_1"] == 0.0


def test_the_seed_decides_effects():
    for cause in EFFECTS:
        np.testing.assert_array_equal(machine_with(cause).theta, machine_with(cause).theta)
    other = machine_with("transmission_error", seed=3)
    assert values_of(other) != values_of(machine_with("transmission_error"))
    once, again = measured("backlash", "tracker_drift"), measured("backlash", "tracker_drift")
    np.testing.assert_array_equal(once.tracker.position, again.tracker.position)


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        ("transmission_error", {"cycles": 33.0, "second": 0.0}),
        ("transmission_error:cycles=66,second=2", {"cycles": 66.0, "second": 2.0}),
        ("transmission_error:second=2", {"cycles": 33.0, "second": 2.0}),
        ("thermal_growth_arm:alike=0,location=joint_2", {"sensor": "arm", "alike": 0.0}),
        ("thermal_growth_arm", {"sensor": "arm", "time_constant": 0.0}),
        ("thermal_growth_base", {"sensor": "base", "time_constant": 0.0}),
        ("thermal_growth_forearm", {"sensor": "", "time_constant": 2400.0}),
        ("thermal_growth_forearm:sensor=arm", {"sensor": "arm", "time_constant": 0.0}),
        ("thermal_growth_arm:time_constant=900", {"sensor": "", "time_constant": 900.0}),
        ("tracker_drift", {"time_constant": 2400.0, "step_at": -1.0}),
        ("tracker_drift:time_constant=0", {"time_constant": 0.0, "step_at": -1.0}),
        ("joint_zero_drift", {"time_constant": 0.0, "step_at": -1.0}),
        ("joint_zero_drift:step_at=1800", {"time_constant": 0.0, "step_at": 1800.0}),
        (
            "joint_zero_drift:period=3000,phase=0.2",
            {"period": 3000.0, "phase": 0.2, "step_at": -1.0},
        ),
        ("stick_slip:speed=0.03", {"speed": 0.03, "level": 0.0, "stopped": 1.0}),
        ("stick_slip:level=0.4", {"speed": 0.1, "level": 0.4, "stopped": 1.0}),
        ("ball_joint_clearance:force=0.5", {"force": 0.5, "end": 0.0}),
    ],
)
def test_shapes_are_as_said_or_as_a_cell_has_them(text, settings):
    found = machine_with(text).chain.effects[0].settings
    assert {name: found[name] for name in settings} == settings
    assert not any(found[name] for name in found.keys() - settings.keys() - {"alike"})


def test_a_step_is_at_its_moment():
    moved = moved_by("joint_zero_drift:step_at=1800,value=1e-4")
    time = measured().tracker.stamp_ns - measured().tracker.stamp_ns[0]
    later = time >= 1800e9
    assert not moved[~later].any()
    assert np.linalg.norm(moved[later], axis=1).min() > 1e-5


def test_only_a_cell_that_is_asked_to_or_grows_warms_up():
    def ends(session):
        return [float(part.celsius[-1]) for part in session.temperature]

    assert ends(measured("backlash")) == [20.0, 20.0]
    arm, base = ends(measured(warming=True))
    assert 28.0 < arm < 33.0
    assert base - 20 == pytest.approx((arm - 20) / 3, rel=0.2)
    assert ends(measured("thermal_growth_forearm")) == [arm, base]
    np.testing.assert_array_equal(  # a machine without growth does not depend on it
        measured(warming=True).tracker.position, measured().tracker.position
    )


def test_the_tool_stands_where_drives_and_structure_bring_it():
    """Independent of effects on the readings of the tracker."""
    at = standing(STOPS.joint)
    plain, seen = machine_with(), machine_with("tracker_scale", "timestamp_latency")
    np.testing.assert_array_equal(seen.tool_points(at), plain.tool_points(at))
    np.testing.assert_array_equal(seen.reflector_points(at), plain.reflector_points(at))
    sagging = machine_with("joint_compliance:value=4e-5")
    loaded = standing(STOPS.joint, payload=2.0)
    drop = sagging.tool_points(loaded) - sagging.tool_points(at)
    assert drop[:, 2].max() < -1e-5
    np.testing.assert_array_equal(plain.tool_points(loaded), plain.tool_points(at))
    noiseless = plain.readings(at, np.random.default_rng(0))
    np.testing.assert_allclose(plain.reflector_points(at), noiseless, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("backlash:gap=1", "effect backlash: unknown option gap; allowed: location, value, stren"),
        ("backlash:width=1", "unknown option width; allowed: location, value, strength, held_by$"),
        ("tracker_scale:gap=1", "unknown option gap; allowed: value, strength$"),
        ("tracker_scale:location=joint_1", "unknown option location; allowed: value, strength$"),
        (
            "transmission_error:cycle=3",
            "cycle; allowed: location, value, strength, cycles, second$",
        ),
        ("backlash:location=joint_4", "no location 'joint_4'; allowed: joint_1, joint_2, joint_3"),
        ("joint_lag:value=5ms", r"joint_lag: value '5ms' is not a finite number \(SI: s\)"),
        ("joint_lag:strength=inf", "joint_lag: strength 'inf' is not a finite number"),
        ("joint_lag:value=1,strength=2", "only one of value, strength can be given"),
        ("backlash:value=-1e-4", r"gap_1 = -0.0001 rad is not possible; allowed: 0 to 0.05"),
        ("joint_scale:value=1", r"scale_\d = 1 is not possible"),
        ("backlash:strength=1000", r"gap_\d = \S+ rad is not possible; allowed: 0 to 0.05"),
        ("transmission_error:cycles=0", "cycles 0 is not allowed; more than 0"),
        ("transmission_error:cycles=many", "cycles 'many' is not a finite number$"),
        ("stick_slip:speed=-1", "speed -1 is not allowed; more than 0"),
        ("tracker_drift:step_at=-5", "step_at -5 is not allowed; 0 or more"),
        ("ball_joint_clearance:end=-2", "end -2 is not allowed; -1 or more"),
        ("thermal_growth_arm:sensor=forearm", "no sensor 'forearm'; allowed: arm, base"),
        ("thermal_growth_arm:sensor=arm,time_constant=9", "only one of sensor, time_constant can"),
        ("tracker_drift:step_at=5,time_constant=9", "only one of step_at, time_constant can"),
        ("geometry:value=1", "unknown option value; allowed: location, strength"),
        ("smr_offset:location=joint_1", "smr_offset at joint_1 cannot be hidden"),
        ("arm_length:value=1,strength=1", "only one of value, strength can be given"),
        ("backlash:value", "effect backlash:value: 'value' is not of the form key=value"),
        ("backlash:value=1,value=2", "value is given twice"),
        ("arm_length:value=-0.4", r"cannot be built: arm_1 is -0.0\d+ m; it has to be above 0"),
        ("forearm_length:value=-0.5", "cannot be built: a six_rod_delta of .* no pose at home"),
        (
            "arm_length:value=11",
            "arm_1 is 11.3.* m; at most 10 from its drawing, 0.32 m, is allow",
        ),
        (
            "joint_zero_offset:value=4",
            "joint_zero_1 is 4.* rad; at most 3.142 from its drawing, 0",
        ),
        ("smr_offset:value=1e5", "the reflector is 100000 m away; at most 10 m is allowed"),
    ],
)
def test_wrong_options_are_refused_with_what_is_allowed(text, message):
    with pytest.raises(InputError, match=message) as caught:
        machine_with(text)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("name", ["linear_delta", "five_axis", "cdpr8", "srbd"])
def test_a_joint_is_called_by_its_name_in_the_robot_file(name):
    """The third joint by its own name, and by joint_3 (cable_3) as in a verdict."""
    robot = load_robot(name)
    own, place = robot.joints.names[2], f"{robot.commanded.limb}_3"
    machines = [
        draw_machine(robot, 1, 1.0, [effect_options(f"backlash:location={where}")])
        for where in (own, place)
    ]
    one, other = (m.theta for m in machines)
    np.testing.assert_array_equal(one, other)
    effects = one[-len(robot.joints.names) :]
    assert np.flatnonzero(effects).tolist() == [2]
    assert robot.place(own) == place
    assert robot.named(f"geometry + backlash at {place}") == f"geometry + backlash at {own}"
    assert robot.named("joint_zero_2, joint_99, ajoint_1") == "joint_zero_2, joint_99, ajoint_1"
    listed = ", ".join(robot.joints.names)
    with pytest.raises(InputError, match=f"no location 'joint_9'; allowed: {listed}"):
        draw_machine(robot, 1, 1.0, [effect_options("backlash:location=joint_9")])


@pytest.mark.parametrize(("name", "unit"), [("linear_delta", "m"), ("srbd", "rad")])
def test_sizes_are_asked_for_in_the_joints_unit(name, unit):
    robot = load_robot(name)
    for cause in ("joint_zero_offset", "backlash"):
        with pytest.raises(InputError, match=rf"'3mm' is not a finite number \(SI: {unit}\)"):
            draw_machine(robot, 1, 1.0, [effect_options(f"{cause}:value=3mm")])
