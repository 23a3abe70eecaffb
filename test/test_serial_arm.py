"""Serial arm: postures, rank, and comparison with plain DH matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.errors import ConfigError, ReachError
from delta_calibration.geometry import rotations
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmTolerances
from delta_calibration.model.chain_constants import OF_INERTIA
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

SCARA = load_robot("scara").dimensions
UR10 = load_robot("ur10").dimensions
TOLERANCES = ArmTolerances(0.5e-3, 1e-3, 1e-3, 2e-3, 5e-3)
MOUNTED = replace(UR10, tool=np.array([0.02, -0.01, 0.09]), mount=np.array([0.4, np.pi / 2, -1.1]))
PLANAR = replace(
    SCARA,
    links=(
        SCARA.links[0],
        replace(SCARA.links[1], length=0.4),
        replace(SCARA.links[1], length=0.3),
    ),
    tool=np.array([0.2, 0.0, 0.0]),
    home=np.radians([30.0, 40.0, 30.0]),
)
ARMS = {
    "six_axes": MOUNTED,
    "scara": SCARA,
    "three_axes": replace(
        UR10, links=UR10.links[:3], tool=np.array([-0.57, 0.0, 0.16]), home=UR10.home[:3]
    ),
}


@pytest.fixture(params=ARMS)
def arm(request):
    return SerialArm(ARMS[request.param], TOLERANCES)


def machine(arm, rng, scale=3.0):
    parameters = arm.parameters
    return parameters.nominal + scale * parameters.prior * rng.standard_normal(len(parameters))


def joints_about_home(arm, rng, n, spread=1.0):
    return arm.home + rng.uniform(-spread, spread, (n, arm.joints))


def test_ur10_against_its_dh_matrices():
    """A_i = R_z(theta) T_z(d) T_x(a) R_x(alpha), the manufacturer's convention, multiplied."""
    a, d = [0, -0.612, -0.5723, 0, 0, 0], [0.1273, 0, 0, 0.163941, 0.1157, 0.0922]
    alpha = np.radians([90, 0, 0, 90, -90, 0])
    arm = SerialArm(UR10, TOLERANCES)
    q = joints_about_home(arm, np.random.default_rng(1), 20, spread=3.0)
    x = arm.forward(q, arm.parameters.nominal)
    for row in range(len(q)):
        total = np.eye(4)
        for j in range(6):
            c, s = np.cos(q[row, j]), np.sin(q[row, j])
            ca, sa = np.cos(alpha[j]), np.sin(alpha[j])
            total = total @ [
                [c, -s * ca, s * sa, a[j] * c],
                [s, c * ca, -c * sa, a[j] * s],
                [0, sa, ca, d[j]],
                [0, 0, 0, 1],
            ]
        np.testing.assert_allclose(x[row, :3], total[:3, 3], atol=1e-14)
        np.testing.assert_allclose(arm.rotation(x)[row], total[:3, :3], atol=1e-14)


def test_tool_is_mounted_as_scipy_says():
    plain, mounted = SerialArm(UR10, TOLERANCES), SerialArm(MOUNTED, TOLERANCES)
    q = joints_about_home(plain, np.random.default_rng(2), 5)
    bare = plain.forward(q, plain.parameters.nominal)
    x = mounted.forward(q, mounted.parameters.nominal)
    flange = plain.rotation(bare)
    np.testing.assert_allclose(x[:, :3], bare[:, :3] + flange @ MOUNTED.tool, atol=1e-14)
    turn = Rotation.from_euler("ZYX", MOUNTED.mount).as_matrix()
    np.testing.assert_allclose(mounted.rotation(x), flange @ turn, atol=1e-12)


def test_inverse_undoes_forward_beside_its_guess(arm):
    rng = np.random.default_rng(7)
    g, q = machine(arm, rng), joints_about_home(arm, rng, 50, 0.5)
    x = arm.forward(q, g)[:, : arm.task_size]
    np.testing.assert_allclose(arm.inverse(x, g, q + 0.03), q, atol=1e-9)


def test_pose_of_half_a_turn_is_found():
    """Although the rotation vector jumps from pi to -pi, the residual must not."""
    arm = SerialArm(UR10, TOLERANCES)
    g = arm.parameters.nominal
    task = np.array([[0.5, 0.3, 0.4, np.pi - 1e-9, 0.0, 0.0], [0.5, 0.3, 0.4, 1e-9 - np.pi, 0, 0]])
    q = arm.inverse(task, g, np.tile(arm.home, (2, 1)))
    np.testing.assert_allclose(q[0], q[1], atol=1e-7)
    turned = arm.rotation(arm.forward(q, g))
    np.testing.assert_allclose(turned, rotations.exp(task[:, 3:]), atol=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_elbow_stays_on_the_side_of_home(side):
    arm = SerialArm(replace(SCARA, home=side * SCARA.home), TOLERANCES)
    rng = np.random.default_rng(8)
    g = machine(arm, rng)
    q = np.stack([rng.uniform(-3, 3, 200), side * rng.uniform(0.05, 3.0, 200)], axis=1)
    found = arm.inverse(arm.forward(q, g)[:, :2], g)
    apart = np.mod(found - q + np.pi, 2 * np.pi) - np.pi
    assert np.abs(apart).max() < 1e-7


def test_scara_is_paper_003_equation_5():
    """x = l1 cos t1 + l2 cos(t1 + t2), and y likewise with sines."""
    arm = SerialArm(SCARA, TOLERANCES)
    q = np.random.default_rng(9).uniform(-3, 3, (20, 2))
    one, both = q[:, 0], q.sum(axis=1)
    wanted = 0.5 * np.stack([np.cos(one) + np.cos(both), np.sin(one) + np.sin(both)], axis=1)
    x = arm.forward(q, arm.parameters.nominal)
    np.testing.assert_allclose(x[:, :2], wanted, atol=1e-14)
    np.testing.assert_allclose(x[:, 2], 0.0, atol=1e-14)


def test_scara_reach_and_its_edge():
    arm = SerialArm(SCARA, TOLERANCES)
    g = arm.parameters.nominal
    target = np.array([[0.6, 0.2], [1.01, 0.0]])
    q = arm.inverse(target, g)
    assert np.isfinite(q[0]).all()
    with pytest.raises(ReachError, match=r"target 2 \(1.01, 0 m\) is out of the robot's reach"):
        arm.require_reach(q, target, "target", "m")
    stretched = np.array([[0.3, 1e-6], [0.3, 1.0]])
    condition = arm.condition(stretched, arm.forward(stretched, g), g)
    assert condition[0] > 1e5 > 10 > condition[1]


def test_one_bad_row_does_not_hold_up_the_others():
    arm = SerialArm(UR10, TOLERANCES)
    g = arm.parameters.nominal
    x = arm.forward(np.tile(arm.home, (3, 1)), g)
    x[1], x[2, :3] = np.nan, 9.0
    q = arm.inverse(x, g)
    np.testing.assert_allclose(q[0], arm.home, atol=1e-9)
    assert np.isnan(q[1:]).all()
    assert (np.isnan(arm.forward(q, g)).all(axis=1) == [False, True, True]).all()


def observed_rank(arm, frame: bool, rng):
    q = rng.uniform(-2.5, 2.5, (150, arm.joints))
    g = arm.parameters.nominal
    x = arm.forward(q, g)
    twist = np.zeros((len(q), 6, 6))  # of the base, in the base
    twist[:, :3, :3], twist[:, :3, 3:] = -rotations.skew(x[:, :3]), np.eye(3)
    twist[:, 3:, :3] = np.eye(3)
    by_turn = np.linalg.inv(rotations.left_jacobian(x[:, 3:]))
    twist[:, 3:] = by_turn @ twist[:, 3:]
    jacobian = arm.identification_jacobian(q, x, g)
    columns = np.concatenate([jacobian, twist], axis=-1) if frame else jacobian
    values = np.linalg.svd(columns.reshape(-1, columns.shape[-1]), compute_uv=False)
    kept = values > 1e-9 * values[0]
    assert values[kept].min() > 1e-4 * values[0]  # a clear gap: the parameters are regular
    return int(kept.sum())


@pytest.mark.parametrize("dimensions", [UR10, MOUNTED, SCARA], ids=["ur10", "mounted", "scara"])
def test_identifiable_parameters_are_four_a_joint_and_six(dimensions):
    """4 R + 2 P + 6 with both end frames free (Mooring, Roth, Driels 1991), else two fewer."""
    arm = SerialArm(dimensions, TOLERANCES)
    assert len(arm.parameters) == 4 * arm.joints + 6
    assert observed_rank(arm, True, np.random.default_rng(10)) == 4 * arm.joints + 6
    assert observed_rank(arm, False, np.random.default_rng(10)) == 4 * arm.joints + 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"links": ()}, "links: none is not allowed"),
        ({"home": np.zeros(5)}, r"home_deg: \[0, .*\] is not allowed; 6 finite numbers"),
        ({"tool": np.array([0.0, np.nan, 0.0])}, r"tool_mm: \[0, nan, 0\] is not .*; 3 finite"),
        ({"links": (replace(UR10.links[0], parallel=True),)}, r"links\[0\].parallel: True is not"),
    ],
)
def test_impossible_arms_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        replace(UR10, **change)


def test_planar_arm_of_three_joints_is_commanded_by_x_and_y():
    """One joint more than needed: x and y are reached with hardly more than the least change."""
    arm = SerialArm(PLANAR, TOLERANCES)
    assert arm.freedoms == (0, 1)
    g, home = arm.parameters.nominal, arm.home[None]
    x = arm.forward(home, g)
    assert arm.condition(home, x, g)[0] < 10
    step = np.array([[1e-5, -2e-5]])
    slope = arm.velocity_jacobian(home, x, g)[0, :2]
    found = arm.inverse(x[:, :2] + step, g, home)
    np.testing.assert_allclose(arm.forward(found, g)[:, :2], x[:, :2] + step, atol=1e-12)
    least = np.linalg.norm(step @ np.linalg.pinv(slope).T)
    assert np.linalg.norm(found - home) < 1.1 * least


def test_planar_arm_in_a_level_direction_is_refused():
    """Of an upright plane, x and y determine no place."""
    upright = replace(PLANAR.links[0], twist=np.pi / 2)
    with pytest.raises(ConfigError, match=r"links\[0\].twist_deg: 90 is not .* turn the base"):
        replace(PLANAR, links=(upright, *PLANAR.links[1:]))


@pytest.mark.parametrize(
    ("rate", "acceleration", "payload"),
    [
        ([0.0, 0.0], [1.0, 0.0], 0.0),
        ([0.0, 0.0], [0.0, 1.0], 0.0),
        ([1.0, 0.0], [0.0, 0.0], 0.0),
        ([0.0, 1.0], [0.0, 0.0], 0.0),
        ([1.0, -2.0], [2.0, 3.0], 2.0),
    ],
)
def test_torques_of_inertia_are_those_of_two_rods_in_a_plane(rate, acceleration, payload) -> None:
    """Equations of motion of a two-link arm (Craig, Introduction to Robotics, section 6.7)."""
    robot = load_robot("scara")
    arm, at = robot.model(), np.array([[0.3, 1.5]])
    g = arm.parameters.nominal
    upper, fore, reach = 8.0, 5.0, 0.5  # [kg], [kg], [m] of both
    own = fore * reach**2 / 3 + payload * reach**2  # about the elbow
    first = fore * reach / 2 + payload * reach
    shoulder = upper * reach**2 / 3 + (fore + payload) * reach**2
    even, odd = reach * first * np.cos(1.5), reach * first * np.sin(1.5)
    mass = np.array([[shoulder + own + 2 * even, own + even], [own + even, own]])
    whirl = odd * np.array([-rate[1] * (2 * rate[0] + rate[1]), rate[0] ** 2])
    loads = arm.loads(
        robot.masses,
        OF_INERTIA,
        at,
        arm.forward(at, g),
        g,
        np.array([rate]),
        np.array([acceleration]),
        np.array([payload]),
        np.zeros((1, 3)),
    )
    assert loads.inertia[0] == pytest.approx(mass @ acceleration + whirl, rel=1e-4, abs=1e-6)


def test_a_reflector_off_its_place_is_told_with_the_tool_that_would_look_alike() -> None:
    """Ten times its prior off: the fit gives half of it to the tool, out of tolerance then."""
    plain = load_robot("ur10")
    arm = replace(plain, tolerances=replace(plain.tolerances, tool=3e-4))
    near = replace(arm, tracker=replace(arm.tracker, reflector_offset_prior=3e-4))
    off = np.array([3e-3, -2e-3, 4e-3])
    away = replace(near, tracker=replace(near.tracker, reflector_offset=off))
    plan = replace(make_plan("identify", arm, count=60, seed=7), paths=())
    session = simulate_session(draw_machine(away, 7), plan, 7)
    found = diagnose(survey(session, arm.joints.names), near)
    (said,) = found.verdict.findings
    assert said.cause == "smr_offset"
    assert "tool_position" in said.equivalents
    assert said.separated_by
    for value, true in zip(said.parameters.values(), off, strict=True):
        assert abs(value.value - true) < 3.5 * value.std
    told = [value.value for value in said.parameters.values()]
    shipped = found.model.theta[found.model.layout.offset]
    np.testing.assert_allclose(shipped, told, atol=1e-6)
