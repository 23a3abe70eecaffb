"""Tests of the physics of each effect, against another formulation.

These use energies, equilibria and rigid bodies of a six-rod machine that shares no code with the
package; differential equations solved by scipy; backlash as a state; clocks and discs as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, at_rest, motion_of
from delta_calibration.effects import effect_named
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from six_rods import PLATFORM, SixRods, workspace

ROBOT = load_robot("srbd")
MODELS = ("rotary_delta", "six_rod_delta")
GRAVITY = 9.80665  # [m/s^2]
PLATFORM_KG, ARM_KG, ARM_CENTRE, ROD_KG = 1.2, 1.6, 0.45, 0.18
both_models = pytest.mark.parametrize("model", MODELS)
Q = workspace(30, np.random.default_rng(1))
MACHINE = SixRods()


def effect(cause, model="six_rod_delta", **settings):
    return effect_named(cause, ROBOT, ROBOT.model(model), settings)


def loaded(q, seed=2, centred=False) -> Conditions:
    """Payloads of 0 to 3 kg, up to 30 mm off the platform's centre and below it."""
    rng, n = np.random.default_rng(seed), len(q)
    centre = rng.uniform([-0.03, -0.03, -0.05], [0.03, 0.03, 0.0], (n, 3))
    return replace(
        at_rest(q), payload=rng.uniform(0.0, 3.0, n), payload_centre=(not centred) * centre
    )


def predicted(effects, values, at, geometry=None):
    """Platform centre by the chain with these effects of these sizes, (n, 3) [m]."""
    chain = Chain(ROBOT.model(), np.zeros(3), 0.05, tuple(effects))
    g = chain.mechanism.parameters.nominal if geometry is None else geometry
    theta = chain.join(g, np.zeros(3), Frame.identity())
    theta[chain.layout.effects] = np.concatenate([np.atleast_1d(value) for value in values])
    return chain.predict(at, theta)


def with_rods(change):
    """The other machine, with each rod longer by (6,) [m]."""
    errors = {}
    for leg, (a, b) in enumerate(change.reshape(3, 2), start=1):
        errors |= {f"rod_{leg}": (a + b) / 2, f"rod_mismatch_{leg}": b - a}
    return SixRods(errors)


def settled(at, longer):
    """Platform centre of the other machine, (n, 3) [m], with rods under their final forces.

    `longer` converts forces (6,) [N] to elongations [m]. NaN where no consistent solution is
    found, as where a rod that is released would be in tension again.
    """
    points = np.full((len(at), 3), np.nan)
    for row in range(len(at)):
        one, change = at.take([row]), np.zeros(6)
        for _ in range(20):
            machine, before = with_rods(change), change
            change = longer(rod_forces(one, machine)[0])
            if np.abs(change - before).max() < 1e-15:
                points[row] = machine.point(one.joint)[0]
                break
    return points


def balls(q, machine=MACHINE):
    """Ball joints at the elbows and at the platform, both (n, 6, 3); centre and orientation."""
    centre, turn = machine.pose(q)
    lower = np.stack([centre + turn.apply(ball) for ball in machine.platform], axis=1)
    return machine.elbows(q), lower, centre, turn


def energy(q, at):
    """Potential energy of all masses, with uniform rods as masses at their ends, (n,) [J]."""
    upper, lower, centre, turn = balls(q)
    height = PLATFORM_KG * centre[:, 2] + ROD_KG / 2 * (upper + lower)[..., 2].sum(axis=1)
    for leg in range(3):
        hinge = MACHINE.turn[leg].apply(MACHINE.hinge[leg])
        elbow = upper[:, 2 * leg : 2 * leg + 2].mean(axis=1)
        height = height + ARM_KG * (hinge + ARM_CENTRE * (elbow - hinge))[:, 2]
    return GRAVITY * (height + at.payload * (centre + turn.apply(at.payload_centre))[:, 2])


def rod_forces(at, machine=MACHINE):
    """Tension of each rod by the equilibrium of the platform, six equations, (n, 6) [N].

    A rod transmits half of its weight to the platform, at its ball joint.
    """
    upper, lower, centre, turn = balls(at.joint, machine)
    along = upper - lower
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    down = np.array([0.0, 0.0, -GRAVITY])
    moment = np.cross(lower - centre[:, None], along)
    force = (PLATFORM_KG + 3 * ROD_KG + at.payload)[:, None] * down
    torque = at.payload[:, None] * np.cross(turn.apply(at.payload_centre), down)
    torque = torque + ROD_KG / 2 * np.cross(lower - centre[:, None], down).sum(axis=1)
    wrench = np.concatenate([along, moment], axis=2)
    load = np.concatenate([force, torque], axis=1)
    return np.linalg.solve(np.swapaxes(wrench, 1, 2), -load[..., None])[..., 0]


@both_models
def test_a_drive_carries_the_slope_of_the_energy(model: str) -> None:
    at, step = loaded(Q), 1e-5 * np.eye(3)
    torque = [(energy(Q + s, at) - energy(Q - s, at)) / 2e-5 for s in step]
    columns = effect("joint_compliance", model).columns(at)
    np.testing.assert_allclose(-np.einsum("njj->nj", columns), np.stack(torque, axis=1), atol=2e-7)
    assert not columns[:, ~np.eye(3, dtype=bool)].any()
    assert np.abs(columns).max() > 5.0  # [N m]


@both_models
def test_rods_stretch_by_the_pull_that_holds_the_platform(model: str) -> None:
    """Compared with a machine whose rods have the lengths that result from their tensions."""
    at, compliance = loaded(Q, centred=model == "rotary_delta"), 4e-7
    force = rod_forces(at).reshape(-1, 3, 2)
    pairs = force.mean(axis=2)
    assert np.ptp(pairs) > 5.0
    names = effect("forearm_compliance", model).mechanism.parameters.names
    columns = effect("forearm_compliance", model).columns(at)[..., 0]
    rods = [names.index(f"rod_{leg}") for leg in (1, 2, 3)]
    np.testing.assert_allclose(columns[:, rods], pairs, atol=1e-9)
    rest = np.delete(columns, rods, axis=1)
    if model == "rotary_delta":
        assert not rest.any()
        return
    mismatch = [names.index(f"rod_mismatch_{leg}") for leg in (1, 2, 3)]
    np.testing.assert_allclose(columns[:, mismatch], force[..., 1] - force[..., 0], atol=1e-9)
    moved = predicted([effect("forearm_compliance")], [compliance], at)
    stretched = settled(at, lambda pull: compliance * pull)
    np.testing.assert_allclose(moved, stretched, atol=1e-12)


def test_a_ball_joint_has_its_play_on_the_side_it_is_pulled_to() -> None:
    """Rods of one pair may be at different ends where the load turns the platform."""
    q = np.random.default_rng(3).uniform([0.3, -0.1, -0.1], [0.9, 0.3, 0.3], (60, 3))
    at, clearance = loaded(q), 3e-5
    sides = np.sign(rod_forces(at))
    assert 20 < (sides < 0).sum() < 200
    assert (sides[:, ::2] != sides[:, 1::2]).any()
    moved = predicted([effect("ball_joint_clearance")], [clearance], at)
    pulled = settled(at, lambda pull: clearance * np.sign(pull))
    found = np.isfinite(pulled).all(axis=1)
    assert found.sum() >= 59
    np.testing.assert_allclose(moved[found], pulled[found], atol=1e-12)
    # A rod in tension when short and in compression when long is somewhere in its clearance.
    middle = MACHINE.point(q[~found])
    assert np.abs(moved[~found] - middle).max(initial=0.0) < 5 * clearance


def bits(q, at, machine=MACHINE):
    """Masses (n, k) [kg] and positions (n, k, 3) of all moving parts, bars by Gauss points."""
    upper, lower, centre, turn = balls(q, machine)
    share, weight = np.polynomial.legendre.leggauss(4)
    share, weight = (share + 1) / 2, weight / 2
    taper = 1.3 - 0.6 * share  # of an arm's section: its centre is at 0.45
    kg, where = [PLATFORM_KG, at.payload], [centre, centre + turn.apply(at.payload_centre)]
    for leg in range(3):
        hinge = MACHINE.turn[leg].apply(MACHINE.hinge[leg])
        elbow = upper[:, 2 * leg : 2 * leg + 2].mean(axis=1)
        kg += (ARM_KG * weight * taper).tolist()
        where += [hinge + s * (elbow - hinge) for s in share]
    for rod in range(6):
        kg += (ROD_KG * weight).tolist()
        where += [upper[:, rod] + s * (lower[:, rod] - upper[:, rod]) for s in share]
    mass = np.stack([np.broadcast_to(m, len(q)) for m in kg], axis=1)
    return mass, np.stack(where, axis=1)


@both_models
def test_a_drive_gives_way_to_the_work_of_its_inertia(model: str) -> None:
    """D'Alembert on a motion through each pose, with every mass point differentiated in time."""
    rng, t, at = np.random.default_rng(4), 1e-3, loaded(Q)
    v, a = rng.uniform(-2, 2, Q.shape), rng.uniform(-20, 20, Q.shape)
    at = replace(at, velocity=v, acceleration=a)
    mass, here = bits(Q, at)
    there, back = (bits(Q + v * s + a * s**2 / 2, at)[1] for s in (t, -t))
    push = mass[..., None] * (there - 2 * here + back) / t**2
    slope = [bits(Q + s, at)[1] - bits(Q - s, at)[1] for s in 1e-5 * np.eye(3)]
    work = np.stack([np.sum(push * s / 2e-5, axis=(1, 2)) for s in slope], axis=1)
    columns = effect("dynamic_deflection", model).columns(at)[..., 0]
    assert np.abs(work).max() > 5.0  # [N m]
    np.testing.assert_allclose(columns, -work, rtol=2e-3, atol=5e-3)
    spring = np.einsum("njj->nj", effect("joint_compliance", model).columns(at))
    at_rest_ = np.einsum("njj->nj", effect("joint_compliance", model).columns(loaded(Q)))
    np.testing.assert_allclose(spring - at_rest_, columns, atol=1e-9)  # one spring for both
    other_way = replace(at, velocity=-v)  # the same circle in the other direction
    np.testing.assert_allclose(
        effect("dynamic_deflection", model).columns(other_way)[..., 0], columns, atol=1e-9
    )
    assert not effect("dynamic_deflection", model).columns(loaded(Q)).any()


@both_models
def test_rods_carry_the_inertia_of_what_they_hold(model: str) -> None:
    """D'Alembert: the work of all inertia forces when a pair of rods is lengthened."""
    rng, t, at = np.random.default_rng(6), 1e-3, loaded(Q, centred=True)
    v, a = rng.uniform(-2, 2, Q.shape), rng.uniform(-20, 20, Q.shape)
    mass, here = bits(Q, at)
    there, back = (bits(Q + v * s + a * s**2 / 2, at)[1] for s in (t, -t))
    push = mass[..., None] * (there - 2 * here + back) / t**2
    compliance = effect("forearm_compliance", model)
    moving = replace(at, velocity=v, acceleration=a)
    more = (compliance.columns(moving) - compliance.columns(at))[..., 0]
    for leg in (1, 2, 3):
        ends = [bits(Q, at, SixRods({f"rod_{leg}": s * 1e-5}))[1] for s in (1, -1)]
        work = np.sum(push * (ends[0] - ends[1]) / 2e-5, axis=(1, 2))
        row = compliance.mechanism.parameters.names.index(f"rod_{leg}")
        np.testing.assert_allclose(2 * more[:, row], -work, rtol=5e-3, atol=2e-2)
    assert np.abs(more).max() > 3.0  # [N]


def pressed(mass, push, where):
    """Force and moment of mass points (n, b) on the base about its origin, (n, 6)."""
    force = -mass[..., None] * (push + np.array([0.0, 0.0, GRAVITY]))
    return np.concatenate([force.sum(axis=1), np.cross(where, force).sum(axis=1)], axis=1)


def reaction(model: str, at) -> np.ndarray:
    """The same by the package, (n, 6)."""
    return effect("base_compliance", model).nominal(at).of("reaction")


@both_models
def test_the_base_bears_all_that_is_held_and_accelerated(model: str) -> None:
    """Newton-Euler for every mass point, differentiated in time; constant loads are left out."""
    rng, t, at = np.random.default_rng(14), 1e-3, loaded(Q)
    v, a = rng.uniform(-2, 2, Q.shape), rng.uniform(-20, 20, Q.shape)
    mass, here = bits(Q, at)
    there, back = (bits(Q + v * s + a * s**2 / 2, at)[1] for s in (t, -t))
    still = pressed(mass, 0 * here, here)
    moving = pressed(mass, (there - 2 * here + back) / t**2, here)
    found, resting = reaction(model, replace(at, velocity=v, acceleration=a)), reaction(model, at)
    fixed = still[0] - resting[0]  # an arm's mass at its hinge
    np.testing.assert_allclose(fixed[[0, 1, 3, 4, 5]], 0.0, atol=1e-9)
    assert fixed[2] < 0
    np.testing.assert_allclose(resting, still - fixed, atol=1e-9)
    assert np.abs(moving - still)[:, :3].max() > 20.0  # [N]
    assert np.abs(moving - still)[:, 3:].max() > 10.0  # [N m]
    np.testing.assert_allclose(found - resting, moving - still, rtol=1e-3, atol=5e-3)


def test_the_moment_on_the_base_is_the_slope_of_its_energy() -> None:
    """By complex step: the machine is turned by i e; its potential's imaginary part / e."""
    at, e = loaded(Q), 1e-20
    mass, where = bits(Q, at)
    for axis in np.eye(3):
        turned = where + 1j * e * np.cross(axis, where)
        slope = np.sum(mass * GRAVITY * turned[..., 2], axis=1).imag / e
        moment = reaction("six_rod_delta", at)[:, 3:] @ axis
        np.testing.assert_allclose(moment, -slope, atol=1e-9)


def test_a_base_on_four_springs() -> None:
    """Equilibrium of a base on feet, each with springs in all directions, derived by hand."""
    corners = [[x, y, -1.4] for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    stiff = 1e6  # [N/m] of a foot
    matrix = np.zeros((6, 6))
    for foot in np.array(corners):  # force of a foot on the base displaced by (d, b)
        moves = np.hstack([np.eye(3), np.array([np.cross(axis, foot) for axis in np.eye(3)]).T])
        matrix += stiff * moves.T @ moves
    at = replace(loaded(Q), velocity=0 * Q + 1.0, acceleration=0 * Q + [9.0, -7.0, 4.0])
    base = reaction("six_rod_delta", at) @ np.linalg.inv(matrix)
    one = effect("base_compliance", depth=1.4, radius=0.4 * np.sqrt(2))
    values = np.array([1 / (4 * stiff)])
    np.testing.assert_allclose(one.columns(at) @ values, base, atol=1e-12)
    chain = Chain(ROBOT.model(), np.array([0.0, 0.0, -0.1]), 0.05, (one,))
    station = Frame.from_vector(np.array([0.3, -0.2, 2.0, 3.0, 0.5, 1.0]))
    theta = chain.join(chain.mechanism.parameters.nominal, chain.offset, station)
    plain = chain.predict(at, theta)
    theta[chain.layout.effects] = values
    inside = station.inverse().apply(plain)
    expected = station.apply(inside + base[:, :3] + np.cross(base[:, 3:], inside))
    np.testing.assert_allclose(chain.predict(at, theta), expected, atol=1e-12)
    assert np.ptp(expected - plain, axis=0).max() > 2e-5


def test_what_a_scara_of_uniform_links_presses_on_its_base() -> None:
    """Two bars and a payload, divided into points, by differences in time."""
    robot, n, t = load_robot("scara"), 8, 1e-3
    rng = np.random.default_rng(15)
    q = rng.uniform(-2, 2, (n, 2))
    v, a = rng.uniform(-2, 2, (n, 2)), rng.uniform(-9, 9, (n, 2))
    at = replace(at_rest(q), velocity=v, acceleration=a, payload=rng.uniform(0, 3, n))
    at = replace(at, payload_centre=np.zeros((n, 3)))
    share, weight = np.polynomial.legendre.leggauss(3)
    share, weight = (share + 1) / 2, weight / 2
    kg = np.concatenate([8.0 * weight, 5.0 * weight])
    mass = np.column_stack([np.tile(kg, (n, 1)), at.payload])

    def where(q: np.ndarray) -> np.ndarray:
        one, both = q[:, 0], q[:, 0] + q[:, 1]
        elbow = 0.5 * np.stack([np.cos(one), np.sin(one), 0 * one], axis=1)
        hand = elbow + 0.5 * np.stack([np.cos(both), np.sin(both), 0 * one], axis=1)
        places = [s * elbow for s in share] + [elbow + s * (hand - elbow) for s in share] + [hand]
        return np.stack(places, axis=1)

    here = where(q)
    push = (where(q + v * t + a * t**2 / 2) - 2 * here + where(q - v * t + a * t**2 / 2)) / t**2
    found = effect_named("base_compliance", robot, robot.model(), {}).nominal(at).of("reaction")
    np.testing.assert_allclose(found, pressed(mass, push, here), rtol=1e-4, atol=1e-3)
    assert np.abs(found[:, 5]).max() > 1.0  # about the vertical axis: by acceleration only


@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_a_worn_ball_joint_changes_over_where_its_own_pin_does(end: float) -> None:
    """Half of the rod's weight along it is added at the elbow, and subtracted at the platform."""
    q = np.random.default_rng(3).uniform([0.3, -0.1, -0.1], [0.9, 0.3, 0.3], (60, 3))
    at, clearance = loaded(q), 3e-5
    upper, lower, _, _ = balls(q)
    along = (upper - lower)[..., 2] / np.linalg.norm(upper - lower, axis=2)
    middle = rod_forces(at)
    pin = middle + end * ROD_KG * GRAVITY / 2 * along
    assert (np.sign(pin) != np.sign(middle)).sum() > 5
    signals = effect("ball_joint_clearance", end=end).columns(at)[..., 0]
    names = effect("ball_joint_clearance").mechanism.parameters.names
    for leg in range(3):
        sides = np.sign(pin[:, 2 * leg : 2 * leg + 2])
        known = np.abs(pin[:, 2 * leg : 2 * leg + 2]).min(axis=1) > 1e-3  # [N]
        found = signals[:, names.index(f"rod_{leg + 1}")]
        np.testing.assert_allclose(found[known], sides.mean(axis=1)[known], atol=1e-9)
    moved = predicted([effect("ball_joint_clearance", end=end)], [clearance], at)
    assert np.abs(moved - MACHINE.point(q)).max() > clearance


@both_models
def test_play_leans_where_the_load_is_more_than_friction(model: str) -> None:
    """sign(load) there, the side of the last motion elsewhere; a payload may change it."""
    rng, step, friction = np.random.default_rng(7), 1e-5 * np.eye(3), 5.0
    q = rng.uniform([0.3, -0.4, -0.4], [1.1, 0.6, 0.6], (60, 3))
    at = replace(loaded(q), direction=rng.choice([-1.0, 1.0], q.shape), travel=np.ones_like(q))
    load = np.stack([(energy(q + s, at) - energy(q - s, at)) / 2e-5 for s in step], axis=1)
    held = np.abs(load) > friction
    assert 20 < held.sum() < 160
    side = np.where(held, np.sign(load), at.direction)
    columns = effect("backlash", model, held_by=friction).columns(at)
    np.testing.assert_allclose(np.einsum("njj->nj", columns), -side / 2, atol=1e-12)
    by_load = np.einsum("njj->nj", effect("backlash", model, held_by=1e-3).columns(at))
    np.testing.assert_allclose(by_load, -np.sign(load) / 2, atol=1e-12)
    assert (by_load > 0).any()
    assert (by_load < 0).any()


def play(path, gap):
    """Joint minus motor, backlash as a state: the joint waits until the motor takes it along."""
    joint = np.empty_like(path)
    joint[0] = path[0]
    for i in range(1, len(path)):
        joint[i] = np.clip(joint[i - 1], path[i] - gap / 2, path[i] + gap / 2)
    return joint - path


def test_backlash_is_a_play_on_a_long_random_way() -> None:
    """Strokes of 2 to 80 mrad back and forth, the whole history of two hundred reversals."""
    rng, gap = np.random.default_rng(5), np.array([3e-4, 8e-4, 1.5e-3])
    turns = np.cumsum(rng.uniform(2e-3, 0.08, (200, 3)) * np.array([[1], [-1]] * 100), axis=0)
    gone = np.linspace(0, 1, 400, endpoint=False)[:, None] * np.diff(turns, axis=0)[:, None]
    path, gone = (turns[:-1, None] + gone).reshape(-1, 3), np.abs(gone).reshape(-1, 3)
    motion = motion_of(np.arange(len(path)) * 0.01, path)
    at = replace(at_rest(path), direction=motion.direction, travel=motion.travel)
    moved = effect("backlash").refined(gap).columns(at) @ gap
    state = np.column_stack([play(path[:, j], gap[j]) for j in range(3)])
    known = gone > 2.1e-4  # less could be the noise of an encoder
    known[:400] &= gone[:400] > gap  # the initial side is unknown
    assert known.mean() > 0.9
    assert np.abs(moved - state)[known].max() < 1e-12
    crossing = known & (np.abs(state) < 0.49 * gap)
    assert (crossing.sum(axis=0) > 200).all()  # not the ends alone
    assert np.abs(moved - state)[400:].max() <= gap.max()


def test_friction_lets_go_by_stribecks_law() -> None:
    """d(error)/d|v| = -2 v (error - level) / v_s^2 from full twist at rest, against the motion."""
    speed, level = np.linspace(0.0, 0.5, 40), 0.3
    law = solve_ivp(
        lambda v, e: -2 * v * (e - level) / 0.08**2,
        (0, 0.5),
        [1.0],
        t_eval=speed,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.01,
    )
    for sign in (1.0, -1.0):
        way = sign * np.ones((40, 3))
        at = replace(at_rest(0 * way), velocity=speed[:, None] * way, direction=way)
        columns = np.einsum("njj->nj", effect("stick_slip", speed=0.08, level=level).columns(at))
        np.testing.assert_allclose(columns, np.tile(-sign * law.y[0][:, None], 3), atol=1e-9)


def test_a_joint_that_stops_within_the_presliding_keeps_the_twist_of_its_motion() -> None:
    """Bristles of the LuGre model, integrated through a stop: short ones follow, long ones stay.

    z' = v - |v| z / (s g(v)), g(v) = c + (1 - c) exp(-(v / v_s)^2); the twist is a z / s.
    """
    v_s, c, slowing = 0.05, 0.6, 2.0  # [rad/s], 1, [rad/s^2]

    def bend(s: float) -> float:
        def change(t: float, z: list[float]) -> list[float]:
            v = slowing * (0.5 - t)
            return [v - v * z[0] / (s * (c + (1 - c) * np.exp(-((v / v_s) ** 2))))]

        found = solve_ivp(change, (0, 0.5), [s * c], rtol=1e-9, atol=1e-12, max_step=1e-3)
        return float(found.y[0, -1] / s)

    at = replace(at_rest(np.zeros((1, 3))), direction=np.ones((1, 3)))
    for s, stopped, most in ((1e-6, 1.0, 0.01), (1e-1, 0.0, 0.01)):
        law = effect("stick_slip", speed=v_s, level=c, stopped=stopped)
        assert -law.columns(at)[0, 0, 0] == pytest.approx(bend(s), abs=most)


def test_a_harmonic_goes_on_beyond_a_turn() -> None:
    """Over eight turns 33.5 cycles a turn are one spectral line; wrapped they are not."""
    n, turns, size, phase = 4096, 8, 1.3e-4, 0.7
    q = np.tile((2 * np.pi * turns * np.arange(n) / n)[:, None], 3)
    e = effect("transmission_error", cycles=33.5)
    v = size * np.array([np.cos(phase)] * 3 + [np.sin(phase)] * 3)
    spectrum = np.fft.rfft(e.columns(at_rest(q)) @ v, axis=0) / n
    line = int(33.5 * turns)
    np.testing.assert_allclose(2 * np.abs(spectrum[line]), size, rtol=1e-9)
    np.testing.assert_allclose(np.angle(spectrum[line]), phase - np.pi / 2, atol=1e-9)
    assert np.abs(np.delete(spectrum, line, axis=0)).max() < 1e-12


def test_a_second_order_of_a_train_is_a_line_of_its_own() -> None:
    """33 and 66 cycles per turn, each with its size and phase: two lines, and nothing else."""
    n, turns = 4096, 2
    q = np.tile((2 * np.pi * turns * np.arange(n) / n)[:, None], 3)
    e = effect("transmission_error", cycles=33.0, second=2.0)
    waves = ((1.3e-4, 0.7), (0.4e-4, -1.1))  # [rad] size and phase
    v = np.concatenate([s * np.repeat([np.cos(p), np.sin(p)], 3) for s, p in waves])
    spectrum = np.fft.rfft(e.columns(at_rest(q)) @ v, axis=0) / n
    for order, (size, phase) in zip((33, 66), waves, strict=True):
        line = spectrum[order * turns]
        np.testing.assert_allclose(2 * np.abs(line), size, rtol=1e-9)
        np.testing.assert_allclose(np.angle(line), phase - np.pi / 2, atol=1e-9)
    assert np.abs(np.delete(spectrum, [33 * turns, 66 * turns], axis=0)).max() < 1e-12


def test_an_eccentric_disc_read_by_one_head() -> None:
    """A disc of 40 mm, 10 um off its axis: 103 arc seconds, at the right angles."""
    radius, off, place = 0.02, 10e-6, 0.8
    true = np.linspace(-2.0, 5.0, 300)
    middle = off * np.exp(1j * (true + place))  # of the disc, about the axis; the head is at 0
    read = true - np.angle((radius - middle) / radius)
    error = true - read
    assert error.max() * 180 / np.pi * 3600 == pytest.approx(412 * 10 / 40, rel=2e-3)
    at = at_rest(np.tile(read[:, None], 3))
    columns = np.einsum("njk->jnk", effect("encoder_eccentricity").columns(at))
    for j in range(3):
        v, *_ = np.linalg.lstsq(columns[j], error, rcond=None)
        assert np.abs(columns[j] @ v - error).max() < (off / radius) ** 2
        assert np.hypot(v[j], v[3 + j]) == pytest.approx(off / radius, rel=1e-3)
        assert np.arctan2(v[3 + j], v[j]) == pytest.approx(place - np.pi, abs=1e-3)


def test_counts_a_turn_entered_wrong() -> None:
    """80 000 counts entered as 80 020: the joint moves farther than commanded."""
    true = Q
    told = np.round(true * 80_000 / (2 * np.pi) * 1e6) / 1e6 * 2 * np.pi / 80_020
    moved = effect("joint_scale").columns(at_rest(told)) @ np.full(3, 80_020 / 80_000 - 1)
    np.testing.assert_allclose(told + moved, true, atol=1e-9)


def test_a_part_warms_up_as_newton_says() -> None:
    """dT/dt = (T_end - T) / tau, with arms of the resulting length."""
    time, tau, growth = np.linspace(0, 5400, 12), 1500.0, 2e-4
    warm = solve_ivp(lambda t, s: (1 - s) / tau, (0, 5400), [0.0], t_eval=time, rtol=1e-10)
    at = replace(at_rest(Q[:12]), time=time)
    moved = predicted([effect("thermal_growth_arm", time_constant=tau)], [growth], at)
    for row, share in enumerate(warm.y[0]):
        longer = SixRods({f"arm_{leg}": 0.32 * growth * share for leg in (1, 2, 3)})
        np.testing.assert_allclose(moved[row], longer.point(Q[row : row + 1])[0], atol=1e-9)


@pytest.mark.parametrize("celsius", [5.0, 20.0, 44.0])
def test_a_machine_of_one_metal_only_grows_larger(celsius: float) -> None:
    """If the platform grows as well, every position is farther out by alpha dT."""
    parts, share = ("base", "forearm", "arm"), 23e-6 * (celsius - 20.0)
    at = replace(at_rest(Q), temperature_parts=parts, temperature=np.full((len(Q), 3), celsius))
    each = [effect(f"thermal_growth_{part}", sensor=part) for part in parts]
    parameters = ROBOT.model().parameters
    geometry, platform = parameters.nominal, [f"platform_radial_{leg}" for leg in (1, 2, 3)]
    geometry[[parameters.row(name) for name in platform]] = PLATFORM * (1 + share)
    moved = predicted(each, [23e-6] * 3, at, geometry=geometry)
    np.testing.assert_allclose(moved, (1 + share) * MACHINE.point(Q), atol=1e-13)


def test_an_encoder_that_creeps_and_a_coupling_that_slips() -> None:
    """30 urad an hour from the start; 80 urad from a certain time on."""
    at = replace(at_rest(Q), time=np.linspace(0.0, 5400.0, len(Q)))
    slip = np.array([8e-5, 0.0, -8e-5])
    both = [effect("joint_zero_drift"), effect("joint_zero_drift", step_at=1800.0)]
    creep, step = (e.columns(at) @ v for e, v in zip(both, (np.full(3, 3e-5), slip), strict=True))
    np.testing.assert_allclose(np.diff(creep, axis=0) / np.diff(at.time)[:, None], 3e-5 / 3600)
    assert not creep[0].any()
    np.testing.assert_array_equal(step, (at.time >= 1800.0)[:, None] * slip)


def test_a_tracker_that_creeps_moves_all_as_one_body() -> None:
    """A rotation and a shift about its own origin that settle together."""
    rng, tau = np.random.default_rng(6), 1200.0
    y, time = rng.uniform(1.0, 3.0, (50, 3)), rng.uniform(0.0, 7200.0, 50)
    shift, turn = np.array([4e-5, -2e-5, 3e-5]), np.array([2e-5, 1e-5, -3e-5])
    share = solve_ivp(lambda t, s: (1 - s) / tau, (0, 7200), [0.0], dense_output=True, rtol=1e-10)
    settled = share.sol(time).T
    moved = Rotation.from_rotvec(settled * turn).apply(y) + settled * shift
    at = replace(at_rest(Q[:1].repeat(50, axis=0)), time=time, reading=y)
    drift = effect("tracker_drift", time_constant=tau).columns(at) @ np.concatenate([shift, turn])
    assert np.linalg.norm(drift, axis=1).max() > 5e-5
    np.testing.assert_allclose(y + drift, moved, atol=6e-9)  # a rotation of 37 urad is not linear


def test_a_tracker_in_wrong_air_reads_every_distance_too_long() -> None:
    """As seen from the tracker directions are kept, and all distances grow by the same factor."""
    scale = 27e-6
    y = np.random.default_rng(7).uniform(1.0, 3.0, (50, 3))
    at = replace(at_rest(np.zeros((50, 3))), reading=y)
    read = y + effect("tracker_scale").columns(at) @ [scale]
    spherical = [np.linalg.norm(p, axis=1) for p in (y, read)]
    np.testing.assert_allclose(spherical[1] / spherical[0] - 1, scale, rtol=1e-9)
    np.testing.assert_allclose(np.cross(y, read), 0.0, atol=1e-14)
