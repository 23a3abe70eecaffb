"""What every effect of the catalogue keeps to, whatever its physics; found by registration."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.effects import EFFECTS, Effect, Stage, catalogue, effect_named
from delta_calibration.effects.unexplained import UNEXPLAINED, Unexplained, families
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from delta_calibration.samples import Conditions, at_rest

ROBOT = load_robot("srbd")
MODELS = ("rotary_delta", "six_rod_delta")
# The causes of a Delta by the names that are fixed for verdicts; geometry is the mechanism's.
MEASUREMENT = {"tracker_scale", "tracker_drift", "timestamp_latency"}
DRIVE = {
    "encoder_eccentricity", "transmission_error", "joint_scale", "backlash", "joint_compliance",
    "joint_lag", "joint_zero_drift", "stick_slip",
}  # fmt: skip
STRUCTURE = {
    "thermal_growth_arm", "thermal_growth_base", "thermal_growth_forearm", "forearm_compliance",
    "dynamic_deflection", "ball_joint_clearance",
}  # fmt: skip
GEOMETRY = {
    "joint_zero_offset", "arm_length", "forearm_length", "base_joint_position", "base_joint_tilt",
    "parallelogram_mismatch",
}  # fmt: skip
UNITS = {"1", "m", "s", "rad", "1/K", "m/N", "rad/(N m)"}
ALL = [(model, e.cause) for model in MODELS for e in catalogue(ROBOT, ROBOT.model(model))]
each_effect = pytest.mark.parametrize(("model", "cause"), ALL)


def conditions(n: int = 60, seed: int = 1) -> Conditions:
    """Half of the samples stand, half move; everything is known and nothing is the same twice."""
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
    )


AT = conditions()


@pytest.fixture(autouse=True)
def _fresh() -> None:
    """What was computed of the samples on the machine of another test is forgotten."""
    AT.kept.clear()


def built(model: str, cause: str) -> Effect:
    return EFFECTS[cause](ROBOT, ROBOT.model(model))


def unexplained(family: str) -> Unexplained:
    return Unexplained.over(built(MODELS[0], "backlash"), family, AT.joint)


def every_shape(effect: Effect, at: Conditions = AT) -> list[Effect]:
    return [effect, *effect.shapes(at)]


def size_of(effect: Effect, at: Conditions) -> tuple[int, int, int]:
    g = len(effect.mechanism.parameters)
    rows = {Stage.DRIVE: 3, Stage.STRUCTURE: g, Stage.MEASUREMENT: 3}[effect.stage]
    return len(at), rows, len(effect.parameters)


def test_every_cause_of_a_delta_is_an_effect_or_a_dimension() -> None:
    assert set(EFFECTS) == MEASUREMENT | DRIVE | STRUCTURE
    assert all(cause == effect.cause for cause, effect in EFFECTS.items())
    dimensions = {p.cause for p in ROBOT.model("six_rod_delta").parameters}
    assert dimensions == GEOMETRY
    chain = Chain(ROBOT.model(), np.zeros(3), 0.05)
    others = {p.cause for p in chain.parameters} - dimensions
    assert others == {"smr_offset", "tracker_frame"}  # and the frame is never reported


def test_kinds_are_those_that_a_verdict_may_say() -> None:
    kinds = {e.cause: e.kind for e in catalogue(ROBOT, ROBOT.model())}
    expected = {**dict.fromkeys(MEASUREMENT, "measurement"), **dict.fromkeys(DRIVE, "drive")}
    assert kinds == {**expected, **dict.fromkeys(STRUCTURE, "structure")}
    for effect in catalogue(ROBOT, ROBOT.model()):
        assert (effect.stage is Stage.MEASUREMENT) == (effect.kind == "measurement")


@each_effect
def test_parameters_are_of_a_machine(model: str, cause: str) -> None:
    for effect in every_shape(built(model, cause)):
        items = effect.parameters.items
        assert items
        assert {p.unit for p in items} <= UNITS
        assert {p.cause for p in items} == {cause}
        for p in items:
            assert p.nominal == 0.0  # no effect unless it is found
            assert p.lower <= 0.0 < p.upper
            assert 0.0 < p.prior <= p.upper / 2.5  # a typical size is well within what can be
            assert np.isfinite([p.prior, p.lower, p.upper]).all()
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
        assert columns.shape == size_of(effect, AT)
        assert np.isfinite(columns).all()
        kept = effect.columns_kept(replace(AT))
        np.testing.assert_array_equal(kept, columns)


@each_effect
def test_each_parameter_moves_something_of_its_own(model: str, cause: str) -> None:
    effect = next(iter(built(model, cause).shapes(AT)))
    flat = effect.columns(AT).reshape(-1, len(effect.parameters))
    values = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), compute_uv=False)
    assert values[-1] > 1e-3
    by_joint = effect.columns(AT)
    for column, p in enumerate(effect.parameters):
        if effect.stage is Stage.DRIVE and p.location is not None:
            others = [j for j in range(3) if f"joint_{j + 1}" != p.location]
            assert not by_joint[:, others, column].any(), p.name


@each_effect
def test_the_stage_shifts_in_proportion_and_not_at_all_at_zero(model: str, cause: str) -> None:
    """Where it shows first: joints, dimensions, or the reading of a chain that holds it alone."""
    effect = built(model, cause).refined(np.full(3, 1e-4))
    chain = Chain(effect.mechanism, np.zeros(3), 0.05, (effect,))
    bare = chain.join(effect.mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    prior = effect.parameters.prior
    v = prior * np.random.default_rng(2).uniform(0.5, 1.0, len(prior))
    x = effect.mechanism.forward(AT.joint, effect.mechanism.parameters.nominal)

    def stage(size: float) -> np.ndarray:
        theta = bare.copy()
        theta[chain.base_size :] = size * v
        if effect.stage is Stage.DRIVE:
            return chain.joints(AT, theta)
        if effect.stage is Stage.STRUCTURE:
            return chain.geometry(AT, theta)
        return chain.reading(AT, x, theta)

    zero, one, three = stage(0.0), stage(1.0), stage(3.0)
    alone = chain.with_effects(())
    without = {
        Stage.DRIVE: AT.joint,
        Stage.STRUCTURE: np.tile(effect.mechanism.parameters.nominal, (len(AT), 1)),
        Stage.MEASUREMENT: alone.reading(AT, x, bare),
    }[effect.stage]
    np.testing.assert_array_equal(zero, without)
    assert np.abs(one - zero).max() > 1e-6
    np.testing.assert_allclose(three - zero, 3 * (one - zero), rtol=1e-9, atol=1e-14)


@each_effect
def test_samples_do_not_know_of_each_other(model: str, cause: str) -> None:
    """The same in another order, and each alone."""
    effect = built(model, cause)
    whole = effect.columns(AT)
    order = np.random.default_rng(3).permutation(len(AT))
    np.testing.assert_allclose(effect.columns(AT.take(order)), whole[order], rtol=1e-9, atol=1e-12)
    one = effect.columns(AT.take(order[:1]))
    np.testing.assert_allclose(one, whole[order[:1]], rtol=1e-9, atol=1e-12)


N = len(AT)
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
@pytest.mark.parametrize("lost", UNKNOWN)
def test_what_is_not_known_is_said_or_does_not_matter(model: str, cause: str, lost: str) -> None:
    """No effect that says it can be evaluated hands on a number that is none."""
    assert not built(model, cause).missing(AT)
    at = replace(AT, **UNKNOWN[lost])
    for effect in every_shape(built(model, cause)):
        if not effect.missing(at):
            assert np.isfinite(effect.columns(at)).all(), effect.settings


@each_effect
def test_what_is_missing_is_named(model: str, cause: str) -> None:
    effect = built(model, cause)
    payload, still = (replace(AT, **UNKNOWN[lost]) for lost in ("one payload", "direction"))
    said = "the payload is not known" if "payload" in effect.needs else ""
    assert effect.missing(payload) == said
    said = "the direction of the last motion is not known" if "direction" in effect.needs else ""
    assert effect.missing(still) == said
    if "temperature" in effect.needs:
        by_sensor = replace(effect, sensor="arm")
        for lost in ("sensors", "temperature", "one temperature"):
            at = replace(AT, **UNKNOWN[lost])
            assert by_sensor.missing(at) == "the temperature of part 'arm' is not known"
            assert not effect.missing(at)  # by the clock it goes on


@each_effect
def test_a_shape_comes_back_from_its_settings(model: str, cause: str) -> None:
    """As a file holds them: numbers, texts, lists."""
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
    assert effect.columns(AT).shape == size_of(effect, AT)
    settings = json.loads(json.dumps(effect.settings))
    again = effect_named(UNEXPLAINED, ROBOT, effect.mechanism, settings)
    assert again.parameters == effect.parameters
    np.testing.assert_array_equal(again.columns(AT), effect.columns(AT))
    for lost in UNKNOWN.values():
        at = replace(AT, **lost)
        assert effect.missing(at) or np.isfinite(effect.columns(at)).all()
    assert effect.bound_to_session == (family == "time")


def test_maps_are_of_what_changed_only() -> None:
    assert len(list(families(AT))) == 7
    still = at_rest(AT.joint)
    assert list(families(still)) == ["position", "joint angle", "time"]


SEARCHED = {
    "tracker_drift": ("time_constant", "step_at"),
    "joint_zero_drift": ("time_constant", "step_at"),
    "transmission_error": ("cycles",),
    "stick_slip": ("speed",),
    "thermal_growth_arm": ("time_constant",),
    "thermal_growth_base": ("time_constant",),
    "thermal_growth_forearm": ("time_constant",),
}


@each_effect
def test_a_searched_shape_lies_within_its_interval_and_can_be(model: str, cause: str) -> None:
    """At its ends as well, for a gear of any ratio; the finer search takes it at its word."""
    joints = replace(ROBOT.joints, gear_ratio=1.0)
    direct = EFFECTS[cause](replace(ROBOT, joints=joints), ROBOT.model(model))
    cold = replace(AT, temperature_parts=(), temperature=np.zeros((N, 0)))
    intervals = {}
    for shape in (*every_shape(built(model, cause), cold), *every_shape(direct, cold)):
        interval = shape.interval()
        if interval is None:
            continue
        name, low, high = interval
        intervals[name] = interval
        assert low < shape.settings[name] < high
        assert low >= 0.0, "a frequency, a time, a speed below nothing"
        for end in (low, high):
            moved = replace(shape, **{name: end})
            assert moved.parameters == shape.parameters
            assert np.isfinite(moved.columns(cold)).all()
    assert tuple(sorted(intervals)) == tuple(sorted(SEARCHED.get(cause, ())))


@pytest.mark.parametrize("cause", SEARCHED)
def test_neighbours_of_a_search_leave_no_gap(cause: str) -> None:
    """Between two shapes next to each other there is none that neither could be refined to."""
    cold = replace(AT, temperature_parts=(), temperature=np.zeros((N, 0)))
    spans: dict[str, list[tuple[float, float]]] = {}
    for shape in built(MODELS[0], cause).shapes(cold):
        interval = shape.interval()
        if interval is not None:
            spans.setdefault(interval[0], []).append(interval[1:])
    spans.pop("step_at", None)  # at rest there are few moments here
    for found in spans.values():
        found.sort()
        for (_, end), (begin, _) in zip(found, found[1:], strict=False):
            assert begin <= end


def test_a_play_is_crossed_over_its_gap_and_never_over_less_than_nothing() -> None:
    effect = built(MODELS[0], "backlash").refined(np.array([3e-4, -1e-4, 0.0]))
    assert effect.settings == {"width": (3e-4, 0.0, 0.0)}
    for cause in set(EFFECTS) - {"backlash"}:
        other = built(MODELS[0], cause)
        assert other.refined(np.ones(len(other.parameters))) is other


@pytest.mark.parametrize(
    ("cause", "settings", "named"),
    [
        ("gremlins", {}, "no effect 'gremlins'; there are: tracker_scale, "),
        ("transmission_error", {"cycle": 33.0}, "transmission_error: unknown setting cycle; .*cyc"),
        ("joint_scale", {"gap": 1.0, "a": 2.0}, "unknown setting a, gap; allowed: none"),
        ("tracker_drift", {"robot": 1.0}, "setting robot; allowed: time_constant, step_at"),
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
        ("tracker_drift", {"time_constant": -5.0}, "time_constant.*-5"),
        ("backlash", {"width": [1e-4, 1e-4]}, "width"),
        ("thermal_growth_arm", {"sensor": 3.0}, "sensor.*3"),
        ("unexplained", {"family": "moonlight"}, "family.*moonlight"),
    ],
)
def test_a_wrong_value_is_refused_and_named(cause, settings, named) -> None:
    with pytest.raises(InputError, match=named):
        effect_named(cause, ROBOT, ROBOT.model(), settings)


def test_one_machines_loads_are_not_kept_for_another() -> None:
    """The same samples, looked at with another model or other masses, as a second fit does."""
    heavy = replace(ROBOT, masses=replace(ROBOT.masses, platform=12.0))
    for robot, model in ((ROBOT, MODELS[0]), (ROBOT, MODELS[1]), (heavy, MODELS[1])):
        effect = EFFECTS["joint_compliance"](robot, robot.model(model))
        expected = effect.columns(replace(AT))
        np.testing.assert_array_equal(effect.columns_kept(AT), expected)
