"""`--priors`: priors from a fleet for the next machine of its type."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:  # work without priors need not load a fleet's code
    from delta_calibration.estimation import Population
    from delta_calibration.robot import Robot

priors_option = click.option(
    "--priors",
    "priors_file",
    type=click.Path(path_type=Path),
    default=None,
    help="File of priors, written by `delta-cal fleet priors`, to use instead of the tolerances.",
)


def population_in(file: Path | None, robot: Robot, model: str | None) -> Population | None:
    """The population of a file of priors; None without a file.

    Raises:
        ConfigError: not a file of priors, or one of another robot or model.
    """
    if file is None:
        return None
    from delta_calibration.fleet.priors import read_priors

    return read_priors(file, robot, model)
