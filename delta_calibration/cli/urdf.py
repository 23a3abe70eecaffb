"""`delta-cal urdf`: a robot as URDF, for RViz, Foxglove and robot_state_publisher."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.options import robot_option, write_or_print
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.description import describe, urdf
from delta_calibration.robot import load_robot


@verb("urdf")
@robot_option
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    default=None,
    help="Calibration whose dimensions and tracker frame are used instead of the nominal ones.",
)
@click.option(
    "--frame-prefix",
    default="",
    help="Prefix of the link names, such as left/, for one of several robots.",
)
@click.option(
    "--out",
    type=OUTPUT,
    default=None,
    help="File to write; printed if not given.",
)
def command(
    robot_file: str, calibration: Path | None, frame_prefix: str, out: Path | None
) -> None:
    """Write the robot as URDF, for display.

    URDF has no closed chains: the platform hangs on the first strut, and the passive joint values
    published by the node `robot_description` bring the ends of the other struts to it. The shapes
    are for display only; there are no masses and no collision shapes.
    """
    robot = load_robot(robot_file)
    known = None if calibration is None else load_calibration(calibration, robot)
    text = urdf(describe(robot, known).tree, frame_prefix)
    write_or_print(out, text)
