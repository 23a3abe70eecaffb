"""Time of one corrected command on each robot, alone, on one core."""

from __future__ import annotations

import time

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.compensation import JointCompensator
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine

COMMANDS, SEED = 40, 4
EVERYWHERE = Region(10.0 * (2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0))  # [m]


def milliseconds(name: str) -> float:
    """Mean time over the commands of a plan; the machine's parameters are known exactly."""
    robot = load_robot(name)
    machine = draw_machine(robot, SEED)
    ends = robot.joints.lower, robot.joints.upper
    known = Calibration(
        robot, machine.chain, machine.theta, EVERYWHERE, *ends, 1e-5, "drawn", "seal"
    )
    compensator = JointCompensator(known)
    commands = make_plan("identify", robot, count=COMMANDS, both_sides=False).joint
    compensator.compensate(commands[:1])  # compiles
    begin = time.process_time()
    for q in commands:
        compensator.compensate(q[None])
    return 1e3 * (time.process_time() - begin) / COMMANDS


if __name__ == "__main__":
    for robot in known_robots():
        print(f"{robot:14s} {milliseconds(robot):6.2f} ms a command")
