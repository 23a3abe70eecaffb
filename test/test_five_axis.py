"""Tests of the five-axis machine: closure against geometry, modes, rank, the paper's trial."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import five_axis as trial
from closures_by_hand import placed
from delta_calibration.chain import Chain
from delta_calibration.data import at_rest
from delta_calibration.effects.slider_pitch import SliderPitch
from delta_calibration.errors import ReachError
from delta_calibration.estimation import observe
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from machines import complex_step

MACHINE = load_robot("five_axis").model()
NOMINAL = MACHINE.parameters.nominal
HIDDEN = ("platform_x_3", "slider_x_3", "platform_x_4", "slider_x_4")


def poses(n: int, seed: int = 0) -> np.ndarray:
    """Poses over the workspace of the paper's arcs: y, z [m], A, B [rad]."""
    low, high = [-0.1, 0.95, -0.35, -0.35], [0.1, 1.15, 0.35, 0.35]
    return np.random.default_rng(seed).uniform(low, high, (n, 4))


def machine(seed: int, scale: float = 100.0) -> np.ndarray:
    """Parameters with errors of `scale` times the expected ones: millimetres."""
    rng = np.random.default_rng(seed)
    return NOMINAL + scale * MACHINE.parameters.prior * rng.standard_normal(len(NOMINAL))


def joints_in_space(x: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Platform joints and slider joints at q = 0 for one pose, in the base, each (4, 3) [m]."""
    y, z, a, b = x
    both = Rotation.from_euler("XY", [a, b])  # capitals: about the rotated axes
    only_x = Rotation.from_euler("X", a)
    ends = g[:24].reshape(4, 2, 3)
    turned = [t.apply(p) for t, p in zip((both, both, only_x, only_x), ends[:, 0], strict=True)]
    return np.array([0.0, y, z]) + turned, ends[:, 1]


def test_struts_reach_from_slider_to_platform_in_space():
    g, x = machine(1), poses(20, seed=1)
    q = MACHINE.inverse(x, g)
    for pose, sliders in zip(x, q, strict=True):
        platform, columns = joints_in_space(pose, g)
        ends = columns + np.outer(sliders, [0, 0, 1])
        length = np.linalg.norm(platform - ends, axis=1)
        np.testing.assert_allclose(length, g[24:], atol=1e-14)


def test_inverse_and_forward_undo_each_other_on_every_arc():
    g, x = machine(2), np.concatenate([trial.MEASURED, poses(200, seed=2)])
    q = MACHINE.inverse(x, g)
    assert np.abs(MACHINE.closure(q, x, g)).max() < 1e-14
    np.testing.assert_allclose(MACHINE.forward(q, g), x, atol=1e-12)


def test_working_mode_is_two_sliders_over_and_two_under_the_platform():
    x = np.concatenate([trial.MEASURED, poses(200, seed=3)])
    rise = []
    for pose, sliders in zip(x, MACHINE.inverse(x, NOMINAL), strict=True):
        platform, columns = joints_in_space(pose, NOMINAL)
        rise.append(columns[:, 2] + sliders - platform[:, 2])
    assert (np.array(rise)[:, :2] > 0.1).all()
    assert (np.array(rise)[:, 2:] < -0.1).all()


def test_assembly_mode_is_never_left():
    """No pose of the workspace is singular; the forward kinematics stay on one side of them."""
    x = np.concatenate([trial.MEASURED, poses(500, seed=4)])
    q = MACHINE.inverse(x, NOMINAL)
    reached = MACHINE.forward(q, NOMINAL)
    sign = np.linalg.det(MACHINE.closure_by_pose(q, reached, NOMINAL))
    assert (sign < -1e-3).all()
    assert MACHINE.condition(q, reached, NOMINAL).max() < 50


def test_place_of_a_point_on_the_platform_and_its_derivative():
    x, offset = poses(5, seed=6), np.array([0.02, -0.03, 0.15])

    for pose, place in zip(x, MACHINE.points(x, offset), strict=True):
        turned = Rotation.from_euler("XY", pose[2:]).apply(offset)
        np.testing.assert_allclose(place - turned, [0.0, *pose[:2]], atol=1e-15)
    exact = complex_step(lambda v: placed(MACHINE, v, np.tile(offset, (5, 1))), x)
    np.testing.assert_allclose(MACHINE.point_by_pose(x, offset), exact, atol=1e-15)


def test_twenty_of_twenty_four_errors_show_and_the_others_are_named():
    q, papers = MACHINE.inverse(trial.MEASURED, NOMINAL), slice(0, trial.PAPERS)
    jacobian = MACHINE.identification_jacobian(q, trial.MEASURED, NOMINAL)
    names = MACHINE.parameters.names[papers]
    seen = observe(jacobian[..., papers], MACHINE.parameters.prior[papers], names)
    assert (seen.columns, seen.rank) == (24, 20)
    assert {(r.parameter, r.same_as) for r in seen.redundancies} == {(n, ()) for n in HIDDEN}
    assert {MACHINE.parameters.names[row] for row in trial.FREE} == {*names} - {*HIDDEN}
    assert np.linalg.matrix_rank(jacobian[:, :, trial.FREE].reshape(-1, 20)) == 20


def test_a_joint_error_reaches_the_tip_about_doubled():
    """By machines drawn at random, compared with the derivative."""
    q, rng = MACHINE.inverse(trial.MEASURED, NOMINAL), np.random.default_rng(10)
    joints = np.array([p.drawn for p in MACHINE.parameters])
    moved = [
        trial.tip(MACHINE.forward(q, NOMINAL + 1e-5 * joints * rng.standard_normal(len(joints))))
        - trial.tip(trial.MEASURED)
        for _ in range(200)
    ]
    typical = 1e5 * np.sqrt(np.sum(np.square(moved), axis=-1).mean())
    assert typical == pytest.approx(trial.gain(), rel=0.1)
    assert 1.5 < typical < 2.5


def test_a_strut_out_of_range_is_refused_by_name():
    x = np.array([[0.0, 1.05, 0.0, 0.0], [0.5, 1.05, 0.0, 0.0]])
    q = MACHINE.inverse(x, NOMINAL)
    assert np.isfinite(q[0]).all()
    with pytest.raises(ReachError, match=r"target 2 \(0.5, 1.05, 0, 0 .*out of the robot's reach"):
        MACHINE.require_reach(q, x, "target", "m, rad")
    together = MACHINE.forward(np.array([MACHINE.home, [9.0, 0.0, 0.0, 0.0]]), NOMINAL)
    np.testing.assert_allclose(together[0], x[0], atol=1e-12)
    assert np.isnan(together[1]).all()


def test_parameters_say_cause_place_and_size():
    by_name = {p.name: p for p in MACHINE.parameters}
    assert by_name["slider_z_2"].cause == "joint_zero_offset"
    assert by_name["slider_y_2"].cause == "base_joint_position"
    assert by_name["platform_y_2"].cause == "platform_joint_position"
    assert by_name["platform_y_2"].location == "joint_2"
    assert by_name["platform_y_2"].nominal == 0.123
    assert by_name["platform_y_1"].nominal == -0.123
    assert {p.unit for p in MACHINE.parameters} == {"m"}
    assert by_name["strut_4"].nominal == 0.644
    struts = {name: p for name, p in by_name.items() if p.cause == "arm_length"}
    assert [*struts] == ["strut_1", "strut_2", "strut_3", "strut_4"]
    assert {p.prior for p in struts.values()} == {2e-6}  # measured on the bench
    assert not any(p.drawn for p in struts.values())
    joints = (p for p in MACHINE.parameters if p.cause != "arm_length")
    assert {round(p.prior * 1e6, 1) for p in joints} == {17.3}


def cell() -> tuple[Chain, np.ndarray]:
    """A tracker that measures the tool tip; every parameter has an error."""
    chain = Chain(MACHINE, MACHINE.tool, 1e-3)
    frame = Frame.from_vector(np.array([0.1, -0.2, 2.0, 1.0, 2.0, 0.3]))
    return chain, chain.join(machine(8, 1.0), MACHINE.tool + 1e-3, frame)


def test_the_chain_of_measurement_takes_the_machine_as_it_is():
    chain, theta = cell()
    at = at_rest(MACHINE.inverse(poses(5, seed=8), NOMINAL))
    jacobian = chain.jacobian(at, theta)
    for k, step in enumerate(1e-6 * np.eye(len(theta))):
        slope = (chain.predict(at, theta + step) - chain.predict(at, theta - step)) / 2e-6
        np.testing.assert_allclose(jacobian[..., k], slope, atol=3e-8)


def test_a_screw_of_wrong_pitch_moves_each_slider_in_proportion():
    chain, theta = cell()
    pitch = SliderPitch(load_robot("five_axis"), MACHINE)
    assert pitch.parameters.names == ("pitch_1", "pitch_2", "pitch_3", "pitch_4")
    q = MACHINE.inverse(poses(5, seed=9), NOMINAL)
    s = np.array([40e-6, -30e-6, 20e-6, 70e-6])
    wrong = chain.with_effects((pitch,)).predict(at_rest(q), np.concatenate([theta, s]))
    np.testing.assert_allclose(wrong, chain.predict(at_rest(q * (1 + s)), theta), atol=1e-14)


def test_arcs_of_the_paper():
    assert len(trial.ARCS) == 18
    assert trial.MEASURED.shape == (198, 4)
    assert trial.ARCS[6] == trial.Arc(-100, 1150, "X", -10, 0)
    assert trial.ARCS[7] == trial.Arc(100, 1150, "Y", -15, 15)
    assert trial.ARCS[16] == trial.Arc(100, 950, "X", 0, 10)
    assert trial.ARCS[17] == trial.Arc(-100, 950, "Y", -15, 15)
    assert trial.EVALUATED.shape == (32, 4)


def within_print(outcome: trial.Outcome) -> bool:
    return outcome.percent <= 10.0 and 1e3 * outcome.deviation < 3.4e-4


def test_singular_directions_reach_the_printed_figures_where_raw_parameters_do_not():
    methods = trial.methods()
    found = {name: trial.trial(method, 0, None) for name, method in methods.items()}
    best = found["QPSO, stepwise by singular direction"]
    assert within_print(best)
    assert best.percent < 0.01
    assert best.evaluations <= trial.BUDGET
    assert within_print(found["QPSO, singular coordinates, all at once"])
    assert within_print(found["least squares (Gauss-Newton)"])
    for name in ("PSO", "APSO", "QPSO, plain", "QPSO, stepwise by settled parameters"):
        assert not within_print(found[name])
        assert found[name].deviation < 0.02e-3  # and yet the swarm has found a part of it


def test_under_noise_the_swarm_is_as_good_as_least_squares():
    noise = trial.Noise(1e-6, 5e-6)
    methods = trial.methods()
    exact, swarm = (
        trial.trial(methods[name], 3, noise)
        for name in ("least squares (Gauss-Newton)", "QPSO, stepwise by singular direction")
    )
    assert exact.error > 1e-6  # no search can find what the data do not contain
    assert swarm.error == pytest.approx(exact.error, rel=1e-3)
    assert swarm.deviation == pytest.approx(exact.deviation, rel=1e-3)


def test_noise_is_that_of_the_tip():
    """Tip and angles scatter as requested; the centre's position follows from both."""
    noise = trial.Noise(2e-6, 5e-6)
    still = np.zeros(len(trial.FREE))
    seen = np.stack(
        [trial.measure(still, noise, np.random.default_rng(k)).pose for k in range(30)]
    )
    flat = seen.reshape(-1, 4)
    tip = trial.tip(flat).reshape(30, -1, 3)[..., 1:] - trial.tip(trial.MEASURED)[:, 1:]
    assert np.std(tip) == pytest.approx(2e-6, rel=0.03)
    assert np.std((seen - trial.MEASURED)[..., 2:]) == pytest.approx(5e-6, rel=0.03)
