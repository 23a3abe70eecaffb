"""A slider's wrong pitch, and the place where its reading is true."""

from __future__ import annotations

from dataclasses import replace

import pytest

from delta_calibration.data import JointStream, Session, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("five_axis")
ZERO, SIZE = ROBOT.model().drives.zero, ROBOT.commanded.joint_size


def misread(session: Session, joint: int, pitch: float, home: float) -> Session:
    """The session, with a slider that moves by 1 + pitch of its reading from `home` on."""

    def read(stream: JointStream) -> JointStream:
        position = stream.position.copy()
        position[:, joint] = home + (position[:, joint] - home) / (1 + pitch)
        return replace(stream, position=position)

    assert session.command is not None
    assert session.states is not None
    return replace(session, command=read(session.command), states=read(session.states))


@pytest.mark.parametrize(("home", "pitch"), [(0.0, 2e-4), (1.6, 8e-4)])
def test_a_pitch_is_named_alone_wherever_the_slider_was_homed(home: float, pitch: float) -> None:
    """Homed at 1.6 m, it looked like a wrong pitch, a wrong zero and wrong dimensions."""
    plan = make_plan("identify", ROBOT, count=40, seed=4)
    clean = simulate_session(draw_machine(ROBOT, 4), plan, 4)
    seen = survey(misread(clean, 1, pitch, home), ROBOT.joints.names, SIZE)
    verdict = diagnose(seen, ROBOT, seed=4).verdict
    (finding,) = verdict.findings
    assert (finding.cause, finding.location) == ("slider_pitch", "joint_2")
    value = finding.parameters["pitch_2"]
    assert abs(value.value - pitch) < 3 * value.std
    if home:
        place = finding.shape["true_at_m"]
        assert not isinstance(place, str)
        assert abs(place.value - (home - ZERO[1])) < 3 * place.std
