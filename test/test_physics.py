"""A Delta in a physics engine, compared with equilibria by hand, and then diagnosed.

The whole study is `python -m study.bodies`; this is a small part.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from delta_calibration.data import survey
from delta_calibration.diagnosis import Verdict, diagnose
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot

pytest.importorskip("mujoco", reason="needs the extra [physics]")

from physics.bodies import FOOT, GRAVITY
from physics.machine import (
    ARM,
    ARM_CENTRE,
    ARM_KG,
    ELBOW_END,
    HALF,
    PLATFORM,
    PLATFORM_END,
    PLATFORM_KG,
    RADIUS,
    ROD,
    ROD_KG,
    SIDES,
    Machine,
    as_drawn,
    from_the_workshop,
)
from physics.plan import HEAVY, circles, places, stops
from physics.rig import Rig
from physics.session import measured
from study.bodies import CASES, judge

HEIGHT = np.sqrt(ROD**2 - (RADIUS + ARM - PLATFORM) ** 2)  # [m] below the base, arms level
SPRING, GAP = 2.5e4, 0.3e-3  # [N m/rad], [rad]
HELD = "backlash held by weight"
POSES = places(np.random.default_rng(1), 6)


def standing(machine: Machine, q, payload: float = 0.0, seconds: float = 0.4):
    """Position of the platform at rest, with the motors brought slowly to q, (3,) [m]."""
    rig, q = Rig(machine), np.asarray(q, dtype=float)
    share = np.linspace(0, 1, 800)[:, None]
    rig.follow(q * share**2 * (3 - 2 * share), payload, 800)
    return rig.settle(q, payload, seconds)[0]


def three_spheres(q):
    """Position of the nominal platform in closed form, (3,) [m]."""
    angle = 2 * np.pi / 3 * np.arange(3)
    out = RADIUS + ARM * np.cos(q) - PLATFORM
    centres = np.stack([out * np.cos(angle), out * np.sin(angle), -ARM * np.sin(q)], axis=1)
    first = centres[0]
    along, other = centres[1] - first, centres[2] - first
    x = along / np.linalg.norm(along)
    y = other - (other @ x) * x
    y = y / np.linalg.norm(y)
    d, i, j = np.linalg.norm(along), other @ x, other @ y
    a, b = d / 2, (i**2 + j**2 - i * d) / (2 * j)
    up = np.cross(x, y)
    return first + a * x + b * y - np.sign(up[2]) * np.sqrt(ROD**2 - a**2 - b**2) * up


def six_distances(machine: Machine, q):
    """Position of the platform of a built machine with its six rod lengths, (3,) [m]."""

    def gaps(pose):
        left, turn = [], Rotation.from_rotvec(pose[3:])
        for leg in range(3):
            stand = Rotation.from_euler("z", 2 * np.pi / 3 * leg)
            angle = q[leg] + machine.zero[leg]
            hinge = machine.hinge[leg] + [RADIUS, 0, 0]
            down = Rotation.from_rotvec([0, angle, 0])
            ball = machine.ball[leg] + [PLATFORM, 0, 0]
            for k, side in enumerate(SIDES):
                aside = np.array([0, side * HALF, 0])
                end = pose[:3] + turn.apply(stand.apply(ball + aside))
                elbow = hinge + down.apply(machine.elbow(leg, k))
                length = np.linalg.norm(end - stand.apply(elbow))
                left.append(length - machine.rod[leg, k])
        return left

    start = np.r_[three_spheres(np.asarray(q)), np.zeros(3)]
    return least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[:3]


@pytest.mark.parametrize("payload", [0.0, HEAVY])
def test_a_rigid_machine_stands_where_three_spheres_meet(payload: float):
    for q in POSES[:3]:
        off = standing(as_drawn(), q, payload) - three_spheres(q)
        assert np.linalg.norm(off) < 0.1e-6


def test_a_built_machine_stands_where_its_rods_reach():
    machine = from_the_workshop(np.random.default_rng(2))
    for q in POSES[3:]:
        off = standing(machine, q) - six_distances(machine, q)
        assert np.linalg.norm(off) < 0.1e-6


def fallen(**faults) -> float:
    """How much lower the platform hangs with level arms [m]."""
    place = standing(as_drawn().with_(**faults), np.zeros(3))
    np.testing.assert_allclose(place[:2], 0, atol=1e-8)
    return -HEIGHT - place[2]


def test_bodies_give_way_as_equilibria_by_hand_have_it():
    """With level arms, all three alike, an arm that rotates by dq lowers all beyond by ARM dq."""
    torque = GRAVITY * ARM * (PLATFORM_KG / 3 + 2 * ROD_KG + ARM_CENTRE * ARM_KG)
    lean = HEIGHT / ROD
    pull = GRAVITY * (PLATFORM_KG + 3 * ROD_KG) / (6 * lean)  # force in a rod at its middle
    assert fallen(drive=SPRING) == pytest.approx(ARM * torque / SPRING, rel=2e-3)
    assert fallen(rod_spring=1e6) == pytest.approx(pull / 1e6 / lean, rel=2e-3)
    assert fallen(gap=GAP) == pytest.approx(ARM * GAP / 2, rel=2e-3)
    both = fallen(gap=GAP, drive=SPRING)
    assert both == pytest.approx(ARM * (GAP / 2 + torque / SPRING), rel=2e-3)
    for end in (PLATFORM_END, ELBOW_END):
        assert fallen(clearance=20e-6, worn=end) == pytest.approx(20e-6 / lean, rel=2e-3)
    weight = GRAVITY * (PLATFORM_KG + 3 * (ARM_KG + 2 * ROD_KG) + 60.0)
    assert fallen(mount=2e6) == pytest.approx(weight / 2e6, rel=2e-3)
    assert fallen(mount=2e6, feet=1.2) == pytest.approx(weight / 2e6, rel=2e-3)


def said_of(faults: dict, seed: int, count: int = 16, reach: float = 0.4, moves=False) -> Verdict:
    rng = np.random.default_rng(seed)
    items = stops(rng, count, repeats=6, reach=reach)
    if moves:
        items += circles(items[-1].command[-1], HEAVY, (0.18, 0.5))
    session = measured(from_the_workshop(rng).with_(**faults), items, rng)
    return diagnose(survey(session, ROBOT.joints.names), ROBOT, seed=seed).verdict


ROBOT = load_robot("srbd")


def holds(verdict: Verdict, cause: str, name: str, true: float) -> None:
    """Require this cause as the only finding, with the true value in each joint's interval."""
    assert [f.cause for f in verdict.findings] == [cause]
    assert not verdict.unknown_structure.found
    estimates = [e for n, e in verdict.findings[0].parameters.items() if n.startswith(name)]
    assert len(estimates) == 3
    for each in estimates:
        assert abs(each.value - true) < 4 * each.std
        assert each.std < 0.15 * true


@pytest.mark.slow
def test_a_rigid_machine_is_clean():
    verdict = said_of({}, 31)
    assert not verdict.findings
    assert not verdict.unknown_structure.found


@pytest.mark.slow
def test_drive_springs_are_one_stiffness_at_rest_and_in_motion():
    """With the weight but without inertia there would be two causes, at rest and in motion."""
    holds(said_of({"drive": SPRING}, 32, moves=True), "joint_compliance", "compliance", 1 / SPRING)


@pytest.mark.slow
def test_a_base_on_soft_feet_is_named_by_what_it_gives():
    """Stiffness, depth and radius of the feet are found."""
    verdict = said_of({"mount": 2e6, "feet": 1.2}, 33, count=24, moves=True)
    assert [f.cause for f in verdict.findings] == ["base_compliance"]
    assert not verdict.unknown_structure.found
    found = {**verdict.findings[0].parameters, **verdict.findings[0].shape}
    true = {"give": 1 / 2e6, "depth_m": 1.2, "radius_m": np.sqrt(2) * FOOT}
    for name, value in true.items():
        assert abs(found[name].value - value) < 3 * found[name].std
        assert found[name].std < 0.15 * value


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 3.0])
def test_play_is_found_where_the_weight_decides_the_flank(friction: float):
    """At some poses, where the torque of the weight exceeds friction, or at all."""
    verdict = said_of({"gap": GAP, "friction": friction}, 36, count=24, reach=0.5)
    holds(verdict, "backlash", "gap", GAP)
    found = verdict.findings[0].shape["friction"]
    # inertia helps the weight while the arm stops: friction is a little less than that at rest
    assert 0.9 * friction < found.value < friction + 3 * found.std


@pytest.mark.slow
def test_a_drive_that_yields_with_play_and_friction_is_all_three():
    """Friction winds up the spring and holds the arm in the gap, which the weight closes."""
    verdict = said_of({"gap": GAP, "friction": 3.0, "drive": SPRING}, 37, count=24)
    assert {f.cause for f in verdict.findings} == {"backlash", "joint_compliance", "stick_slip"}
    assert not verdict.unknown_structure.found
    for finding in verdict.findings:
        names = {"backlash": GAP, "joint_compliance": 1 / SPRING, "stick_slip": 3.0 / SPRING}
        for each in list(finding.parameters.values())[:3]:
            assert abs(each.value - names[finding.cause]) < 4 * each.std


@pytest.mark.slow
def test_friction_that_winds_up_a_drive_is_said_to_be_likelier_than_play():
    """It leaves the arm behind as play does, but the weight would have pushed through a gap."""
    verdict = said_of({"friction": 3.0, "drive": SPRING}, 52, count=24)
    assert {f.cause for f in verdict.findings} == {"backlash", "joint_compliance"}
    assert not verdict.unknown_structure.found
    (play,) = (f for f in verdict.findings if f.cause == "backlash")
    assert play.equivalents == ("stick_slip",)
    assert play.separated_by.startswith("friction is likelier")
    (said,) = (some for some in verdict.cannot_tell if "stick_slip" in some.between)
    assert set(said.between) == {"backlash", "stick_slip"}
    for finding in verdict.findings:
        true = {"joint_compliance": 1 / SPRING, "backlash": 2 * 3.0 / SPRING}[finding.cause]
        for each in list(finding.parameters.values())[:3]:
            assert abs(each.value - true) < 4 * each.std


@pytest.mark.slow
def test_two_causes_that_were_one_in_their_first_shapes_are_told_apart():
    """Backlash that loads never decide was like friction that winds up a spring."""
    name = "backlash and drive springs under weight and friction"
    (number,) = (i for i, case in enumerate(CASES) if case.name == name)
    said = judge(number, 43)
    assert set(said["said"]) == {"backlash", "joint_compliance", "stick_slip"}
    assert "friction" in said["shape"]["backlash"]


@pytest.mark.slow
def test_worn_elbows_leave_nothing_for_a_map():
    """A map of their sharp steps was likelier than the first, soft shape of their clearance."""
    verdict = said_of({"clearance": 20e-6, "worn": ELBOW_END}, 39, count=24)
    assert [f.cause for f in verdict.findings] == ["ball_joint_clearance"]
    assert verdict.findings[0].shape["worn_end"] == "elbow"
    assert not verdict.unknown_structure.found


@pytest.mark.slow
def test_play_that_weight_holds_shut_is_said_not_to_show():
    verdict = said_of({"gap": GAP}, 34, reach=0.15)
    assert not verdict.findings
    told = [item for item in verdict.cannot_tell if HELD in item.between]
    assert len(told) == 1
    assert "every joint" in told[0].because


def test_a_session_of_bodies_goes_through_the_file_and_the_study_has_every_case(tmp_path: Path):
    rng = np.random.default_rng(35)
    session = measured(as_drawn(), stops(rng, 1, repeats=0), rng)
    write_session(tmp_path / "session", session)
    again = read_session(tmp_path / "session")
    np.testing.assert_array_equal(again.tracker.position, session.tracker.position)
    paths = [str(Path(__file__).parents[k] / name) for k, name in ((0, ""), (1, "benchmarks"))]
    done = subprocess.run(
        [sys.executable, "-m", "study.bodies", "--only", "no such case"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([*paths, *sys.path])},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("| hidden |")
