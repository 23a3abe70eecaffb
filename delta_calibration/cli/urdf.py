"""`delta-cal urdf`: a robot as URDF, for RViz, Foxglove and robot_state_publisher."""

from __future__ import annotations

from pathlib import Path

import click

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.options import robot_option, write_or_print
from delta_calibration.description import describe, urdf
from delta_calibration.robot import load_robot


@click.command("urdf", short_help="the robot as URDF, for RViz and Foxglove")
@robot_option
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    default=None,
    help="The robot as identified, with the tracker's frame, in place of the drawing.",
)
@click.option(
    "--frame-prefix",
    default="",
    help="Put before the names of links, such as left/: for one robot among several.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="File to write; else printed."
)
def command(
    robot_file: str, calibration: Path | None, frame_prefix: str, out: Path | None
) -> None:
    """Print the robot as URDF.

    Closed chains are trees there: the platform hangs on the first strut, and the values of the
    passive joints, which the node `robot_description` publishes, bring the others' ends to it.
    Shapes are for the eye: no masses, no collision.
    """
    robot = load_robot(robot_file)
    known = None if calibration is None else load_calibration(calibration, robot)
    text = urdf(describe(robot, known).tree, frame_prefix)
    write_or_print(out, text)
