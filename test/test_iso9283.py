from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.iso9283 import (
    DELTA_PAPER,
    PLANES,
    STANDARD,
    Conditions,
    Cube,
    direction_variation,
    distance_accuracy,
    distance_repeatability,
    path_accuracy,
    path_deviations,
    path_repeatability,
    position_accuracy,
    position_repeatability,
)

Array = NDArray[np.float64]

FEW = Conditions("few", position_cycles=2, distance_cycles=2, path_cycles=2, stations=5)
LINE = np.array([[0.0, 0, 0], [1, 0, 0]])
CUBE = Cube(centre=(0.1, 0.2, -0.7), side=0.4)


def rigidly_moved(x: Array) -> Array:
    """Rotate by 0.7 rad about (1, 2, 2)/3 (Rodrigues) and shift."""
    k = np.array([1.0, 2.0, 2.0]) / 3.0
    turned = x * np.cos(0.7) + np.cross(k, x) * np.sin(0.7)
    turned = turned + np.multiply.outer(x @ k, k) * (1 - np.cos(0.7))
    return turned + np.array([0.3, -0.2, 1.1])


# Positions: four attempts with barycentre (1, 2, 2) and radii 3, 3, 5, 5. Mean l = 4,
# S_l = sqrt((1 + 1 + 1 + 1) / 3) = sqrt(4/3) = 1.154700538
ATTEMPTS = np.array([[4.0, 2, 2], [-2, 2, 2], [1, 7, 2], [1, -3, 2]])


def test_position_accuracy_by_hand() -> None:
    # (1, 2, 2) minus the commanded origin: sqrt(1 + 4 + 4) = 3
    result = position_accuracy(ATTEMPTS, [0.0, 0, 0], FEW)
    assert result.value == pytest.approx(3.0, abs=1e-12)
    np.testing.assert_allclose(result.offset, [1, 2, 2], atol=1e-12)
    assert (result.symbol, result.cycles, result.conditions) == ("AP", 4, FEW)


def test_position_repeatability_by_hand() -> None:
    result = position_repeatability(ATTEMPTS, FEW)
    assert result.mean_radius == pytest.approx(4.0, abs=1e-12)
    assert result.radius_std == pytest.approx(1.154700538, abs=1e-9)
    assert result.value == pytest.approx(4.0 + 3 * 1.154700538, abs=1e-8)


def test_repeatability_is_of_radii_not_of_coordinates() -> None:
    # All attempts are on one sphere about their barycentre. All radii are 1:
    # S_l = 0 and RP = 1.
    corners = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    assert position_repeatability(corners, FEW).value == pytest.approx(1.0, abs=1e-12)


def test_several_poses_at_once_equal_each_alone() -> None:
    x = np.random.default_rng(1).normal(size=(5, 30, 3))
    commanded = np.arange(15.0).reshape(5, 3)
    ap, rp = position_accuracy(x, commanded), position_repeatability(x)
    assert ap.value.shape == rp.value.shape == (5,)
    for i in range(5):
        assert ap.value[i] == pytest.approx(float(position_accuracy(x[i], commanded[i]).value))
        assert rp.value[i] == pytest.approx(float(position_repeatability(x[i]).value))


def test_direction_variation_by_hand() -> None:
    # Barycentres (0,0,0), (3,0,0), (0,4,0): distances 3, 5, 4; the largest is 5.
    spread = np.array([[0.1, 0, 0], [-0.1, 0, 0]])
    middles = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    x = middles[:, None, :] + spread
    assert direction_variation(x, FEW).value == pytest.approx(5.0, abs=1e-12)
    assert direction_variation(np.stack([x, 2 * x]), FEW).value == pytest.approx([5.0, 10.0])


def test_distance_criteria_by_hand() -> None:
    # D = 5, 5, 6.5 from the origin; mean 5.5; commanded 5 along x: AD = +0.5.
    # S_D = sqrt((0.25 + 0.25 + 1) / 2) = sqrt(0.75) = 0.8660254; RD = 2.5980762.
    first = np.zeros((3, 3))
    second = np.array([[3.0, 4, 0], [0, 3, 4], [2.5, 6, 0]])
    commanded = [[0.0, 0, 0], [5, 0, 0]]
    ad = distance_accuracy(first, second, commanded, FEW)
    assert ad.value == pytest.approx(0.5, abs=1e-12)
    assert ad.commanded == pytest.approx(5.0)
    assert distance_repeatability(first, second, FEW).value == pytest.approx(2.5980762, abs=1e-7)
    # AD is negative if the attained distance is too short
    short = distance_accuracy(first, second, [[0.0, 0, 0], [6, 0, 0]], FEW)
    assert short.value == pytest.approx(-0.5, abs=1e-12)


def test_rigid_motion_changes_accuracy_only() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(30, 3)), rng.normal(loc=(4, 0, 0), size=(30, 3))
    a, b = rigidly_moved(first), rigidly_moved(second)
    ends = np.array([[0.0, 0, 0], [4, 0, 0]])
    assert position_repeatability(a).value == pytest.approx(position_repeatability(first).value)
    assert distance_repeatability(a, b).value == pytest.approx(
        distance_repeatability(first, second).value
    )
    assert distance_accuracy(a, b, ends).value == pytest.approx(
        distance_accuracy(first, second, ends).value
    )
    assert position_accuracy(a, ends[0]).value > 0.9  # about 3 sigma / sqrt(30) before the motion


def test_round_scatter_has_rp_of_3_62_sigma() -> None:
    # The radius l has a Maxwell distribution: mean sqrt(8/pi), standard deviation
    # sqrt(3 - 8/pi): 1.5958 + 3 * 0.6734 = 3.616
    sigma, poses, n = 2e-5, 100, 4000
    x = np.random.default_rng(3).normal(scale=sigma, size=(poses, n, 3))
    rp = np.mean(position_repeatability(x).value) / sigma
    assert rp == pytest.approx(3.616, abs=0.01)  # standard error of this mean: 0.003


def test_cycles_of_the_two_conditions() -> None:
    standard = (STANDARD.position_cycles, STANDARD.distance_cycles, STANDARD.path_cycles)
    paper = (DELTA_PAPER.position_cycles, DELTA_PAPER.distance_cycles, DELTA_PAPER.path_cycles)
    assert standard == (30, 30, 10)
    assert paper == (25, 30, 3)
    x = np.zeros((25, 3))
    assert position_accuracy(x, x[0], DELTA_PAPER).cycles == 25
    with pytest.raises(InputError, match=r"25 cycles; ISO 9283:1998 has 30"):
        position_accuracy(x, x[0])


# Paths


def along(n: int, offset: tuple[float, float, float], start: float = 0.0) -> Array:
    x = np.linspace(start, 1.0 + start, n)
    return np.stack([x, 0 * x, 0 * x], axis=1) + offset


def test_path_criteria_by_hand() -> None:
    # Two attempts parallel to the x axis at (y, z) = (3, 0) and (0, 4) mm; mean (1.5, 2) mm:
    # AT = 2.5 mm. Both are 2.5 mm from the mean: S_l = 0, RT = 2.5 mm.
    attempts = [along(7, (0, 3e-3, 0)), along(11, (0, 0, 4e-3))]
    at, rt = path_accuracy(LINE, attempts, FEW), path_repeatability(LINE, attempts, FEW)
    assert at.value == pytest.approx(2.5e-3, abs=1e-12)
    assert rt.value == pytest.approx(2.5e-3, abs=1e-12)
    assert (at.symbol, rt.symbol, at.cycles, at.profile.shape) == ("AT", "RT", 2, (5,))
    np.testing.assert_allclose(at.stations[:, 0], [0, 0.25, 0.5, 0.75, 1], atol=1e-12)


def test_path_repeatability_spread_by_hand() -> None:
    # Four attempts at y = 3, -3 and z = 1, -1 mm: barycentre 0, l = 3, 3, 1, 1 with mean 2,
    # S_l = sqrt(4 / 3) = 1.1547005; RT = 2 + 3.4641016 = 5.4641016 mm; AT = 0.
    offsets = [(0.0, 3e-3, 0.0), (0.0, -3e-3, 0.0), (0.0, 0.0, 1e-3), (0.0, 0.0, -1e-3)]
    attempts = [along(9, offset) for offset in offsets]
    assert path_repeatability(LINE, attempts, FEW).value == pytest.approx(5.4641016e-3, abs=1e-9)
    assert path_accuracy(LINE, attempts, FEW).value == pytest.approx(0.0, abs=1e-12)


def test_path_accuracy_is_the_maximum_over_stations() -> None:
    # A bow of 4 x (1 - x) mm: 1 mm at the middle station, 0.75 mm at the quarters.
    x = np.linspace(0, 1, 201)
    bow = np.stack([x, 4e-3 * x * (1 - x), 0 * x], axis=1)
    result = path_accuracy(LINE, [bow, bow], FEW)
    np.testing.assert_allclose(result.profile, [0, 0.75e-3, 1e-3, 0.75e-3, 0], atol=1e-7)
    assert result.value == pytest.approx(1e-3, abs=1e-7)


def test_path_accuracy_is_blind_to_lag_along_a_line() -> None:
    lagging = along(200, (0, 0, 0), start=-0.02)
    assert path_accuracy(LINE, [lagging] * 2, FEW).value == pytest.approx(0.0, abs=1e-12)
    # Also blind to the timing of the attempt, dwells included, but not to deviations across the
    # line
    dwelling = np.vstack([np.repeat(along(2, (0, 0, 0))[:1], 50, axis=0), along(30, (0, 0, 0))])
    assert path_accuracy(LINE, [dwelling] * 2, FEW).value == pytest.approx(0.0, abs=1e-12)
    beside = along(200, (0, 1e-3, 0), start=-0.02)
    assert path_accuracy(LINE, [beside] * 2, FEW).value == pytest.approx(1e-3, abs=1e-12)


def test_run_in_and_run_out_do_not_count() -> None:
    way_in = np.linspace([-0.8, 0.5, 0], [0, 0, 0], 40)
    way_out = np.linspace([1.0, 0, 0], [1.9, 0.4, 0], 40)
    attempt = np.vstack([way_in, along(50, (0, 0, 0)), way_out])
    result = path_accuracy(LINE, [attempt] * 2, Conditions("few", 2, 2, 2, stations=101))
    assert result.value < 0.5e-2  # half a spacing, where the run-in bends into the line
    assert np.max(result.profile[3:-3]) < 1e-12
    # A dwell at home, then no sample until a tenth of a spacing along the path
    home = np.tile([-0.8, 0.5, 0.0], (30, 1))
    late = along(400, (0, 0, 0), start=1e-3)
    attempt = np.vstack([home, late])
    result = path_accuracy(LINE, [attempt] * 2, Conditions("few", 2, 2, 2, stations=101))
    assert result.value < 1e-12


def test_noise_along_a_slow_path_does_not_pick_the_best_crossing() -> None:
    # Samples 1 um apart with 20 um of noise: many are near each station. Which of them is nearest
    # to the command must not matter: the deviation keeps the variance of the noise.
    rng = np.random.default_rng(4)
    x = np.linspace(0, 0.02, 20001)
    command = np.array([[0.0, 0, 0], [0.02, 0, 0]])
    sigma = 2e-5
    attempts = [
        np.stack([x, 0 * x, 0 * x], axis=1) + rng.normal(scale=sigma, size=(len(x), 3))
        for _ in range(8)
    ]
    _, d = path_deviations(command, attempts, Conditions("few", 2, 2, 2, stations=41))
    # interpolation between two samples averages them: 2/3 of the variance of one sample
    assert np.std(d[:, 1:-1, 1]) == pytest.approx(np.sqrt(2 / 3) * sigma, rel=0.15)


@pytest.mark.parametrize("small", [False, True])
def test_circle_of_another_radius(small: bool) -> None:
    command = CUBE.circle(stations=101, small=small)
    centre = np.asarray(CUBE.centre)
    conditions = Conditions("few", 2, 2, 2, stations=101)
    grown = centre + (CUBE.circle(stations=1001, small=small) - centre) * 1.01
    shifted = np.vstack([grown[300:-1], grown[:301]])  # starts at another place of the circle
    result = path_accuracy(command, [grown, shifted], conditions)
    radius = 0.016 if small else 0.16
    assert result.value == pytest.approx(0.01 * radius, rel=1e-3)
    assert np.min(result.profile) == pytest.approx(0.01 * radius, rel=2e-4)
    assert path_repeatability(command, [grown, shifted], conditions).value < 1e-4 * radius


def test_lag_on_a_circle_is_seen_only_as_the_smaller_circle_it_makes() -> None:
    angle = np.linspace(0, 2 * np.pi, 721)
    command = 0.16 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    late = 0.16 * np.stack([np.cos(angle - 0.05), np.sin(angle - 0.05), 0 * angle], axis=1)
    result = path_accuracy(command, [late] * 2, Conditions("few", 2, 2, 2))
    assert result.value < 1e-5  # a comparison point by point would give 8 mm


def test_path_profile_follows_a_rigid_motion() -> None:
    x = np.linspace(0, 1, 101)
    attempts = [
        np.stack([x, 1e-3 * np.sin(k + 6 * x), 1e-3 * np.cos(2 * k + 5 * x)], axis=1)
        for k in range(3)
    ]
    moved = [rigidly_moved(attempt) for attempt in attempts]
    for criterion in (path_accuracy, path_repeatability):
        here = criterion(LINE, attempts, FEW).profile
        np.testing.assert_allclose(
            criterion(rigidly_moved(LINE), moved, FEW).profile, here, atol=1e-12
        )


# The cube


@pytest.mark.parametrize("plane", PLANES)
def test_cube_poses(plane: str) -> None:
    p = CUBE.poses(plane)
    diagonal = np.sqrt(3) * 0.4
    np.testing.assert_allclose(p[0], CUBE.centre, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(p[1:] - p[0], axis=1), 0.4 * diagonal)
    assert np.linalg.norm(p[3] - p[1]) == pytest.approx(0.8 * diagonal)
    assert np.linalg.norm(p[4] - p[2]) == pytest.approx(0.8 * diagonal)
    np.testing.assert_allclose(p[1] + p[3], 2 * p[0], atol=1e-15)
    # All poses are in one plane that halves the cube and contains the direction of one edge
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    np.testing.assert_allclose((p - p[0]) @ normal, 0.0, atol=1e-15)
    tilt = np.sort(np.abs(normal / np.linalg.norm(normal)))
    assert tilt == pytest.approx([0, 0.5**0.5, 0.5**0.5])


def test_cube_corners_of_the_first_plane() -> None:
    # P2 by hand: C1 = (0.3, 0.4, -0.5), moved by a tenth of the way to C7 = (-0.1, 0.0, -0.9)
    np.testing.assert_allclose(CUBE.poses()[1], [0.26, 0.36, -0.54], atol=1e-12)
    assert len({tuple(corner) for corner in CUBE.corners()}) == 8


def test_cube_paths() -> None:
    line = CUBE.line(stations=11)
    assert line.shape == (11, 3)
    assert np.linalg.norm(line[-1] - line[0]) == pytest.approx(0.8 * np.sqrt(3) * 0.4)
    normal = np.cross(CUBE.poses()[1] - CUBE.centre, CUBE.poses()[2] - CUBE.centre)
    for small, diameter in ((False, 0.32), (True, 0.032)):
        circle = CUBE.circle(stations=21, small=small) - CUBE.centre
        np.testing.assert_allclose(np.linalg.norm(circle, axis=1), diameter / 2)
        np.testing.assert_allclose(circle @ normal, 0.0, atol=1e-15)
        np.testing.assert_allclose(circle[0], circle[-1], atol=1e-15)


# Refusals


def test_wrong_input_is_named() -> None:
    good = np.zeros((2, 3))
    bad = np.array([[0.0, 0, 0], [0, np.nan, 0]])
    for call, message in [
        (lambda: position_accuracy(good[:1], good[0], FEW), "1 cycles; few has 2"),
        (lambda: position_accuracy(good[:, :2], good[0], FEW), r"shape \(2, 2\)"),
        (lambda: position_accuracy(good, good, FEW), r"commanded has shape \(2, 3\)"),
        (lambda: position_repeatability(bad, FEW), "attained holds a value that is not finite"),
        (lambda: position_repeatability(good[0], FEW), r"attained has shape \(3,\)"),
        (lambda: direction_variation(good, FEW), "3 directions"),
        (lambda: distance_repeatability(good, good[:1], FEW), r"second has shape \(1, 3\)"),
        (lambda: distance_accuracy(good, good, good[0], FEW), r"it has to be \(2, 3\)"),
        (lambda: path_accuracy(LINE, [LINE], FEW), "attempts are 1; few has 2 or more"),
        (lambda: path_accuracy(LINE, [LINE, bad], FEW), r"attempts\[1\] holds"),
        (lambda: path_accuracy(LINE[None], [LINE, LINE], FEW), r"command has shape \(1, 2, 3\)"),
        (lambda: path_accuracy(0 * LINE, [LINE, LINE], FEW), "does not move"),
        (lambda: path_accuracy(np.vstack([LINE, LINE[:1]]), [LINE] * 2, FEW), "turns back"),
        (lambda: CUBE.poses("C1-C2-C3-C4"), "C2-C3-C8-C5"),
        (lambda: Cube((0, 0, 0), -1.0), "side is -1.0"),
        (lambda: Cube((0, 0), 1.0), "centre is"),  # type: ignore[arg-type]
        (lambda: Conditions("none", 1, 30, 10), "position_cycles is 1"),
        (lambda: Conditions("none", 30, 30, 10, stations=4), "stations is 4"),
        (lambda: Conditions("none", 30, 30, 10, speed_fraction=0.0), "speed_fraction is 0.0"),
        (lambda: Conditions("none", 30, 30, 10, load_fraction=2.0), "load_fraction is 2.0"),
    ]:
        with pytest.raises(InputError, match=message):
            call()


def test_an_attempt_that_leaves_out_a_part_is_refused() -> None:
    half = along(50, (0, 0, 0))[:25]
    with pytest.raises(DataError, match=r"attempts\[1\] does not go from end to end"):
        path_accuracy(LINE, [along(50, (0, 0, 0)), half], FEW)
    with pytest.raises(DataError, match=r"attempts\[0\] does not go from end to end"):
        path_accuracy(LINE, [along(50, (0, 0, 0))[25:], half], FEW)
    holed = along(101, (0, 0, 0))
    holed = np.vstack([holed[:20], holed[60:]])
    with pytest.raises(DataError, match=r"no sample over 0.41 m of the path; at most 0.1 m"):
        path_accuracy(LINE, [holed] * 2, Conditions("few", 2, 2, 2, stations=101))
    elsewhere = along(50, (5.0, 0, 0))
    with pytest.raises(DataError, match="end to end"):
        path_accuracy(LINE, [elsewhere] * 2, FEW)
