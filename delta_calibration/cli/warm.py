"""Compile now what is compiled on first use: the last step of `make install`."""

from __future__ import annotations

from time import monotonic

import click

from delta_calibration.calibration_file import from_identification
from delta_calibration.cell.usual import warm_up
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import survey
from delta_calibration.estimation import identify
from delta_calibration.laws import every_law, prepare
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

_COUNT = 20  # places that a machine is fitted to


@click.command()
def command() -> None:
    """Compile all laws and the loops over samples, and keep them for every later process."""
    began = monotonic()
    count = prepare(every_law())
    for name in known_robots():
        _use(name)
    click.echo(f"compiled: {count} laws and the loops over samples ({monotonic() - began:.0f} s)")


def _use(name: str) -> None:
    """Measure, fit and compensate a small simulated cell: numba compiles what is called."""
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=_COUNT, seed=0)
    session = simulate_session(draw_machine(robot, 0), plan, 0)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    made = from_identification(identify(seen.poses, robot), robot, seen.poses)
    disc = make_plan("disc", robot, count=4, both_sides=False)
    compensator = JointCompensator(made)
    compensator.compensate(disc.joint)
    warm_up(compensator)


if __name__ == "__main__":
    command()
