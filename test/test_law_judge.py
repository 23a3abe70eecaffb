"""The comparison of equations with true laws, and the true laws themselves."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blind import Trial, hide
from blind.causes import IN_NO_CATALOGUE
from blind.inputs import Inputs, put
from blind.truth import DRIVE, JOINTS, Truth, of_each, of_rods, of_shift, true
from blind.truths import TRUTHS, truth_of
from blind.unnamed import UNNAMED
from blind.world import State
from study.equation import EquationError, equations
from study.laws import judge_law
from study.trials import BEYOND_GEOMETRY, KINDS

PARTS = ("stage", "part", "variables", "form")
SINE = true(
    DRIVE,
    JOINTS,
    "q_j",
    "sine",
    of_each("q", [1, 2, 3], lambda s, j: 1e-4 * np.sin(4 * s[f"q_{j}"])),
)


def said(
    equation: str, variables: str, part: str = "joint_2", stage: str = DRIVE, **values: float
) -> list[dict]:
    """A law in the form of a verdict."""
    return [
        {
            "stage": stage,
            "part": part,
            "variables": variables.split(),
            "equation": equation,
            "values": {
                n: {"value": v, "std": 0.1 * abs(v), "unit": "1"} for n, v in values.items()
            },
            "probability": 0.9,
            "rival": "",
            "separated_by": "",
        }
    ]


def rights(truth: Truth | None, laws: list[dict]) -> list[bool | None]:
    judged = judge_law(truth, laws)
    json.dumps(judged)
    assert judged["right"] == (bool(judged["said"]) and False not in [judged[p] for p in PARTS])
    return [judged[part] for part in PARTS]


def of_joint_2(variables: str, form: str, one) -> Truth:
    return true(DRIVE, "joint_2", variables, form, of_each("q", [2], one))


@cache
def hidden(kind: str) -> Trial:
    return hide({f"unknown:{kind}": 1.0}, 31, plan="no_sweeps")


# --- equations


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("y = a sin(4 q_1) + b cos(4 q_1)", 3 * np.sin(2.0) - np.cos(2.0)),
        ("y = 2q_1^2 a - -b", 2 * 0.25 * 3 - 1),
        ("y = a*(q_1 - 1)**3", -3 / 8),
        ("y = a (q_1 + 1) (q_1 - 1)", 3 * 1.5 * -0.5),
        ("y = a max(0, q_1 - 0.2) + abs(b) tanh(q_1/0.5)", 0.9 + np.tanh(1.0)),
        ("y = sign(b) exp(-q_1 / 2.5e-1) + 1e-3 a", -np.exp(-2.0) + 3e-3),
        ("y = a step(q_1 - 0.4) + a (q_1 > 0.6) + min(a, b)", 3 - 1),
        ("y = cos(2 pi q_1) × a − b", -3 + 1),
        ("y = -q_1^2", -0.25),
    ],
)
def test_equations_are_evaluated(text: str, value: float):
    (equation,) = equations(text)
    known = {"a": np.array(3.0), "b": np.array(-1.0), "q_1": np.array([0.5])}
    assert equation.left == "y"
    assert equation.names <= set(known)
    assert_allclose(equation.of(known), value)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no equation"),
        ("a sin(q_1)", "expected a name"),
        ("y = sin(q_1", "cannot be read"),
        ("y = q_1 + $", "not understood"),
        ("y = __import__('os')", "not understood"),
        ("y = q_1.real", "not understood"),
        ("y = open(q_1)", "'open' is neither"),
        ("y = sin(q_1, q_1, q_1, q_1)", "of 4 arguments"),
        ("y = a q_1", "'a' is neither"),
        ("y = sin", "neither"),
        ("y = " + "(" * 5000 + "1" + ")" * 5000, "cannot be read"),
        ("y = " + "1+" * 30000 + "1", "characters"),
    ],
)
def test_what_is_no_equation_is_refused(text: str, what: str):
    with pytest.raises(EquationError, match=what):
        _ = [equation.of({"q_1": np.array([0.5])}) for equation in equations(text)]


# --- comparison


def test_the_right_law_is_right_in_everything():
    law = said(
        "dq_1 = a_1 sin(4 q_1); dq_2 = a_2 sin(4 q_2) + c_2; dq_3 = a_3 sin(4 q_3)",
        "q_1 q_2 q_3",
        "every joint",
        a_1=1e-4,
        a_2=1e-4,
        a_3=1.1e-4,
        c_2=3e-5,
    )
    assert rights(SINE, law) == [True] * 4
    assert judge_law(SINE, law)["right"]
    assert (
        rights(SINE, said("dq_j = a_j sin(4 q_j)", "q_j", "joints", a_1=1, a_2=1, a_3=1))
        == [True] * 4
    )


def test_each_part_that_is_wrong_is_told():
    all_joints = "dq_1 = a sin(4 q_1); dq_2 = a sin(4 q_2); dq_3 = a sin(4 q_3)"
    others = "dq_1 = a sin(4 q_2); dq_2 = a sin(4 q_3); dq_3 = a sin(4 q_1)"
    wrong = all_joints.replace("4 q", "6 q")
    words = "q_1 q_2 q_3"
    assert rights(SINE, said(all_joints, words, "joints", "structure", a=1))[0] is False
    assert rights(SINE, said("dq_2 = a sin(4 q_2)", "q_2", a=1))[1:3] == [False, True]
    assert rights(SINE, said(all_joints, words, "joint_1", a=1))[1] is False
    assert rights(SINE, said(others, words, "joints", a=1)) == [True, True, False, False]
    assert rights(SINE, said(wrong, words, "joints", a=1)) == [True, True, True, False]
    assert rights(SINE, said(all_joints, "torque_1", "joints", a=1))[2] is False
    assert rights(SINE, said(all_joints, words, "joints"))[3] is False  # a has no value
    assert not judge_law(SINE, said(wrong, words, "joints", a=1))["right"]


def test_only_the_likeliest_law_counts():
    right = said("dq_j = sin(4 q_j)", "q_j", "joints")
    wrong = said("dq_j = tanh(40 q_j)", "q_j", "joints")
    assert rights(SINE, right + wrong)[3] is True
    assert rights(SINE, wrong + right)[3] is False


def test_no_law_is_none_and_a_law_of_a_clean_machine_is_false():
    law = said("dq_2 = a q_2", "q_2", a=1e-4)
    assert judge_law(SINE, [])["said"] is False
    assert rights(SINE, []) == [False] * 4
    assert judge_law(None, []) == judge_law(SINE, [])
    assert judge_law(None, law)["said"]
    assert not judge_law(None, law)["right"]


def test_an_equation_that_cannot_be_read_is_wrong_and_says_why():
    judged = judge_law(SINE, said("dq_1 = a sin(4 q_1", "q_1", "joints", a=1))
    assert not judged["form"]
    assert "cannot be read" in judged["problem"]
    judged = judge_law(SINE, said("dq_1 = log(q_1)", "q_1", "joints"))
    assert not judged["form"]
    assert "within the session's range" in judged["problem"]


CUBE = of_joint_2("torque_j", "cube", lambda s, j: s[f"torque_{j}"] ** 3 - 100 * s[f"torque_{j}"])
PRODUCT = of_joint_2(
    "direction_j payload", "product", lambda s, j: s[f"direction_{j}"] * (s["payload"] - 1)
)
SPIKE = of_joint_2(
    "direction_j travel_j",
    "exponential",
    lambda s, j: s[f"direction_{j}"] * np.exp(-s[f"travel_{j}"] / 0.05),
)
LINE = of_joint_2("rate_j", "line", lambda s, j: 3e-3 * s[f"rate_{j}"])


@pytest.mark.parametrize(
    ("truth", "equation", "variables", "right"),
    [
        (CUBE, "dq_2 = 1e-7 torque_2^3", "torque_2", True),  # a linear part makes no difference
        (CUBE, "dq_2 = 1e-7 torque_2", "torque_2", False),
        (CUBE, "dq_2 = 1e-7 sin(2 torque_2)", "torque_2", False),
        (PRODUCT, "dq_2 = 2 direction_2 payload", "direction_2 payload", True),
        (PRODUCT, "dq_2 = 2 direction_2 + payload", "direction_2 payload", False),
        (SPIKE, "dq_2 = 2 direction_2 exp(-travel_2 / 0.055)", "direction_2 travel_2", True),
        (SPIKE, "dq_2 = 2 direction_2 exp(-travel_2 / 0.5)", "direction_2 travel_2", False),
        (LINE, "dq_2 = -2 rate_2 + 1", "rate_2", True),
        (LINE, "dq_2 = rate_2^2", "rate_2", False),
        (LINE, "dq_2 = tanh(rate_2)", "rate_2", True),  # nearly linear up to 1 rad/s
        (LINE, "dq_2 = tanh(50 rate_2)", "rate_2", False),
    ],
)
def test_forms_are_told_apart(truth: Truth, equation: str, variables: str, right: bool):
    assert rights(truth, said(equation, variables)) == [True, True, True, right]


def test_neighbours_are_relative():
    after = of_joint_2("q_j+1", "square", lambda s, j: s["q_3"] ** 2)
    assert rights(after, said("dq_2 = q_3^2", "q_3")) == [True] * 4
    assert rights(after, said("dq_2 = q_1^2", "q_1"))[2:] == [False, False]
    around = true(
        DRIVE, "joint_3", "q_j+1", "square", of_each("q", [3], lambda s, j: s["q_1"] ** 2)
    )
    assert rights(around, said("dq_3 = q_1^2", "q_1", "joint_3")) == [True] * 4


def test_rods_are_each_by_their_own_pull():
    truth = true("structure", "rods", "force_j", "dead zone", of_rods(lambda p: np.maximum(p, 0)))
    for equation, names in [
        ("dl_i = a max(0, force_i)", "force_i"),
        ("dl_1a = a max(0, force_1a); dl_1b = a max(0, force_1b)", "force_1a force_1b"),
        ("dl_1 = a max(0, force_1); dl_2 = a max(0, force_2)", "force_1 force_2"),
    ]:
        assert rights(truth, said(equation, names, "rods", "structure", a=1e-6)) == [True] * 4
    off = said("dl_1a = a max(0, force_2b)", "force_2b", "rods", "structure", a=1e-6)
    assert rights(truth, off)[2] is False
    square = said("dl_i = a force_i^2", "force_i", "rods", "structure", a=1e-6)
    assert rights(truth, square)[3] is False


def test_directions_of_a_shift_do_not_matter_and_most_of_it_must_be_said():
    """The frames of tracker and base differ."""
    wave = [[1e-5, 2e-5, 2e-5]]
    truth = true(
        "measurement structure",
        "tracker base platform",
        "time",
        "sine",
        of_shift(lambda s: np.sin(s["time"] / 150)[:, None] * wave),
    )
    law = said("dz = 3 sin(time/150); dx = sin(time/150)", "time", "tracker stand", "measurement")
    assert rights(truth, law) == [True] * 4
    assert (
        rights(truth, said("dz = sin(time/150)", "time", "robot base", "structure")) == [True] * 4
    )
    law = said("dz = 3 sin(time/190)", "time", "tracker", "measurement")
    assert rights(truth, law) == [True, True, True, False]
    three = true(
        "structure",
        "platform",
        "x y z",
        "square",
        of_shift(lambda s: np.stack([s[k] ** 2 for k in "xyz"], axis=1)),
    )
    assert (
        rights(three, said("dx = x^2 + 0 y + 0 z", "x y z", "platform", "structure"))[3] is False
    )


def test_any_of_several_fair_descriptions_is_right():
    truth = TRUTHS["thermal_growth_arm"]({"expansion": 2e-5}, hidden("chiller").cell)
    slow = hidden("chiller").cell.warming.constant["arm"]
    by_sensor = said(
        "dL_1 = a (temperature_arm - 20)", "temperature_arm", "arms", "structure", a=1
    )
    by_clock = said("dL_1 = a (1 - exp(-time / tau))", "time", "arms", "structure", a=1, tau=slow)
    neither = said("dL_1 = a z", "z", "arms", "structure", a=1)
    assert rights(truth, by_sensor) == rights(truth, by_clock) == [True] * 4
    assert rights(truth, neither) == [True, True, False, False]


# --- true laws


def test_every_kind_and_every_cause_that_is_taken_out_has_a_truth():
    assert len(UNNAMED) >= 12
    assert set(IN_NO_CATALOGUE) == {*KINDS, *UNNAMED}
    assert set(TRUTHS) == set(BEYOND_GEOMETRY)


@pytest.mark.parametrize("kind", IN_NO_CATALOGUE)
def test_a_kinds_truth_is_what_moves_its_machine(kind: str):
    """The true law, applied to the states of a session, gives the motion of its machine."""
    trial = hidden(kind)
    truth, world, state = truth_of(trial), trial.measured.world, trial.measured.state
    assert trial.causes[0].values["kind"] == kind
    if truth.law is None:
        assert truth.form is None
        return
    asked: set[str] = set()
    moved = truth.law(_Noting(Inputs(world), asked))
    drives = {f"dq_{j}": state.joint[:, j - 1] - world.command[:, j - 1] for j in (1, 2, 3)}
    dimensions = {
        f"d{word}_{leg}": np.broadcast_to(part, world.command.shape)[:, leg - 1]
        for word, part in (("arm", state.changed.arm), ("hinge", state.changed.outward))
        for leg in (1, 2, 3)
    }
    shift = dict(zip(("dx", "dy", "dz"), state.shift.T, strict=True))
    if state.distortions:
        nowhere = np.zeros((len(world.time), 3))
        read = state.distortions[0](nowhere, world.time)
        shift = dict(zip(("dx", "dy", "dz"), read.T, strict=True))
    rods = {
        f"drod_{leg}{side}": state.changed.rod[..., leg - 1, k]
        for leg in (1, 2, 3)
        for k, side in enumerate("ab")
    }
    every = drives | dimensions | shift | rods
    for name, column in moved.items():
        assert_allclose(column, np.broadcast_to(every.pop(name), column.shape), atol=1e-12)
        assert np.ptp(column) > 1e-6
    assert all(np.abs(rest).max() < 1e-12 for rest in every.values())  # nothing else moves
    words = {variable.removesuffix("_j").partition("_j+")[0] for variable in truth.variables}
    assert {n if n.startswith("temp") else n.partition("_")[0] for n in asked} == words


@pytest.mark.parametrize("cause", [name for name in TRUTHS if name != "tracker_drift"])
def test_a_causes_truth_is_what_its_machine_does(cause: str):
    """The law, put into a machine without the cause, gives the readings of a machine with it."""
    trial = hide({cause: 1.0}, 32)
    world, truth = trial.measured.world, truth_of(trial)
    given = dict(Inputs(world))
    if cause == "dynamic_deflection":
        given |= {f"torque_{leg + 1}": column for leg, column in enumerate(world.pushes().T)}
    for fair in truth.fair:
        if fair.law is None:
            continue
        state = State.untouched(world)
        put(state, fair.law(given))
        rows = world.seen & (world.still | (world.side == 0))
        true = (trial.measured.reading - trial.measured.plain)[rows]
        said = (trial.cell.tracker.sees(world, state) - trial.measured.plain)[rows]
        # friction builds up within 0.4 mrad of travel, and the inertia at a joint depends on
        # others too
        most = {"stick_slip": 0.1, "dynamic_deflection": 0.3}.get(cause, 0.05)
        assert np.sum((said - true) ** 2) / np.sum(true**2) < most


@pytest.mark.parametrize("seed", [33, 34])
def test_a_drift_of_the_tracker_has_one_course(seed: int):
    trial = hide({"tracker_drift": 1.0}, seed)
    world, truth = trial.measured.world, truth_of(trial)
    drift = trial.measured.reading - trial.measured.plain
    course = truth.law(Inputs(world))["dx"][:, None]
    left = drift - course @ np.linalg.lstsq(course, drift, rcond=None)[0]
    assert np.sum(left**2) < 0.05 * np.sum(drift**2)


def test_truth_is_of_one_cause():
    assert truth_of(hide({}, 35, plan="poor")) is None
    with pytest.raises(ValueError, match="2 causes"):
        truth_of(hide({"backlash": 1.0, "joint_lag": 1.0}, 35, plan="poor"))


def test_a_kind_can_be_hidden_in_one_joint_alone():
    trial = hide({"unknown:stiffening@2": 1.0}, 36, plan="poor")
    assert truth_of(trial).parts == {"joint_2"}
    assert trial.causes[0].location == "joint_2"


class _Noting(dict):
    """Inputs that record which of them were read."""

    def __init__(self, inputs: Inputs, asked: set[str]) -> None:
        super().__init__()
        self._inputs, self._asked = inputs, asked

    def __missing__(self, name: str) -> np.ndarray:
        self._asked.add(name)
        return self._inputs[name]


def test_a_law_that_is_listed_joint_by_joint_is_judged_whole():
    """A verdict lists it like this; the law of one joint alone is not the law of all."""
    listed = [
        said(f"dq_{j} = a_{j} sin(4 q_{j})", f"q_{j}", f"joint_{j}", **{f"a_{j}": 1e-4})[0]
        for j in (1, 2, 3)
    ]
    assert rights(SINE, listed) == [True, True, True, True]
    assert rights(SINE, listed[:1])[1] is False
    other = [{**law, "probability": 0.3} for law in listed[1:]]
    assert rights(SINE, [listed[0], *other])[1] is False
