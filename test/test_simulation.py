"""The simulated machine compared with lever arms of its legs, and its noise with stated values.

The displacement by a hidden cause is checked to first order, independently of the package. A rod
with direction s from its elbow to the platform constrains the displacement dp and rotation w of
the platform: s . dp + s . (w x a), with a its ball joint in the platform, equals s . (displacement
of its elbow) plus the change of its length.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from delta_calibration.data import collect
from delta_calibration.effects import EFFECTS
from delta_calibration.errors import InputError, ReachError
from delta_calibration.plans import legs, make_plan, nominal_joints
from delta_calibration.plans.motion import APPROACH
from delta_calibration.robot import load_robot
from delta_calibration.simulation import (
    draw_machine,
    hideable_causes,
    simulate_session,
    standing,
)

ROBOT = load_robot("srbd")
BASE, PLATFORM, ARM, ROD, HALF = 0.2, 0.055, 0.32, 0.85, 0.04  # [m] table 1 of the paper
PLACES = np.array([[0, 0, -0.711], [0.3, -0.2, -0.75], [-0.1, 0.25, -0.7], [0.2, 0.3, -0.85]])
Q = nominal_joints(ROBOT, PLACES)
LINE = make_plan("line", ROBOT, count=5, dwell=0.3)


def with_tracker(**facts):
    return replace(ROBOT, tracker=replace(ROBOT.tracker, **facts))


def moved_by(**causes):
    """Displacement of the tool by hidden causes in a nominal machine, (n, 3) [m]."""
    drawn = draw_machine(ROBOT, 0, 0.0).tool_points(standing(Q))
    return draw_machine(ROBOT, 0, 0.0, causes).tool_points(standing(Q)) - drawn


def at(value, leg=None):
    """Options in the form of the command line."""
    return {"value": str(value)} | ({} if leg is None else {"location": f"joint_{leg + 1}"})


class LegFrame:
    """Unit vectors of a nominal leg, in the base."""

    def __init__(self, place, q, leg):
        a = 2 * np.pi * leg / 3
        self.out, self.along = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0]])
        self.up = np.array([0.0, 0.0, 1.0])
        self.arm = np.cos(q[leg]) * self.out - np.sin(q[leg]) * self.up
        self.turn = -np.sin(q[leg]) * self.out - np.cos(q[leg]) * self.up
        rod = place + PLATFORM * self.out - BASE * self.out - ARM * self.arm
        assert np.linalg.norm(rod) == pytest.approx(ROD)
        self.rod = rod / ROD


def expected(let_through):
    """Displacement dp (n, 3) if the rod at `side` (-1, 1) of a leg yields along itself."""
    answer = []
    for place, q in zip(PLACES, Q, strict=True):
        rows, right = [], []
        for leg in range(3):
            f = LegFrame(place, q, leg)
            for side in (-1, 1):
                ball = PLATFORM * f.out + side * HALF * f.along
                rows.append(np.concatenate([f.rod, np.cross(ball, f.rod)]))
                right.append(let_through(f, leg, side))
        answer.append(np.linalg.solve(rows, right)[:3])
    return np.array(answer)


def test_a_machine_without_scatter_is_as_drawn():
    machine = draw_machine(ROBOT, 3, 0.0)
    np.testing.assert_allclose(machine.tool_points(standing(Q)), PLACES, atol=1e-12)
    offset = replace(ROBOT, tool_offset=np.array([0.02, -0.01, 0.05]))
    q = nominal_joints(offset, PLACES)
    tool = draw_machine(offset, 3, 0.0).tool_points(standing(q))
    np.testing.assert_allclose(tool, PLACES, atol=1e-12)


SMALL = 1e-5  # [m] or [rad]: second-order terms are below 1e-8 m


@pytest.mark.parametrize(
    ("cause", "leg", "shift"),
    [
        ("joint_zero_offset", 1, lambda f, side: SMALL * ARM * f.turn),
        ("joint_zero_offset", None, lambda f, side: SMALL * ARM * f.turn),
        ("arm_length", 2, lambda f, side: SMALL * f.arm),
        ("base_joint_position", 0, lambda f, side: SMALL * (f.out + f.along + f.up)),
        (  # rotated about the radius of the leg and the vertical, with the line of its ball joints
            "base_joint_tilt",
            0,
            lambda f, side: np.cross(SMALL * (f.out + f.up), ARM * f.arm + side * HALF * f.along),
        ),
    ],
)
def test_a_hidden_cause_at_an_elbow_moves_the_tool(cause, leg, shift):
    want = expected(lambda f, row, side: f.rod @ shift(f, side) if leg in (None, row) else 0.0)
    found = moved_by(**{cause: at(SMALL, leg)})
    assert np.abs(want).max() > 0.2 * SMALL * ARM
    np.testing.assert_allclose(found, want, atol=2e-9)


@pytest.mark.parametrize("leg", [0, 1, 2])
def test_a_hidden_cause_in_a_pair_of_rods_moves_the_tool(leg):
    want = expected(lambda f, row, side: SMALL * (row == leg))
    np.testing.assert_allclose(moved_by(forearm_length=at(SMALL, leg)), want, atol=2e-9)
    want = expected(lambda f, row, side: SMALL * (row == leg) * side / 2)
    np.testing.assert_allclose(moved_by(parallelogram_mismatch=at(SMALL, leg)), want, atol=2e-9)
    assert np.abs(want).max() > 1e-7


def test_causes_add_and_a_shared_one_is_all_three():
    each = [moved_by(arm_length=at(SMALL, leg)) for leg in range(3)]
    np.testing.assert_allclose(moved_by(arm_length=at(SMALL)), sum(each), atol=2e-9)
    both = moved_by(arm_length=at(SMALL, 1), forearm_length=at(-SMALL, 0))
    rest = moved_by(forearm_length=at(-SMALL, 0))
    np.testing.assert_allclose(both, each[1] + rest, atol=2e-9)


def test_a_hidden_cause_changes_nothing_else_of_the_machine():
    plain = draw_machine(ROBOT, 5)
    hidden = draw_machine(ROBOT, 5, hidden={"arm_length": {"location": "joint_3"}})
    change = hidden.theta - plain.theta
    row = plain.chain.parameters.row("arm_3")
    assert np.flatnonzero(change).tolist() == [row]
    assert change[row] == pytest.approx(3 * 0.15e-3)  # three standard deviations of the part


def test_every_dimension_that_is_offered_can_be_hidden():
    plain = draw_machine(ROBOT, 5)
    effects = (*EFFECTS, "smr_offset")
    causes = [c for c in hideable_causes(ROBOT, plain.chain) if c not in effects]
    assert len(causes) == 7
    for cause in causes:
        theta = draw_machine(ROBOT, 5, hidden={cause: {"location": "joint_1"}}).theta
        names = [plain.chain.parameters.names[k] for k in np.flatnonzero(theta - plain.theta)]
        assert names
        assert all("_1" in name for name in names)


@pytest.mark.parametrize(
    ("cause", "options", "message"),
    [
        ("slack", {}, r"slack cannot be hidden; causes: .*arm_length, .*backlash.*; locations: j"),
        ("tracker_frame", {}, "tracker_frame cannot be hidden; causes: "),
        ("arm_length", {"location": "joint_4"}, r"length at joint_4 cannot .*: joint_1, joint_2"),
        ("arm_length", {"size": "1"}, "unknown option size; allowed: location, value, str"),
        ("arm_length", {"value": "big"}, "value 'big' is not a finite number"),
        ("arm_length", {"value": "nan"}, "value 'nan' is not a finite number"),
        ("arm_length", {"value": "0.2mm"}, r"value '0\.2mm' .*SI: m"),
    ],
)
def test_what_cannot_be_hidden_is_refused_with_the_choice(cause, options, message):
    with pytest.raises(InputError, match=message):
        draw_machine(ROBOT, 0, hidden={cause: options})


def test_parts_scatter_by_their_tolerances():
    """200 machines, with each parameter of the geometry in units of its prior."""
    nominal = draw_machine(ROBOT, 0).chain.mechanism.parameters
    g = np.array([draw_machine(ROBOT, seed).theta[: len(nominal)] for seed in range(200)])
    drawn = np.array([parameter.drawn for parameter in nominal])
    z = ((g - nominal.nominal) / nominal.prior)[:, drawn]
    assert kstest(z.ravel(), "norm").pvalue > 1e-3
    sizes = z.std(axis=0)
    assert 0.8 < sizes.min() < sizes.max() < 1.25
    doubled = draw_machine(ROBOT, 7, 2.0).theta[: len(nominal)]
    np.testing.assert_allclose(doubled - nominal.nominal, 2 * (g[7] - nominal.nominal), atol=1e-15)


@pytest.mark.parametrize(("name", "off"), [("srbd", 1e-3), ("scara", 1e-4)])
def test_the_reflector_is_no_further_off_than_the_file_expects(name, off):
    """Otherwise the reflector of every machine without a cause would contradict its prior."""
    robot = load_robot(name)
    machines = (draw_machine(robot, seed) for seed in range(100))
    missed = [m.chain.split(m.theta)[1] - robot.tracker.reflector_offset for m in machines]
    assert kstest(np.ravel(missed) / off, "norm").pvalue > 0.01


def test_the_tracker_stands_about_3_m_off():
    distance = [
        np.linalg.norm(machine.chain.split(machine.theta)[2].translation)
        for machine in (draw_machine(ROBOT, seed) for seed in range(50))
    ]
    assert 2.6 < min(distance) < 2.95 < 3.05 < max(distance) < 3.4


def test_noise_has_the_stated_size_along_and_across_the_beam():
    robot = with_tracker(radial=2e-6, transverse=5e-6, transverse_per_metre=3e-6)
    machine, n = draw_machine(robot, 1), 20_000
    y = machine.readings(standing(np.tile(Q[1], (n, 1))), np.random.default_rng(2))
    beam, distance = y.mean(axis=0), np.linalg.norm(y.mean(axis=0))
    beam = beam / distance
    side = np.cross(beam, [0, 0, 1])
    side = side / np.linalg.norm(side)
    across = 5e-6 + 3e-6 * distance
    assert 12e-6 < across < 17e-6
    for axis, sigma in ((beam, 2e-6), (side, across), (np.cross(beam, side), across)):
        square = np.sum(((y - y.mean(axis=0)) @ axis / sigma) ** 2)
        assert 1e-4 < chi2.cdf(square, n - 1) < 1 - 1e-4
    correlation = np.corrcoef((y @ np.stack([beam, side], axis=1)).T)[0, 1]
    assert abs(correlation) < 4 / np.sqrt(n)


def test_readings_are_of_the_reflector_in_the_trackers_frame():
    """Without noise, distances between readings are those between places of the reflector."""
    robot = with_tracker(
        radial=1e-15,
        transverse=1e-15,
        transverse_per_metre=0.0,
        reflector_offset=np.array([0.1, 0.0, -0.05]),
    )
    machine = draw_machine(robot, 1, 0.0)
    y = machine.readings(standing(Q), np.random.default_rng(0))
    seen, real = y[1:] - y[0], PLACES[1:] - PLACES[0]  # a nominal platform does not tilt
    np.testing.assert_allclose(seen @ seen.T, real @ real.T, atol=1e-12)
    assert np.linalg.det(seen) == pytest.approx(np.linalg.det(real), rel=1e-9)  # no mirror image
    offset = machine.chain.split(machine.theta)[2].inverse().apply(y) - PLACES
    np.testing.assert_allclose(offset, np.tile([0.1, 0.0, -0.05], (4, 1)), atol=1e-12)


def test_joints_come_to_rest_12_urad_off_once_a_move():
    """From the readings of a nominal machine with a tracker without noise."""
    robot = with_tracker(radial=1e-15, transverse=1e-15, transverse_per_metre=0.0)
    machine = draw_machine(robot, 4, 0.0)
    plan = make_plan("disc", robot, count=60, dwell=0.3)
    session = simulate_session(machine, plan, 8)
    point = machine.chain.split(machine.theta)[2].inverse().apply(session.tracker.position)
    rest = nominal_joints(robot, point) - session.command.position
    stop = np.repeat(np.arange(len(plan)), [len(leg.time) for leg in legs(plan, robot, 20.0)])
    each = np.array([rest[stop == k] for k in range(len(plan))], dtype=object)
    assert max(np.ptp(rows[1:].astype(float), axis=0).max() for rows in each) < 1e-10
    draws = np.array([rows[-1] for rows in each], dtype=float)
    begin = np.array([rows[0] for rows in each], dtype=float)  # the joints have not moved yet
    np.testing.assert_allclose(begin[1:], draws[:-1], rtol=0, atol=1e-10)
    assert kstest(draws.ravel() / 12e-6, "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(draws.T) - np.eye(3)).max() < 4 / np.sqrt(len(draws))


def test_encoders_say_the_command_with_their_own_noise():
    session = simulate_session(draw_machine(ROBOT, 4), LINE, 8)
    error = session.states.position - session.command.position
    assert kstest(error.ravel() / 3e-6, "norm").pvalue > 1e-3


def same(a, b):
    return [
        np.array_equal(getattr(a, stream).position, getattr(b, stream).position)
        for stream in ("command", "states", "tracker")
    ]


def test_the_seeds_decide_everything():
    machine = draw_machine(ROBOT, 6)
    np.testing.assert_array_equal(machine.theta, draw_machine(ROBOT, 6).theta)
    assert (machine.theta != draw_machine(ROBOT, 7).theta).sum() == len(machine.theta) - 6
    once = simulate_session(machine, LINE, 9)
    assert same(once, simulate_session(machine, LINE, 9)) == [True, True, True]
    assert same(once, simulate_session(machine, LINE, 10)) == [True, False, False]
    np.random.seed(0)  # noqa: NPY002 - the global generator must not be used
    assert same(once, simulate_session(machine, LINE, 9))[1:] == [True, True]


def test_streams_share_stamps_that_rise_by_the_rate():
    session = simulate_session(draw_machine(ROBOT, 6), LINE, 9, rate=50.0)
    stamps = session.tracker.stamp_ns
    assert stamps.dtype == np.int64
    np.testing.assert_array_equal(stamps, session.command.stamp_ns)
    np.testing.assert_array_equal(stamps, session.states.stamp_ns)
    np.testing.assert_allclose(np.diff(stamps), 20e6, atol=2)
    assert session.command.names == session.states.names == ROBOT.joints.names


@pytest.mark.parametrize("rate", [4.0, 10.0])
def test_slow_readings_still_know_which_way_each_joint_came(rate):
    plan = replace(make_plan("rich", ROBOT, count=6, dwell=1.5, seed=2), paths=())
    session = simulate_session(draw_machine(ROBOT, 6), plan, 9, rate=rate)
    poses = collect(session, ROBOT.joints.names)
    wanted = np.broadcast_to(plan.direction[:, None], poses.direction.shape)
    np.testing.assert_array_equal(poses.direction, wanted)
    assert poses.travel.min() > 0.9 * APPROACH


def test_a_period_keeps_stops_apart_and_the_wait_is_not_recorded():
    quick = simulate_session(draw_machine(ROBOT, 6), LINE, 9)
    slow = simulate_session(draw_machine(ROBOT, 6), LINE, 9, period=30.0)
    assert same(quick, slow) == [True, True, True]
    step = np.diff(slow.tracker.stamp_ns) * 1e-9
    begins = np.flatnonzero(step > 1.0) + 1
    assert len(begins) == len(LINE) - 1
    np.testing.assert_allclose(np.diff(slow.tracker.stamp_ns[begins]) * 1e-9, 30.0)
    for part in slow.temperature:
        assert part.stamp_ns[0] <= slow.tracker.stamp_ns[0]
        assert part.stamp_ns[-1] >= slow.tracker.stamp_ns[-1]
        assert (part.celsius == 20.0).all()


def test_payload_is_said_before_the_move_it_is_carried_on():
    plan = make_plan("rich", ROBOT, count=4, dwell=0.2, seed=2)
    plan = replace(plan, paths=())
    session = simulate_session(draw_machine(ROBOT, 6), plan, 9)
    assert session.payload.mass.tolist() == [0.0, 2.0, 0.0, 2.0]
    sizes = [len(leg.time) for leg in legs(plan, ROBOT, 20.0)]
    begins = session.tracker.stamp_ns[np.cumsum([0, *sizes[:-1]])]
    held = np.searchsorted(session.payload.stamp_ns, begins, side="right") - 1
    np.testing.assert_array_equal(session.payload.mass[held], plan.payload)


def test_every_leg_is_handed_on_for_a_progress_bar():
    seen = []

    def follow(each):
        for leg in each:
            seen.append(leg)
            yield leg

    simulate_session(draw_machine(ROBOT, 6), LINE, 9, follow=follow)
    assert len(seen) == len(LINE)


def test_a_machine_that_cannot_follow_names_plan_and_command():
    hidden = {"arm_length": at(0.3)}
    with pytest.raises(ReachError, match=r"plan 'line': joint command 1 \(.*\) is out of"):
        simulate_session(draw_machine(ROBOT, 0, hidden=hidden), LINE, 0)
