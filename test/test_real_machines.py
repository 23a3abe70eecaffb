"""Measured data of a printer and a UR10; curves of joints also for a simulated arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import real_ur10
import real_v400
from delta_calibration.cli.main import run
from delta_calibration.data import survey
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.diagnosis.findings import HeldOutModels
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.estimation.printer import left_out
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from real_machines import DATA

UR10 = load_robot("ur10").dimensions

V400, ARM = DATA / "v400_linear_delta", DATA / "ur10_lasertracker"


def present(folder):
    reason = "the measurements of real machines are not beside the repository"
    return pytest.mark.skipif(not folder.is_dir(), reason=reason)


@pytest.mark.real
@present(V400)
def test_nine_parameters_of_the_printer():
    found = real_v400.fit(V400 / real_v400.MEASURED, priors=False)
    assert found.observability.rank == 9
    assert found.rms(0) < 0.041e-3
    assert found.rms(1) < 0.063e-3


@pytest.mark.real
@present(V400)
def test_19_data_do_not_say_how_long_the_arms_are():
    """The fit changes the arms by more than a millimetre, which is within its own interval."""
    folder = V400 / real_v400.MEASURED
    alone, believed = (real_v400.fit(folder, priors) for priors in (False, True))
    arms = [name.startswith("arm") for name in alone.names]
    assert (alone.std[arms] > 1e-3).all()
    assert ((believed.std / believed.prior)[arms] > 0.6).all()
    assert believed.told < 7.5
    assert alone.observability.indices["O2"] < 0.01
    unseen = [
        np.sqrt(
            np.mean(
                [
                    real_v400.rms(kind) ** 2
                    for kind in left_out(real_v400.PRINTER, real_v400.observations(folder), priors)
                ]
            )
        )
        for priors in (False, True)
    ]
    assert unseen[1] < 0.85 * unseen[0]  # with priors the data left out are predicted better


@pytest.mark.real
@present(V400)
def test_what_stays_of_the_meshes_and_what_does_not():
    meshes = [real_v400.mesh(V400 / day) for day in real_v400.AUGUST]
    assert len(meshes[0].error) == 377
    one, two = (real_v400.beyond_geometry(mesh) for mesh in meshes)
    assert np.corrcoef(one, two)[0, 1] > 0.8
    assert real_v400.rms((one + two) / 2) == pytest.approx(0.038e-3, abs=0.001e-3)
    assert real_v400.rms((one - two) / 2) < 0.015e-3
    # from heights alone, leaning towers and a smooth bed explain this equally well
    stays = (one + two) / 2
    lean = real_v400.lean_share(meshes[0], stays)
    bed = real_v400.bed_share(meshes[0], stays, 4)
    assert abs(lean - bed) < 0.1
    assert lean > 0.7
    rng = np.random.default_rng(1)
    chance = real_v400.lean_share(meshes[0], rng.standard_normal(len(stays)))
    assert chance < 0.1


@pytest.mark.real
@present(V400)
def test_what_stays_has_the_towers_symmetry_and_a_part_of_what_does_not_the_probing():
    meshes = [real_v400.mesh(V400 / day) for day in real_v400.AUGUST]
    one, two = (real_v400.beyond_geometry(mesh) for mesh in meshes)
    stays, changes = (one + two) / 2, (one - two) / 2
    lobes = {n: real_v400.threefold_share(meshes[0], stays, n) for n in (2, 3, 4, 6)}
    assert lobes[3] > 0.75
    assert max(share for n, share in lobes.items() if n != 3) < 0.05
    share = real_v400.to_and_fro(meshes[0], changes)
    assert share > 0.2 > 0.15 > real_v400.by_chance(meshes[0], changes)


def sampled(series, n, seed=1):
    """Some of the poses, in the order of measurement."""
    rows = np.random.default_rng(seed).choice(len(series.joint), n, replace=False)
    return series.take(np.sort(rows))


@pytest.mark.real
@present(ARM)
@pytest.mark.parametrize(
    ("name", "before", "after"), [("A", 0.84e-3, 0.44e-3), ("C", 0.99e-3, 0.49e-3)]
)
def test_ur10_geometry_and_what_is_left(name, before, after):
    """For 1500 poses; `python benchmarks/real_machines.py ur10` uses all of them."""
    series = sampled(real_ur10.read(ARM / real_ur10.SERIES[name]), 1500)
    nominal, full = real_ur10.fits(series)
    assert real_ur10.position_rms(nominal) == pytest.approx(before, abs=0.03e-3)
    assert real_ur10.position_rms(full) == pytest.approx(after, abs=0.02e-3)
    assert full.observability.rank == 30
    left = real_ur10.left_by(full, series)
    geometry = real_ur10.held_out(left)
    warm = dict(real_ur10.extensions(left))["tracker or base by room temperature"]
    gain, half = real_ur10.margin(geometry, real_ur10.held_out(left, warm))
    assert gain < half + 0.005e-3  # no effect of temperature
    curved = real_ur10.held_out(left, real_ur10.curves(left, (0, 1, 2)))
    gain, half = real_ur10.margin(geometry, curved)
    assert gain - half > 0.2e-3
    assert real_ur10.rms(curved) < 0.22e-3
    shuffled = replace(series, joint=np.random.default_rng(2).permutation(series.joint))
    placebo = real_ur10.curves(replace(left, series=shuffled), (0, 1, 2))
    assert real_ur10.margin(geometry, real_ur10.held_out(left, placebo))[0] < 0.005e-3


@pytest.mark.real
@present(ARM)
def test_two_series_four_months_apart_tell_the_same_curve_of_joint_3():
    lefts = []
    for name in "AC":
        series = sampled(real_ur10.read(ARM / real_ur10.SERIES[name]), 1500)
        lefts.append(real_ur10.left_by(real_ur10.fits(series)[1], series))
    assert real_ur10.agreement(*lefts, 2)[0] > 0.9


def simulated(rng, n, size):
    """An arm with errors of its dimensions, a wave of 17 periods in joint 3, and a tilted base."""
    tool, mount = np.array([0.01, -0.02, 0.1]), np.array([0.5, 0.3, -0.8])
    arm = SerialArm(
        replace(UR10, tool=tool, mount=mount), replace(real_ur10.TOLERANCES, tool=1e-3, mount=1e-3)
    )
    p = arm.parameters
    joint = rng.uniform(-2.5, 2.5, (n, 6))
    wave = np.zeros((n, 6))
    wave[:, 2] = size * np.sin(17 * joint[:, 2])
    x = arm.forward(joint + wave, p.nominal + p.prior * rng.standard_normal(len(p)))
    base = Rotation.from_rotvec([0.2, -0.4, 1.5]).as_matrix()
    point = x[:, :3] @ base.T + [1.0, -2.0, 0.3] + 30e-6 * rng.standard_normal((n, 3))
    clock = np.linspace(-1, 1, n)
    return real_ur10.Series(joint, point, base @ arm.rotation(x), 3600 * clock, 20 + clock)


def test_a_wave_of_one_joint_is_found_there_and_only_there():
    rng = np.random.default_rng(3)
    series = simulated(rng, 800, 0.3e-3)
    left = real_ur10.left_by(real_ur10.fits(series)[1], series)
    geometry = real_ur10.held_out(left)
    gains = [
        real_ur10.margin(geometry, real_ur10.held_out(left, real_ur10.curves(left, (joint,))))[0]
        for joint in range(3)
    ]
    assert gains[2] > 0.05e-3 > 0.01e-3 > max(gains[:2])
    at = np.linspace(-2.2, 2.2, 200)
    curve = real_ur10.curve_of(left, 2, at, (0, 1, 2))
    assert np.corrcoef(curve, np.sin(17 * at))[0, 1] > 0.95


def test_without_a_wave_no_extension_helps():
    series = simulated(np.random.default_rng(4), 800, 0.0)
    left = real_ur10.left_by(real_ur10.fits(series)[1], series)
    geometry = real_ur10.held_out(left)
    assert real_ur10.rms(geometry) < 60e-6  # 52 um of this are noise
    for name, columns in real_ur10.extensions(left):
        assert real_ur10.margin(geometry, real_ur10.held_out(left, columns))[0] < 1e-6, name


@pytest.mark.real
@present(ARM)
def test_curves_of_the_joints_foretell_places_that_they_have_not_seen(tmp_path):
    """With every seventh pose, imported as a user would; the arm's page has the full study."""
    lines = (ARM / real_ur10.SERIES["C"]).read_text(encoding="utf-8").splitlines(keepends=True)
    table = tmp_path / "some.csv"
    table.write_text("".join([lines[0], *lines[1::7]]), encoding="utf-8")
    mapping = "benchmarks/real_arms/ur10_mapping.yaml"
    session = str(tmp_path / "session")
    given = ["--robot", "ur10", "--mapping", mapping, "--out", session]
    assert run(["import", str(table), *given]) == 0
    robot = load_robot("ur10")
    start = calibrated(survey(read_session(session), robot.joints.names), robot)
    arm = robot.model()
    curve = JointCurve.over(robot, arm, start.evidence.at.joint, real_ur10.KNOT)
    term = Candidate(curve.cause, curve.kind, None, curve, tuple(range(len(curve.parameters))))
    held = HeldOutModels(start.fitted((term,)))
    without, with_ = (held.mm(held.terms(m, held.sectors)) for m in ((), (term,)))
    assert with_ < 0.5 * without
    assert with_ < 0.3  # [mm]
