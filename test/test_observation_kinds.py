"""Camera images and closures as observations: derivatives, recovery, unidentifiable parameters."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from cables import EIGHT_CABLES, FOUR_CABLES, ZEROS_FREE, built, geometry_of, workspace
from closures_by_hand import BY_HAND
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation.closures import ClosureWithoutPose
from delta_calibration.estimation.encoder_closures import EncoderClosure
from delta_calibration.estimation.image import PointInImage
from delta_calibration.estimation.measurements import (
    DistanceBetween,
    PlacedMachine,
    PointMeasured,
)
from delta_calibration.estimation.mixed_measurements import fit_observations
from delta_calibration.geometry import Camera, Frame, rotations
from delta_calibration.mechanisms.base import Limb, Mechanism
from delta_calibration.mechanisms.cable_dimensions import CableTolerances
from delta_calibration.mechanisms.cable_robot import CableRobot
from delta_calibration.mechanisms.linear_delta import LinearDelta
from delta_calibration.model.symbols import column, norm
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import load_robot
from machines import complex_step

SCARA = load_robot("scara").model()
PRINTER = load_robot("linear_delta").model()
CAMERA = Camera(focal=np.array([2400.0, 2380.0]), centre=np.array([1010.0, 770.0]))
LOOKS_DOWN = Frame.from_vector(np.array([3.0, 0.2, 0.1, -0.5, 0.6, 1.7]))  # T_camera_base
MARK = np.array([0.01, -0.02, 0.03])
TOLERANCES = CableTolerances(10e-3, 2e-3, 0.5e-2)


def scara_built(rng):
    p = SCARA.parameters
    return PlacedMachine.of(SCARA, p.nominal + p.prior * rng.standard_normal(len(p)), LOOKS_DOWN)


def pixels_of(q, g, turn, place):
    """Independent projection: the arm link by link, a rigid motion and two quotients."""
    mark, held = walked(q, g)
    x, y, z = np.moveaxis((mark + held @ MARK) @ turn.T + place, 1, 0)
    return np.stack([2400.0 * x / z + 1010.0, 2380.0 * y / z + 770.0], axis=1)


def walked(q, g):
    """Position (n, 3) and rotation (n, 3, 3) of the tool of the SCARA, also for complex g."""
    value = dict(zip(SCARA.parameters.names, g, strict=True))
    x, y, z = np.eye(3)
    place, turn = np.zeros(3), np.eye(3)
    for i, link in enumerate(SCARA.dimensions.links, 1):
        turn = turn @ rotations.exp(value[f"twist_{i}"] * x)
        if link.parallel:
            turn = turn @ rotations.exp(value[f"skew_{i}"] * y)
        place = place + turn @ (value[f"length_{i}"] * x)
        turn = turn @ rotations.exp((q[:, i - 1, None] + value[f"zero_{i}"]) * z)
        offset = link.offset if link.parallel else value[f"offset_{i}"]
        place = place + turn @ (offset * z)
    place = place + turn @ np.array([value[f"tool_{axis}"] for axis in "xyz"])
    turn = turn @ Rotation.from_euler("ZYX", SCARA.dimensions.mount).as_matrix()
    for axis, letter in zip(np.eye(3), "xyz", strict=True):
        turn = turn @ rotations.exp(value[f"tool_turn_{letter}"] * axis)
    return place, turn


def seen(machine, q, noise=1e-3, rng=None):
    pixel = pixels_of(q, machine.geometry, machine.frame.rotation, machine.frame.translation)
    if rng is not None:
        pixel = pixel + noise * rng.standard_normal(pixel.shape)
    return PointInImage(q, pixel, MARK, CAMERA, noise)


# --- images


def without_offset(slope):
    """Insert zero columns for the reflector; the place of the mark on the platform is given."""
    nothing = np.zeros((*slope.shape[:-1], 3))
    return np.concatenate([slope[..., :-6], nothing, slope[..., -6:]], axis=-1)


def test_image_slopes_by_complex_step():
    rng = np.random.default_rng(1)
    machine, q = scara_built(rng), rng.uniform(0.2, 1.2, (5, 2))
    image = seen(machine, q)
    assert np.abs(image.missed(machine)).max() < 1e-9

    def pixels(unknowns):
        turn = rotations.exp(unknowns[-6:-3])
        return pixels_of(q, unknowns[:-6], turn, unknowns[-3:])

    unknowns = np.append(machine.geometry, machine.frame.vector())
    expected = without_offset(complex_step(pixels, unknowns))
    np.testing.assert_allclose(image.slopes(machine), expected, rtol=1e-9, atol=1e-7)
    given = replace(image, place=machine.frame)
    elsewhere = PlacedMachine.of(SCARA, machine.geometry, Frame.identity())
    expected[..., -6:] = 0.0
    np.testing.assert_allclose(given.slopes(elsewhere), expected, rtol=1e-9, atol=1e-7)


def test_a_camera_of_known_place_measures_the_links():
    """With 0.1 px (a pixel is 0.7 mm), lengths of 0.5 m are found to a few hundredths of a mm."""
    rng = np.random.default_rng(2)
    machine, q = scara_built(rng), rng.uniform(-1.4, 1.4, (80, 2))
    fit = fit_observations(SCARA, [replace(seen(machine, q, 0.1, rng), place=LOOKS_DOWN)])
    assert fit.names == SCARA.parameters.names
    assert fit.unset == ()
    assert fit.chi_square == pytest.approx(1.0, abs=0.2)
    off = (fit.machine.geometry - machine.geometry) / fit.std
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.5
    row = SCARA.parameters.row("length_2")
    assert fit.std[row] < 0.15 * SCARA.parameters.prior[row]


def test_an_image_alone_has_no_scale():
    """A machine twice as large and twice as far away gives the same image; a distance does not."""
    rng = np.random.default_rng(3)
    machine, q = scara_built(rng), rng.uniform(-1.4, 1.4, (80, 2))
    image = seen(machine, q)
    at_tool = PointInImage(q, image.pixel, np.zeros(3), CAMERA, 1e-3)
    slopes = at_tool.slopes(machine).reshape(2 * len(q), -1)
    twice = np.where([p.unit == "m" for p in SCARA.parameters], machine.geometry, 0.0)
    twice = np.concatenate([twice, np.zeros(6), machine.frame.translation])
    assert np.abs(slopes @ twice).max() < 1e-9 * np.abs(slopes).max()
    drawn = PlacedMachine.of(SCARA, SCARA.parameters.nominal, LOOKS_DOWN)
    alone = fit_observations(SCARA, [image], drawn.frame, priors=False)
    assert {"length_2", "tool_x", "device_place_z"} <= set(alone.unset)
    assert np.isinf(alone.std[alone.names.index("length_2")])
    other = rng.uniform(-1.4, 1.4, (80, 2))
    x, y = (machine.chain.mechanism.forward(each, machine.geometry) for each in (q, other))
    apart = np.linalg.norm((y - x)[:, :3], axis=1)
    both = fit_observations(
        SCARA, [image, DistanceBetween(q, other, apart, 1e-5)], drawn.frame, priors=False
    )
    assert both.observability.rank > alone.observability.rank
    assert "length_2" not in both.unset
    row = SCARA.parameters.row("length_2")
    assert both.machine.geometry[row] == pytest.approx(machine.geometry[row], abs=2e-5)


def test_a_mark_behind_the_camera_and_two_devices_are_refused():
    q = np.full((3, 2), 0.5)
    machine = PlacedMachine.of(SCARA, SCARA.parameters.nominal, LOOKS_DOWN)
    image = seen(machine, q)
    with pytest.raises(DataError, match=r"image: number 1 cannot be seen .* camera .* behind it"):
        fit_observations(SCARA, [image], Frame(np.eye(3), np.array([0.0, 0.0, -1.0])))
    point = PointMeasured(q, np.zeros((3, 3)), np.zeros(3), 1e-5)
    with pytest.raises(InputError, match="camera and tracker at unknown places"):
        fit_observations(SCARA, [image, point], LOOKS_DOWN)
    with pytest.raises(InputError, match="frame: none is not allowed with a camera"):
        fit_observations(SCARA, [image])
    with pytest.raises(InputError, match=r"image: pixel \(3, 3\) is not allowed; \(3, 2\)"):
        PointInImage(q, np.zeros((3, 3)), MARK, CAMERA, 0.1)
    with pytest.raises(InputError, match=r"camera: focal \[0. 1.\] is not allowed; above 0 px"):
        Camera(np.array([0.0, 1.0]), np.zeros(2))


# --- closure only


def closing(dimensions, seed, n, noise=1e-3, tolerances=TOLERANCES):
    """Simulate a robot with errors of its dimensions at n poses; only the motors are read."""
    rng = np.random.default_rng(seed)
    robot, real = CableRobot(dimensions, tolerances), built(dimensions, rng)
    motors = real.motors(workspace(dimensions, n, rng))
    read = motors + noise * rng.standard_normal(motors.shape)
    return robot, real, EncoderClosure.of(robot, read, noise)


def test_closing_slopes_by_complex_step():
    """The normal matrix agrees with one from scipy's null space and derivatives of the closure."""
    robot, real, _ = closing(EIGHT_CABLES, 4, 1)
    rng = np.random.default_rng(5)
    q = real.motors(workspace(EIGHT_CABLES, 3, rng))
    machine = PlacedMachine.of(robot, geometry_of(real), Frame.identity())
    held = EncoderClosure.of(robot, q, 1e-3)
    assert held.redundancy == 2
    assert np.abs(held.missed(machine)).max() < 1e-9
    slopes = held.slopes(machine)
    g = machine.geometry
    x = machine.chain.mechanism.forward(q, g)
    closure = partial(BY_HAND["cable_robot"], robot)
    for k in range(len(q)):
        row = slice(k, k + 1)
        by_pose = complex_step(lambda v, r=row: closure(q[r], v[None], g)[0], x[k])
        by_joints = complex_step(lambda v, r=row: closure(v[None], x[r], g)[0], q[k])
        by_geometry = complex_step(lambda v, r=row: closure(q[r], x[r], v)[0], g)
        free = null_space(by_pose.T)
        entered, moved = free.T @ by_joints, free.T @ by_geometry
        expected = moved.T @ np.linalg.solve(entered @ entered.T, moved)
        found = slopes[k, :, : len(g)].T @ slopes[k, :, : len(g)]
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * expected.max())
        assert not slopes[k, :, len(g) :].any()


def test_closing_is_missed_by_chance_alone():
    """For the true machine the residuals are independent, with the noise of the joints."""
    robot, real, held = closing(EIGHT_CABLES, 6, 400)
    missed = held.missed(PlacedMachine.of(robot, geometry_of(real), Frame.identity())) / held.sigma
    assert missed.shape == (400, 2)
    covariance = missed.T @ missed / 400
    np.testing.assert_allclose(covariance, np.eye(2), atol=0.2)


@pytest.mark.parametrize(
    ("dimensions", "tolerances", "rank"),
    [
        (EIGHT_CABLES, TOLERANCES, 7 * 8 - 7),  # minus rigid motion (6) and size (1)
        (EIGHT_CABLES, ZEROS_FREE, 8 * 8 - 13),  # minus the pose of the zeros (6) as well
        (FOUR_CABLES, TOLERANCES, 4 * 4 - 4),  # a point: minus rotation (3) and size (1)
    ],
)
def test_what_closure_alone_tells(dimensions, tolerances, rank):
    """Position and size of the whole machine are not identifiable, and the fit reports that."""
    robot, _, held = closing(dimensions, 7, 100, tolerances=tolerances)
    fit = fit_observations(robot, [held])
    assert fit.observability.rank == rank
    assert len(fit.observability.redundancies) == len(fit.names) - rank
    assert fit.chi_square == pytest.approx(1.0, abs=0.35)
    assert not any("device" in name for name in fit.names)
    alone = fit_observations(robot, [held], priors=False)
    assert len(alone.unset) > len(alone.names) - rank
    loose = np.isin(alone.names, alone.unset)
    assert np.isinf(alone.std[loose]).all()
    assert np.isfinite(alone.std[~loose]).all()


def test_closure_alone_finds_the_shape_not_the_size():
    """Ratios of distances between anchors are found; their common size stays that of the prior."""
    robot, real, held = closing(EIGHT_CABLES, 8, 150)
    fit = fit_observations(robot, [held])

    def apart(g):
        anchors = g.reshape(8, -1)[:, :3]
        return np.linalg.norm(anchors[:, None] - anchors[None], axis=2)[np.triu_indices(8, 1)]

    true, found = apart(geometry_of(real)), apart(fit.machine.geometry)
    drawn = apart(robot.parameters.nominal)

    def shape_off(lengths):
        ratio = lengths / true
        return np.std(ratio / ratio.mean())

    assert shape_off(found) < 0.15 * shape_off(drawn)
    unseen = workspace(EIGHT_CABLES, 40, np.random.default_rng(9))
    fresh = EncoderClosure.of(robot, real.motors(unseen), 1e-3)
    nominal = PlacedMachine.of(robot, robot.parameters.nominal, Frame.identity())
    off, before = fresh.missed(fit.machine), fresh.missed(nominal)
    assert np.abs(off).max() < 0.02 * np.abs(before).max()


def test_a_distance_beside_closure_sets_the_size():
    """A machine that is 0.5 % larger in all dimensions satisfies the closures equally well.

    The distances are those of the centre, so they determine four more combinations: the size, and
    which point of the platform is the centre.
    """
    rng = np.random.default_rng(10)
    robot, real = CableRobot(EIGHT_CABLES, TOLERANCES), built(EIGHT_CABLES, rng)
    poses, home = workspace(EIGHT_CABLES, 100, rng), real.home[:3]
    large = replace(
        real,
        anchors=home + 1.005 * (real.anchors - home),
        joints=1.005 * real.joints,
        gains=1.005 * real.gains,
    )
    moved = poses.copy()
    moved[:, :3] = home + 1.005 * (poses[:, :3] - home)
    np.testing.assert_allclose(large.motors(moved), real.motors(poses), atol=1e-9)
    held = EncoderClosure.of(robot, large.motors(moved), 1e-3)
    one, other = large.motors(moved[:6]), large.motors(moved[6:12])
    apart = np.linalg.norm(moved[6:12, :3] - moved[:6, :3], axis=1)
    bar = DistanceBetween(one, other, apart, 50e-6)
    alone, both = (fit_observations(robot, o) for o in ([held], [held, bar]))
    assert (alone.observability.rank, both.observability.rank) == (49, 49 + 4)
    off = [f.machine.geometry.reshape(8, -1)[:, -1] / large.gains - 1 for f in (alone, both)]
    assert np.abs(off[1].mean()) < 3e-4 < 0.002 < np.abs(off[0].mean())


class StringGauged(Mechanism):
    """A linear Delta with a string to its platform, whose encoder drives nothing."""

    name = "string_gauged"
    joints, pose_size, task_size = 4, 3, 3
    parameters = PRINTER.parameters + ParameterSet(
        tuple(Parameter(f"string_{a}", "m", 0.4, 5e-3, "base_joint_position") for a in "xyz")
    )

    def __init__(self):
        pass

    @property
    def home(self):
        return np.append(PRINTER.home, 0.5)

    limbs = (Limb((0, 1, 2, 3), tuple(range(13)), (0, 1, 2, 3)),)

    @staticmethod
    def equation(q, x, g, c):
        towers = (LinearDelta.equation(q[i], x, tower(g, i), c) for i in range(3))
        return column(*towers, norm(x - g[10:13]) - q[3])

    @staticmethod
    def opening(q, g, c):
        towers = [tower(g[0], i) for i in range(3)]
        return LinearDelta.opening([q[0][i] for i in range(3)], towers, c)


def tower(g, i):
    """Dimensions of tower i in the form of the linear Delta, symbolic."""
    return column(g[0], g[1 + i], g[4 + i], g[7 + i], 0, 0)  # it does not lean


def test_the_string_is_one_more_closure():
    """The closure and its derivatives agree with those by hand and with the linear Delta."""
    printer, rng = StringGauged(), np.random.default_rng(11)
    g = printer.parameters.nominal + 1e-3 * rng.standard_normal(13)
    q = printer.home + 0.02 * rng.standard_normal((5, 4))
    x = PRINTER.forward(q[:, :3], g[:-3])

    def by_hand(q, x, g):
        rest = BY_HAND["linear_delta"](PRINTER, q[:, :3], x, g[..., :-3])
        string = np.sqrt(np.sum((x - g[..., -3:]) ** 2, axis=-1)) - q[:, 3]
        return np.concatenate([rest, string[:, None]], axis=1)

    np.testing.assert_allclose(printer.start(q, g), x, atol=1e-14)
    np.testing.assert_allclose(printer.closure(q, x, g), by_hand(q, x, g), atol=1e-14)
    for generated, function, at in (
        (printer.closure_by_pose, lambda v: by_hand(q, v, g), x),
        (printer.closure_by_joints, lambda v: by_hand(v, x, g), q),
        (printer.closure_by_geometry, lambda v: by_hand(q, x, v), np.tile(g, (5, 1))),
    ):
        exact = complex_step(function, at)
        np.testing.assert_allclose(generated(q, x, g), exact, atol=1e-13)


def test_an_encoder_on_a_passive_joint_calibrates():
    """No pose is measured; the length of the string has to agree with the three carriages."""
    printer = StringGauged()
    p, rng = printer.parameters, np.random.default_rng(12)
    g = p.nominal + p.prior * rng.standard_normal(len(p))
    low, high = load_robot("linear_delta").joints.lower, load_robot("linear_delta").joints.upper
    carriages = low + (high - low) * rng.uniform(0.35, 0.6, (200, 3))
    x = PRINTER.forward(carriages, g[:-3])
    q = np.column_stack([carriages, np.linalg.norm(x - g[-3:], axis=1)])
    assert np.isfinite(q).all()
    read = q + 10e-6 * rng.standard_normal(q.shape)
    fit = fit_observations(printer, [EncoderClosure.of(printer, read, 10e-6)])
    assert fit.chi_square == pytest.approx(1.0, abs=0.3)
    assert fit.observability.rank < len(p)
    off = (fit.machine.geometry - g) / fit.std
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.5
    told = fit.std < 0.5 * p.prior
    assert told.sum() >= 5


@pytest.mark.parametrize(("tackle", "alike"), [((1, 1, 1, 1), True), ((1, 1, 1, 4), False)])
def test_noise_of_encoders_and_of_closures_weigh_alike_only_if_drums_are_alike(tackle, alike):
    """Both kinds of closure without a pose are equal if all joints have the same slope."""
    drawing = replace(FOUR_CABLES, tackle=np.array(tackle, dtype=float))
    robot, _, seen = closing(drawing, 9, 40)
    machine = PlacedMachine.of(robot, robot.parameters.nominal, Frame.identity())
    other = ClosureWithoutPose(seen.joint, seen.redundancy, seen.noise)
    ratio = np.abs(other.missed(machine) / seen.missed(machine))[:, 0]
    slope = drawing.gain[0]
    if alike:
        np.testing.assert_allclose(ratio, slope, rtol=0.02)
    else:
        assert np.ptp(ratio) > 0.2 * slope


def test_closure_of_what_is_not_redundant_is_refused():
    with pytest.raises(InputError, match="linear_delta has 3 closures for 3 coordinates"):
        EncoderClosure.of(PRINTER, np.full((4, 3), 0.35), 1e-5)
    robot = CableRobot(EIGHT_CABLES, TOLERANCES)
    with pytest.raises(InputError, match=r"none: joint \(2, 8\) is not allowed; \(2, 8\), finite"):
        EncoderClosure.of(robot, np.full((2, 8), np.nan), 1e-3)


def test_pixels_by_another_pinhole():
    """The pixel follows from the angle to the axis: r = f tan(angle)."""
    camera = Camera(np.array([900.0, 900.0]), np.array([640.0, 480.0]))
    point = 2.5 * Rotation.from_rotvec(np.array([0.3, -0.2, 0.1])).apply([0.0, 0.0, 1.0])
    away = camera.image(point[None])[0] - camera.centre
    assert np.hypot(*away) == pytest.approx(900.0 * np.tan(np.arccos(point[2] / 2.5)))
    ray = camera.rays(camera.image(point[None]))[0]
    np.testing.assert_allclose(np.cross(ray, point), 0.0, atol=1e-12)
    assert np.isnan(camera.image(-point[None])).all()
