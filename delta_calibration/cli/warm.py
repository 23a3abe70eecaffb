"""Compile in advance the code that is compiled on first use: the last step of `make install`."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from time import monotonic

import click

from delta_calibration.calibration_file import from_identification
from delta_calibration.cell.usual import warm_up
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import survey
from delta_calibration.estimation import identify
from delta_calibration.laws import every_law, folder, prepare
from delta_calibration.model.law import Law
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

_COUNT = 20  # places that a machine is fitted to
_FIRST = "srbd"  # whose few laws are compiled with the loops, beside all others


@click.command()
def command() -> None:
    """Compile all laws and the loops over samples, and keep them for every later process.

    The laws in other processes, as each is compiled by itself; the loops, which take half of the
    time, in this one.
    """
    began = monotonic()
    others = max(1, (os.cpu_count() or 1) - 1)
    with ProcessPoolExecutor(others, mp_context=get_context("spawn")) as pool:
        counts = pool.map(_prepared, range(len(_laws())))
        _use(_FIRST)
        count = sum(counts)
    for name in known_robots():
        _use(name)
    click.echo(f"compiled: {count} laws and the loops over samples ({monotonic() - began:.0f} s)")


@cache
def _laws() -> tuple[Law, ...]:
    """All laws, the largest first, so that no process waits for a large one at the end."""
    made = {path.stem: path.stat().st_size for path in folder().glob("*.py")}
    return tuple(sorted(every_law(), key=lambda law: -made.get(law.name, 0)))


def _prepared(number: int) -> int:
    return prepare([_laws()[number]])


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
