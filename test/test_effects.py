"""Tests of the rules for every effect of the catalogue; effects are found by registration."""

from __future__ import annotations

import json
import pickle
from copy import copy, deepcopy
from dataclasses import FrozenInstanceError, fields, replace
from itertools import pairwise

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import EFFECTS, Effect, Stage, catalogue, effect_named
from delta_calibration.effects.unexplained import UNEXPLAINED, Unexplained, families
from delta_calibration.errors import InputError
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
MODELS = ("rotary_delta", "six_rod_delta")
# Causes of a Delta by their fixed names in verdicts; geometry belongs to the mechanism.
KINDS = {
    "measurement": {"tracker_scale", "tracker_drift", "timestamp_latency"},
    "drive": {
        "encoder_eccentricity",
        "transmission_error",
        "joint_scale",
        "backlash",
        "joint_compliance",
        "joint_lag",
        "joint_zero_drift",
        "stick_slip",
    },
    "structure": {
        "thermal_growth_arm",
        "thermal_growth_base",
        "thermal_growth_forearm",
        "forearm_compliance",
        "dynamic_deflection",
        "base_compliance",
        "ball_joint_clearance",
    },
    "geometry": {
        "joint_zero_offset",
        "arm_length",
        "forearm_length",
        "base_joint_position",
        "base_joint_tilt",
        "parallelogram_mismatch",
    },
}
UNITS = {"1", "m", "s", "rad", "1/K", "m/N", "rad/N", "rad/(N m)"}
ALL = [(model, e.cause) for model in MODELS for e in catalogue(ROBOT, ROBOT.model(model))]
each_effect = pytest.mark.parametrize(("model", "cause"), ALL)


def conditions(n: int = 60, seed: int = 1) -> Conditions:
    """Half of the samples are at rest, half move; all conditions are known, no two are alike."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.1, 0.7, (n, 3))
    moving = (np.arange(n) % 2)[:, None]
    return replace(
        at_rest(q),
        time=np.sort(rng.uniform(0.0, 7200.0, n)),
        velocity=moving * rng.uniform(-1.0, 1.0, (n, 3)),
        acceleration=moving * rng.uniform(-5.0, 5.0, (n, 3)),
        direction=rng.choice([-1.0, 1.0], (n, 3)),
        travel=rng.uniform(0.0, 0.5, (n, 3)),
        payload=rng.choice([0.0, 2.0], n),
        payload_centre=rng.uniform(-0.03, 0.03, (n, 3)),
        temperature_parts=("arm", "base"),
        temperature=rng.uniform(18.0, 32.0, (n, 2)),
        reading=rng.uniform([2.0, -1.0, -1.0], [4.0, 1.0, 1.0], (n, 3)),
        reading_velocity=moving * rng.uniform(-0.5, 0.5, (n, 3)),
        reading_acceleration=moving * rng.uniform(-5.0, 5.0, (n, 3)),
    )


AT = conditions()
N = len(AT)


def built(model: str, cause: str) -> Effect:
    return EFFECTS[cause](ROBOT, ROBOT.model(model))


def unexplained(family: str) -> Unexplained:
    return Unexplained.over(built(MODELS[0], "backlash"), family, AT.joint)


def every_shape(effect: Effect, at: Conditions = AT) -> list[Effect]:
    return [effect, *effect.shapes(at)]


def size_of(effect: Effect) -> tuple[int, int, int]:
    return N, effect.stage_size, len(effect.parameters)


def test_every_cause_of_a_delta_is_an_effect_or_a_dimension_of_its_kind() -> None:
    every = Chain(ROBOT.model(), np.zeros(3), 0.05, catalogue(ROBOT, ROBOT.model())).parameters
    others = {"smr_offset", "tracker_frame"}  # the second is never reported
    assert {p.cause for p in every} == set.union(others, *KINDS.values())
    assert {p.cause for p in ROBOT.model().parameters} == KINDS["geometry"]
    for effect in catalogue(ROBOT, ROBOT.model()):
        assert EFFECTS[effect.cause] is type(effect)
        assert effect.cause in KINDS[effect.kind]
        assert (effect.stage is Stage.MEASUREMENT) == (effect.kind == "measurement")


@each_effect
def test_parameters_are_of_a_machine(model: str, cause: str) -> None:
    for effect in every_shape(built(model, cause)):
        items = effect.parameters.items
        assert {p.unit for p in items} <= UNITS
        assert {p.cause for p in items} == {cause}
        for p in items:  # zero by default; a typical size is well within the limits
            assert p.nominal == 0.0
            assert p.lower <= 0.0 < 2.5 * p.prior <= p.upper < np.inf
            assert p.lower > -np.inf
        places = {p.location for p in items}
        assert places in ({None}, {"joint_1", "joint_2", "joint_3"})
        for place in places - {None}:
            own = [p for p in items if p.location == place]
            assert len(own) == len(items) / 3
            assert all(p.name.endswith(place[-2:]) for p in own)


@each_effect
def test_columns_have_the_size_of_their_stage_and_are_finite(model: str, cause: str) -> None:
    for effect in every_shape(built(model, cause)):
        columns = effect.columns(AT)
        assert columns.shape == size_of(effect)
        assert np.isfinite(columns).all()
        np.testing.assert_array_equal(effect.columns(replace(AT)), columns)


@each_effect
def test_each_parameter_moves_something_of_its_own(model: str, cause: str) -> None:
    effect = next(iter(built(model, cause).shapes(AT)))
    flat = effect.columns(AT).reshape(-1, len(effect.parameters))
    values = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), compute_uv=False)
    assert values[-1] > 1e-3
    for column, p in enumerate(effect.parameters):
        if p.location is not None:
            others = [j for j in range(3) if f"joint_{j + 1}" != p.location]
            assert not effect.columns(AT)[:, others, column].any(), p.name


@each_effect
def test_samples_do_not_know_of_each_other(model: str, cause: str) -> None:
    """The same in another order, and each alone."""
    effect, order = built(model, cause), np.random.default_rng(3).permutation(N)
    for rows in (order, order[:1]):
        part, whole = effect.columns(AT.take(rows)), effect.columns(AT)
        np.testing.assert_allclose(part, whole[rows], rtol=1e-9, atol=1e-12)


NOWHERE, ONCE = np.full((N, 3), np.nan), np.where(np.arange(N) == 7, np.nan, 1.0)
UNKNOWN = {
    "payload": dict(payload=np.full(N, np.nan), payload_centre=NOWHERE),
    "one payload": dict(payload=ONCE),
    "centre": dict(payload_centre=NOWHERE),
    "temperature": dict(temperature=np.full((N, 2), np.nan)),
    "one temperature": dict(temperature=ONCE[:, None] * np.full(2, 20.0)),
    "sensors": dict(temperature_parts=(), temperature=np.zeros((N, 0))),
    "direction": dict(direction=np.zeros((N, 3)), travel=np.full((N, 3), np.inf)),
}


@each_effect
def test_what_is_not_known_is_said_or_does_not_matter(model: str, cause: str) -> None:
    """An effect that can be evaluated never returns a value that is not a number."""
    silent = []
    for lost, fields_lost in UNKNOWN.items():
        at = replace(AT, **fields_lost)
        for effect in every_shape(built(model, cause)):
            assert not effect.missing(AT)
            if not effect.missing(at) and not np.isfinite(effect.columns(at)).all():
                silent.append((lost, effect.settings))
    assert not silent


@each_effect
def test_what_is_missing_is_named(model: str, cause: str) -> None:
    effect = built(model, cause)
    for lost, need, name in (
        ("one payload", "payload", "the payload"),
        ("direction", "direction", "the direction of the last motion"),
    ):
        said = f"{name} is not known" if need in effect.needs else ""
        assert effect.missing(replace(AT, **UNKNOWN[lost])) == said
    for lost in ("sensors", "temperature", "one temperature") * ("temperature" in effect.needs):
        at = replace(AT, **UNKNOWN[lost])
        said = replace(effect, sensor="arm").missing(at)
        assert said == "the temperature of part 'arm' is not known"
        assert not effect.missing(at)  # continues by time


@each_effect
def test_a_shape_comes_back_from_its_settings(model: str, cause: str) -> None:
    """As stored in a file: numbers, texts, lists."""
    effect = built(model, cause)
    own = [f.name for f in fields(effect) if f.name not in ("robot", "mechanism")]
    for shape in (*every_shape(effect), effect.refined(np.full(len(effect.parameters), 2e-4))):
        assert list(shape.settings) == own
        text = json.dumps(shape.settings, allow_nan=False)
        again = effect_named(cause, ROBOT, effect.mechanism, json.loads(text))
        assert type(again) is type(shape)
        assert again.settings == shape.settings
        assert again.parameters == shape.parameters
        np.testing.assert_array_equal(again.columns(AT), shape.columns(AT))


@pytest.mark.parametrize("family", list(families(AT)))
def test_a_map_keeps_to_it_as_well(family: str) -> None:
    effect = unexplained(family)
    assert effect.columns(AT).shape == size_of(effect)
    settings = json.loads(json.dumps(effect.settings))
    again = effect_named(UNEXPLAINED, ROBOT, effect.mechanism, settings)
    assert again.parameters == effect.parameters
    np.testing.assert_array_equal(again.columns(AT), effect.columns(AT))
    for lost in UNKNOWN.values():
        at = replace(AT, **lost)
        assert effect.missing(at) or np.isfinite(effect.columns(at)).all()
    assert effect.bound_to_session == (family == "time")
    always = ("position", "joint angle", "time")
    assert (family in families(at_rest(AT.joint))) == (family in always)


COURSE = {"time_constant", "period", "phase"}
SEARCHED = {
    **{drift: {"step_at"} | COURSE for drift in ("tracker_drift", "joint_zero_drift")},
    **{f"thermal_growth_{part}": COURSE for part in ("arm", "base", "forearm")},
    "transmission_error": {"cycles"},
    "stick_slip": {"speed", "level", "stopped"},
    "ball_joint_clearance": {"force"},
    "backlash": {"held_by"},
    "base_compliance": {"depth", "radius"},
}


@each_effect
def test_a_searched_shape_lies_within_its_interval_and_can_be(model: str, cause: str) -> None:
    """Also at its ends and for any gear ratio; the finer search relies on it."""
    direct = replace(ROBOT, joints=replace(ROBOT.joints, gear_ratio=1.0))
    cold, names = replace(AT, **UNKNOWN["sensors"]), set()
    both = [EFFECTS[cause](robot, ROBOT.model(model)) for robot in (ROBOT, direct)]
    shapes = [shape for effect in both for shape in effect.shapes(cold)]
    for shape, (name, low, high) in ((s, i) for s in shapes for i in s.intervals()):
        names.add(name)
        assert low < shape.settings[name] < high
        assert low >= 0.0, "a frequency, a time, a speed below nothing"
        for end in (low, high):
            moved = replace(shape, **{name: end})
            assert moved.parameters == shape.parameters
            assert np.isfinite(moved.columns(cold)).all()
    assert names == SEARCHED.get(cause, set())


@pytest.mark.parametrize("cause", SEARCHED)
def test_a_search_leaves_no_gap(cause: str) -> None:
    """Every shape between two neighbours lies in the interval of one of them."""
    spans: dict[str, list[tuple[float, float]]] = {}
    for shape in built(MODELS[0], cause).shapes(replace(AT, **UNKNOWN["sensors"])):
        for name, *span in shape.intervals():
            spans.setdefault(name, []).append(tuple(span))
    for name in set(spans) - {"step_at"}:
        for (_, end), (begin, _) in pairwise(sorted(spans[name])[1:]):
            assert begin <= end


def test_loads_that_may_close_a_gap_are_those_of_the_session() -> None:
    """From a friction below every torque on; none without masses, payload or a known centre."""
    effect = catalogue(ROBOT, ROBOT.model())
    plain = next(e for e in effect if e.cause == "backlash")
    never, *held = plain.shapes(AT)
    torque = np.abs(plain._load(AT))
    assert never.held_by == 0.0
    assert len({shape.held_by for shape in held}) == len(held) > 10
    assert 0 < held[0].held_by < torque[torque > 1e-6].min()
    assert held[-1].held_by < torque.max()
    unloaded = replace(ROBOT, masses=None)
    assert len(list(replace(plain, robot=unloaded).shapes(AT))) == 1
    for lost in ("payload", "payload_centre"):
        unknown = replace(AT, **{lost: np.full_like(getattr(AT, lost), np.nan)})
        assert len(list(plain.shapes(unknown))) == 1
    arm = load_robot("scara")
    other = next(e for e in catalogue(arm, arm.model()) if e.cause == "backlash")
    assert len(list(other.shapes(at_rest(np.zeros((3, arm.model().joints)))))) == 1


@each_effect
def test_a_shape_goes_no_further_than_a_file_may_hold(model: str, cause: str) -> None:
    """However often a search continues from the end of one interval into the next."""
    for shape in built(model, cause).shapes(replace(AT, **UNKNOWN["sensors"])):
        assert shape.wrong() == ""
        for end in (1, 2):
            now = shape
            for _ in range(30):
                ends = {interval[0]: interval[end] for interval in now.bounded_intervals()}
                now = replace(now, **ends)
            assert now.wrong() == ""


def test_a_play_is_crossed_over_its_gap_and_never_over_less_than_nothing() -> None:
    effect = built(MODELS[0], "backlash").refined(np.array([3e-4, -1e-4, 0.0]))
    assert effect.settings == {"width": (3e-4, 0.0, 0.0), "held_by": 0.0}
    for cause in {cause for _, cause in ALL} - {"backlash", "joint_lag", "timestamp_latency"}:
        other = built(MODELS[0], cause)
        assert other.refined(np.ones(len(other.parameters))) is other


@pytest.mark.parametrize(
    ("cause", "settings", "named"),
    [
        ("gremlins", {}, "no effect 'gremlins'; choose from: tracker_scale, "),
        ("transmission_error", {"cycle": 33.0}, "transmission_error: unknown setting cycle; all"),
        ("joint_scale", {"gap": 1.0, "a": 2.0}, "unknown setting a, gap; allowed: none"),
        (
            "tracker_drift",
            {"robot": 1.0},
            "setting robot; allowed: time_constant, step_at, period, phase",
        ),
    ],
)
def test_a_wrong_name_is_refused_with_what_there_is(cause, settings, named) -> None:
    with pytest.raises(InputError, match=named) as caught:
        effect_named(cause, ROBOT, ROBOT.model(), settings)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("cause", "settings", "named"),
    [
        ("transmission_error", {"cycles": "many"}, "cycles.*many"),
        ("transmission_error", {"cycles": 0.0}, "cycles.*0"),
        ("transmission_error", {"cycles": float("nan")}, "cycles.*nan"),
        ("stick_slip", {"speed": 0.0}, "speed.*0"),
        ("stick_slip", {"speed": -0.1}, "speed.*-0.1"),
        ("stick_slip", {"level": 1.5}, "level.*1.5"),
        ("tracker_drift", {"time_constant": -5.0}, "time_constant.*-5"),
        ("backlash", {"width": [1e-4, 1e-4]}, "width"),
        ("thermal_growth_arm", {"sensor": 3.0}, "sensor.*3"),
        ("unexplained", {"family": "moonlight"}, "family.*moonlight"),
    ],
)
def test_a_wrong_value_is_refused_and_named(cause, settings, named) -> None:
    with pytest.raises(InputError, match=named):
        effect_named(cause, ROBOT, ROBOT.model(), settings)


@pytest.mark.parametrize("name", ["srbd", "linear_delta"])
def test_a_usual_setting_goes_by_the_joints_unit_until_one_is_given(name: str) -> None:
    robot = load_robot(name)
    usual = EFFECTS["stick_slip"](robot, robot.model())
    assert usual.speed == 0.1 * robot.commanded.joint_size
    given = replace(usual, speed=0.3)
    assert (given.speed, usual.speed) == (0.3, 0.1 * robot.commanded.joint_size)
    assert given != usual
    for copied in (copy(given), deepcopy(given), pickle.loads(pickle.dumps(given))):
        assert copied.speed == 0.3
    with pytest.raises(FrozenInstanceError):
        given.speed = 0.4
