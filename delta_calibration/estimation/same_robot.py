"""Whether the poses of a session are those of this robot, by the size of the residuals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses
from delta_calibration.effects import Stage, catalogue
from delta_calibration.errors import DataError
from delta_calibration.estimation.problem import Problem
from delta_calibration.estimation.solver import solve
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

FEWEST = 12  # different places; fewer cannot determine a model of two dozen parameters
_ANOTHER_ROBOT = 4.0  # residual over what tolerances explain: too large for manufacturing errors
_PARTS = 6  # of a session, each with a frame of its own, where something moved in between
_RMS_OF_MEDIAN = 1.126  # RMS over median of the norm of three standard normal numbers


def require_this_robot(problem: Problem, poses: Poses, robot: Robot) -> None:
    """Refuse residuals that are many times larger than the tolerances explain.

    The medians of both are compared, with gross errors left out if they decide: one reading of
    another reflector does not make another robot, and tolerances have an untypical effect near a
    singularity. Reflector offset and tracker frame are not parts of the robot and do not count
    among what its tolerances explain. A tracker that was pushed, or a joint that slipped, makes no
    other robot: most parts of the session in the order of time fit it, each in a frame of its own.
    If tolerances do not explain the residuals, effects of usual size in drives and parts count.

    Args:
        problem: with all parameters free and the drawing's priors.
        poses: the measured poses.
        robot: drawing and tolerances.

    Raises:
        DataError: another robot, or other units.
    """
    layout = problem.layout
    geometry = layout.geometry
    placed = problem.only(~layout.mask(geometry, layout.effects))
    # at the nominal machine: a badly fitted reflector offset would magnify the tolerances' effect
    slope = problem.chain.jacobian(problem.at, problem.theta0[layout.chain])[..., geometry]
    spread = slope * problem.chain.mechanism.parameters.prior
    expected = float(np.median(np.linalg.norm(spread, axis=(1, 2))))
    most = _ANOTHER_ROBOT * expected
    typical = _typical(placed, False)
    if typical > most:
        typical = _typical(placed, True)
    if typical > most:
        expected = _expected_with_effects(problem, robot, spread)
        most = _ANOTHER_ROBOT * expected
    if typical > most and not _fits_in_parts(placed, poses, most):
        raise DataError(
            f"{poses.source}: {typical * 1e3:.1f} mm (robust RMS) remain between robot "
            f"{robot.name!r} in its best-fit frame and the tracker, while its tolerances and "
            f"usual effects explain {expected * 1e3:.1f} mm: is it the session of another robot, "
            "or are joint zeros or units different? `delta-cal check` finds such mistakes"
        )


def _expected_with_effects(problem: Problem, robot: Robot, spread: Array) -> float:
    """Median displacement by the tolerances and by effects of usual size in drives and parts [m].

    Pulleys can move a cable robot farther than the tolerances of its anchors do.

    Args:
        problem: of the poses.
        robot: drawing and tolerances.
        spread: displacement by each tolerance, (n, 3, p) [m].
    """
    chain, at = problem.chain, problem.at
    square = np.sum(spread**2, axis=(1, 2))
    for effect in catalogue(robot, chain.mechanism):
        of_robot = effect.stage in (Stage.DRIVE, Stage.STRUCTURE)
        if not of_robot or effect.free_form or effect.lacking or effect.missing(at):
            continue
        own = chain.with_effects((effect,))
        theta = np.append(problem.theta0[problem.layout.chain], effect.about)
        slope = own.jacobian(at, theta)[..., own.layout.effects] * effect.parameters.prior
        square = square + np.nan_to_num(np.sum(slope**2, axis=(1, 2)))
    return float(np.median(np.sqrt(square)))


def _typical(problem: Problem, robust: bool) -> float:
    """Robust root mean square of the distances that a fit leaves [m]."""
    return _RMS_OF_MEDIAN * float(np.median(solve(problem, robust=robust).distances))


def _fits_in_parts(placed: Problem, poses: Poses, most: float) -> bool:
    """Whether all parts of a session but one leave at most so much, each in its own frame [m].

    Each of at least three parts needs as many different places as a fit; a frame follows fewer.
    """
    count = min(_PARTS, len(poses) // FEWEST)
    parts = np.array_split(np.argsort(poses.time, kind="stable"), max(count, 1))
    if count < 3 or min(len(np.unique(poses.place[rows])) for rows in parts) < FEWEST:
        return False
    left = sorted(_typical(placed.take(np.sort(rows)), True) for rows in parts)
    return left[-2] <= most
