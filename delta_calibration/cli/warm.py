"""Compile in advance the code that is compiled on first use: the last step of `make install`."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from time import monotonic

import click
import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.cell.usual import warm_up
from delta_calibration.compensation import TABLE, JointCompensator, TableSettings, methods_for
from delta_calibration.data import survey
from delta_calibration.estimation import identify
from delta_calibration.estimation.measurements import bare_chain
from delta_calibration.geometry import Frame
from delta_calibration.laws import every_law, prepare
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

_COUNT = 20  # places that a machine is fitted to
_ABOUT = 0.01  # [m] around the targets where compensation is allowed
_FIRST = "srbd"  # the robot with the fewest laws


@click.command()
def command() -> None:
    """Compile all laws and the loops over samples, and keep them for every later process.

    The laws at the same time in another process: loops call them by their addresses.
    """
    began = monotonic()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        laws = pool.submit(_prepare)
        _fit(_FIRST)
        _compensate(_FIRST)
        count = laws.result()
    for name in known_robots():
        _fit(name)
        _compensate(name)
    click.echo(f"compiled: {count} laws and the loops over samples ({monotonic() - began:.0f} s)")


def _prepare() -> int:
    return prepare(every_law())


def _fit(name: str) -> None:
    """Measure and fit a small simulated cell: numba compiles what is called."""
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=_COUNT, seed=0)
    session = simulate_session(draw_machine(robot, 0), plan, 0)
    identify(survey(session, robot.joints.names).poses, robot)


def _compensate(name: str) -> None:
    """Compensate a few commands with the nominal dimensions, singly and by every method."""
    robot = load_robot(name)
    chain, limits = bare_chain(robot.model()), (robot.joints.lower, robot.joints.upper)
    theta = chain.join(chain.mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    disc = make_plan("disc", robot, count=8, both_sides=False)
    region = Region.of(np.concatenate([disc.target + shift for shift in (-_ABOUT, _ABOUT)]))
    calibration = Calibration(robot, chain, theta, region, *limits, 0.0, "", "")
    for method in methods_for(robot.commanded):
        table = TableSettings() if method == TABLE else None
        JointCompensator(calibration, method, table=table).compensate(disc.joint)
    warm_up(JointCompensator(calibration))


if __name__ == "__main__":
    command()
