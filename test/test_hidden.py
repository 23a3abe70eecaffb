"""Table of a demonstration: hidden and found causes, and values that have the same meaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cli.hidden import hidden_and_found
from delta_calibration.data import collect
from delta_calibration.effects import effect_named
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, effect_options, simulate_session

SCARA = load_robot("scara")


@pytest.fixture(scope="module")
def fitted():
    """Fit of a session of the SCARA, its poses, and the machine in which a drift is hidden."""
    machine = draw_machine(SCARA, 7, 1.0, [effect_options("joint_zero_drift:time_constant=2400")])
    session = simulate_session(machine, make_plan("identify", SCARA, count=24, seed=7), 7)
    poses = collect(session, SCARA.joints.names, SCARA.commanded.joint_size)
    return identify(poses, SCARA), poses, machine


def table_of(fitted, folder, effects, size=1e-4):
    """Table beside a calibration that was extended by these effects, all their values alike."""
    found, poses, machine = fitted
    chain = found.chain.with_effects(effects)
    values = np.full(sum(len(effect.parameters) for effect in effects), size)
    theta = np.concatenate([found.theta, values])
    covariance = np.eye(len(theta)) * 1e-10
    uncertainty = replace(found.uncertainty, covariance=covariance)
    extended = replace(
        found, chain=chain, theta=theta, covariance=covariance, uncertainty=uncertainty
    )
    file = folder / "extended.yaml"
    save_calibration(file, extended, SCARA, poses)
    return hidden_and_found(machine, file)


def effect(cause, **shape):
    return effect_named(cause, SCARA, SCARA.model(), shape)


def test_values_of_one_course_are_compared(fitted, tmp_path):
    said = table_of(fitted, tmp_path, (effect("joint_zero_drift", time_constant=1800.0),))
    assert "100.0" in said
    assert "cannot be compared" not in said


def test_values_of_a_ramp_and_a_settling_are_not_compared(fitted, tmp_path):
    said = table_of(fitted, tmp_path, (effect("joint_zero_drift"),))
    assert "100.0" not in said
    assert (
        "joint zero drift: the cause is the same; it is hidden as settling and found as a ramp"
        in said
    )


def test_each_of_two_gears_is_compared_with_the_one_of_its_order(fitted, tmp_path):
    """Only the gear of 81 cycles has a second order; the other comes first."""
    found, poses, _ = fitted
    hidden = ("cycles=50,value=1e-4", "cycles=81,second=2,value=2e-4")
    causes = [effect_options(f"transmission_error:{text}") for text in hidden]
    gears = [
        effect("transmission_error", **shape)
        for shape in ({"cycles": 50.1}, {"cycles": 80.9, "second": 2.0})
    ]
    machine = draw_machine(SCARA, 7, 1.0, causes)
    said = table_of((found, poses, machine), tmp_path, tuple(gears))
    rows = [line for line in said.splitlines() if "second" in line]
    assert rows
    assert all("100.0" in row for row in rows)
