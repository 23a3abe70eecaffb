"""Every registered mechanism: closure, derivatives, inverse kinematics, reach, singularities."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from closures_by_hand import BY_HAND
from delta_calibration.errors import ReachError
from delta_calibration.mechanisms import MECHANISMS, RotaryDelta, SixRodDelta
from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
from machines import MODELS, complex_step, differences, machine, places

SRBD = DeltaDimensions(0.2, 0.055, 0.32, 0.85, 0.04)
TOLERANCES = DeltaTolerances(0.25e-3, 0.15e-3, 0.2e-3, 0.1e-3, 0.8e-3, 0.5e-3, 0.05e-3, 1e-3)


DELTAS = ("rotary_delta", "six_rod_delta")


@pytest.fixture(params=MODELS)
def mechanism(request):
    return MODELS[request.param]


@pytest.fixture
def by_hand(mechanism):
    """Independent closure in numpy, a function of joints, pose and geometry."""
    return partial(BY_HAND[mechanism.name], mechanism)


def test_every_registered_mechanism_is_among_them():
    assert {model.name for model in MODELS.values()} == set(MECHANISMS)


@pytest.fixture(params=DELTAS)
def delta(request):
    return MECHANISMS[request.param](SRBD, TOLERANCES)


def joints_in_workspace(rng, n):
    """Joint angles of a Delta, (n, 3) [rad]."""
    return rng.uniform(-0.3, 1.2, (n, 3))


def test_forward_meets_the_closure(mechanism):
    rng = np.random.default_rng(1)
    g = machine(mechanism, rng)
    q, x = places(mechanism, g, rng, 50)
    assert np.isfinite(x).all()
    assert np.abs(mechanism.closure(q, x, g)).max() < 1e-12


def test_inverse_undoes_forward(mechanism):
    rng = np.random.default_rng(2)
    g = machine(mechanism, rng)
    q, x = places(mechanism, g, rng, 50)
    back = mechanism.inverse(x[:, : mechanism.task_size], g)
    assert np.abs(back - q).max() < 1e-11 * max(1.0, mechanism.joint_size)


def test_the_platform_hangs_under_the_base(delta):
    rng = np.random.default_rng(1)
    g, q = machine(delta, rng), joints_in_workspace(rng, 50)
    x = delta.forward(q, g)
    assert np.abs(delta.closure(q, x, g)).max() < 1e-14
    assert (x[:, 2] < -0.2).all()
    assert np.abs(delta.inverse(x[:, :3], g) - q).max() < 1e-11


def test_closure_derivatives_against_complex_step(mechanism, by_hand):
    """Derivatives of the closure by hand; differences for an arm (rotations of scipy)."""
    rng = np.random.default_rng(3)
    g = machine(mechanism, rng)
    q, x = places(mechanism, g, rng, 7)
    x = x + 0.01 * rng.standard_normal(x.shape)
    slope, off = (differences, 2e-9) if mechanism.name == "serial_arm" else (complex_step, 1e-13)
    np.testing.assert_allclose(mechanism.closure(q, x, g), by_hand(q, x, g), atol=1e-13)
    for generated, exact in (
        (mechanism.closure_by_pose, slope(lambda v: by_hand(q, v, g), x)),
        (mechanism.closure_by_joints, slope(lambda v: by_hand(v, x, g), q)),
        (mechanism.closure_by_geometry, slope(lambda v: by_hand(q, x, v), g)),
    ):
        np.testing.assert_allclose(generated(q, x, g), exact, atol=off)


def test_jacobians_are_slopes_of_the_direct_problem(mechanism):
    rng = np.random.default_rng(4)
    g = machine(mechanism, rng)
    q, x = places(mechanism, g, rng, 5)
    h = 1e-6 * mechanism.joint_size
    by_joints = mechanism.velocity_jacobian(q, x, g)
    for k in range(mechanism.joints):
        d = h * np.eye(mechanism.joints)[k]
        slope = (mechanism.forward(q + d, g) - mechanism.forward(q - d, g)) / (2 * h)
        np.testing.assert_allclose(by_joints[..., k], slope, atol=1e-8)
    by_geometry, h = mechanism.identification_jacobian(q, x, g), 1e-6
    for k in range(len(g)):
        d = h * np.eye(len(g))[k]
        slope = (mechanism.forward(q, g + d) - mechanism.forward(q, g - d)) / (2 * h)
        size = np.abs(slope).max() + 1.0
        np.testing.assert_allclose(by_geometry[..., k], slope, atol=2e-7 * size)


def test_geometry_may_change_from_sample_to_sample(mechanism):
    rng = np.random.default_rng(5)
    each = np.stack([machine(mechanism, rng) for _ in range(4)])
    q, together = places(mechanism, each, rng, 4)
    jacobians = mechanism.identification_jacobian(q, together, each)
    for k in range(len(q)):
        alone = mechanism.forward(q[k : k + 1], each[k])
        np.testing.assert_allclose(together[k : k + 1], alone, atol=1e-13)
        own = mechanism.identification_jacobian(q[k : k + 1], alone, each[k])
        size = np.abs(own).max()
        np.testing.assert_allclose(jacobians[k : k + 1], own, atol=1e-10 * size)
        back = mechanism.inverse(alone[:, : mechanism.task_size], each[k])
        np.testing.assert_allclose(back[0], q[k], atol=1e-11 * max(1.0, mechanism.joint_size))


def test_out_of_reach_is_nan_alone_and_refused_by_name(delta):
    mechanism = delta
    g = mechanism.parameters.nominal
    targets = np.array([[0.0, 0.0, -0.711], [2.0, 0.0, -0.711], [0.1, 0.1, -0.8]])
    q = mechanism.inverse(targets, g)
    assert np.isfinite(q[[0, 2]]).all()
    assert np.isnan(q[1]).all()
    with pytest.raises(ReachError, match=r"target 2 \(2, 0, -0.711 m\) is out of the robot's"):
        mechanism.require_reach(q, targets, "target", "m")


def test_condition_grows_at_a_singularity(delta):
    """Below home the legs stretch until no joint can lower the platform any further."""
    mechanism = delta
    g = mechanism.parameters.nominal
    deepest = -np.sqrt((0.32 + 0.85) ** 2 - 0.145**2)  # arm and forearm are in line
    targets = np.array(
        [[0.0, 0.0, -0.711], [0.0, 0.0, deepest + 1e-7], [0.0, 0.0, deepest - 1e-6]]
    )
    q = mechanism.inverse(targets[:2], g)
    assert np.isnan(mechanism.inverse(targets[2:], g)).all()
    condition = mechanism.condition(q, mechanism.forward(q, g), g)
    assert condition[0] < 3
    assert condition[1] > 1e3


def test_home_and_line_of_the_paper_on_the_drawing():
    """Arms level at z = -711 mm; on the line the joints go from -24 to +94 degrees."""
    delta = RotaryDelta(SRBD, TOLERANCES)
    g = delta.parameters.nominal
    home = delta.forward(np.zeros((1, 3)), g)
    np.testing.assert_allclose(home, [[0, 0, -np.sqrt(0.85**2 - 0.465**2)]], atol=1e-12)
    assert abs(home[0, 2] + 0.711) < 1e-3  # the paper rounds to millimetres
    x = np.linspace(-0.45, 0.45, 181)
    line = np.stack([x, -x, np.full_like(x, -0.711)], axis=1)
    q = np.degrees(delta.inverse(line, g))
    assert np.isfinite(q).all()
    assert round(q.min()) == -24
    assert round(q.max()) == 94


def test_arms_point_outward_in_every_quadrant():
    """The elbow is outside the line from hinge to platform joint, all around the disc."""
    delta = RotaryDelta(SRBD, TOLERANCES)
    g = delta.parameters.nominal
    turn = np.linspace(0, 2 * np.pi, 73)
    targets = np.stack([0.4 * np.cos(turn), 0.4 * np.sin(turn), np.full_like(turn, -0.75)], axis=1)
    q = delta.inverse(targets, g)
    for leg in range(3):
        eta = 2 * np.pi * leg / 3
        out = np.array([np.cos(eta), np.sin(eta), 0])
        radial, depth = targets @ out - 0.145, -targets[:, 2]  # platform joint minus hinge
        across = np.sin(q[:, leg]) * radial - np.cos(q[:, leg]) * depth
        assert (across < 0).all()  # the elbow is outside and above the line


def test_six_equal_rods_are_three_spheres():
    rng = np.random.default_rng(6)
    six, three = SixRodDelta(SRBD, TOLERANCES), RotaryDelta(SRBD, TOLERANCES)
    q = joints_in_workspace(rng, 20)
    x = six.forward(q, six.parameters.nominal)
    np.testing.assert_allclose(x[:, :3], three.forward(q, three.parameters.nominal), atol=1e-13)
    np.testing.assert_allclose(x[:, 3:], 0, atol=1e-12)


def test_unequal_rods_tilt_by_mismatch_over_width():
    """A pair of rods that differ by m over a width b tilts the platform by about m / b."""
    six = SixRodDelta(SRBD, TOLERANCES)
    g = six.parameters.nominal
    g[six.parameters.row("rod_mismatch_1")] = 0.1e-3
    x = six.forward(np.zeros((1, 3)), g)
    tilt = np.linalg.norm(x[0, 3:])
    assert 0.5e-3 < tilt < 2.5e-3


def rank(jacobian):
    matrix = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(matrix, axis=0)
    values = np.linalg.svd(matrix / np.where(norms > 0, norms, 1), compute_uv=False)
    assert not (
        (values > 1e-11 * values[0]) & (values < 1e-6 * values[0])
    ).any()  # no singular values in between
    return int((values > 1e-9 * values[0]).sum())


def rigid_motion(points):
    """Derivative of T p with respect to the six coordinates of T at identity, (n, 3, 6)."""
    columns = [np.cross(np.eye(3)[k], points) for k in range(3)]
    return np.concatenate(
        [np.stack(columns, -1), np.broadcast_to(np.eye(3), (len(points), 3, 3))], -1
    )


def test_identifiable_combinations():
    """Three spheres: 24 (18 with a free frame). Six rods: 36 from poses, 33 from positions.

    With lines at the elbows that turn with the arms: 42 and 38.
    """
    rng = np.random.default_rng(7)
    q = joints_in_workspace(rng, 120)
    three, six = RotaryDelta(SRBD, TOLERANCES), SixRodDelta(SRBD, TOLERANCES)
    g3, g6 = three.parameters.nominal, six.parameters.nominal
    x3, x6 = three.forward(q, g3), six.forward(q, g6)
    j3, j6 = three.identification_jacobian(q, x3, g3), six.identification_jacobian(q, x6, g6)
    assert rank(j3) == 24
    frame = rigid_motion(x3)
    assert rank(np.concatenate([j3, frame], -1)) == 24  # the frame is in their span
    assert rank(np.concatenate([j3, frame], -1)) - rank(frame) == 18
    turning = np.array(["elbow_line_on_arm" in name for name in six.parameters.names])
    papers = j6[..., ~turning]
    assert (len(g6), papers.shape[-1]) == (66, 60)
    assert (rank(papers), rank(papers[:, :3])) == (36, 33)
    assert (rank(j6), rank(j6[:, :3])) == (42, 38)
