"""The same machine with drives that count in the other direction, from another zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delta_calibration.data import JointStream, Session
from delta_calibration.robot import Robot, load_robot, robot_document, robot_from

SIGNS = np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
ZEROS = {"rad": np.array([90.0, -30.0, 12.5, 0.0, 400.0, -7.0, 33.0, 1.0]), "m": None}
SLIDES = np.array([250.0, -30.0, 1000.0, 12.5])  # [mm]


def other_document(name: str) -> dict:
    """Robot file of such a machine, with limits and home in drive readings."""
    data = robot_document(name)[1]
    joints, m = data["joints"], len(data["joints"]["names"])
    slides = "lower_mm" in joints
    unit = "mm" if slides else "deg"
    sign, zero = SIGNS[:m], (SLIDES if slides else ZEROS["rad"])[:m]
    ends = sign * np.array([joints[f"lower_{unit}"], joints[f"upper_{unit}"]]) + zero
    told = {
        "sign": [int(s) for s in sign],
        f"zero_{unit}": zero.tolist(),
        f"lower_{unit}": ends.min(axis=0).tolist(),
        f"upper_{unit}": ends.max(axis=0).tolist(),
    }
    geometry = data["geometry"]
    if "home_deg" in geometry:
        geometry = {**geometry, "home_deg": (sign * geometry["home_deg"] + zero).tolist()}
    return {**data, "geometry": geometry, "joints": {**joints, **told}}


def other(name: str) -> tuple[Robot, Robot]:
    """A robot and the same machine with other drives."""
    return load_robot(name), robot_from(other_document(name), name)


def in_readings(session: Session, robot: Robot) -> Session:
    """A session of the plain robot in the readings of the other drives."""

    def told(stream: JointStream | None) -> JointStream | None:
        if stream is None:
            return None
        return replace(stream, position=robot.drives.read(stream.position))

    return replace(session, command=told(session.command), states=told(session.states))
