"""A measured six-rod machine and its identification, shared by the tests of identification."""

from __future__ import annotations

from functools import cache

import numpy as np

from delta_calibration.data import at_rest
from delta_calibration.estimation import identify
from delta_calibration.robot import load_robot
from six_rods import Cell, SixRods, workspace

ROBOT = load_robot("srbd")
PARAMETERS = ROBOT.model("six_rod_delta").parameters


def errors(rng, scale=1.0):
    drawn = scale * PARAMETERS.prior * rng.standard_normal(len(PARAMETERS))
    return dict(zip(PARAMETERS.names, drawn, strict=True))


@cache
def found(seed):
    """A machine with realistic errors, 40 places measured twice, and its identification."""
    rng = np.random.default_rng(seed)
    cell = Cell(SixRods(errors(rng)), tuple(2e-3 * rng.standard_normal(3)))
    q = np.repeat(workspace(40, rng), 2, axis=0)
    poses = cell.measure(q, rng)
    return cell, poses, identify(poses, ROBOT)


def prediction(result, q):
    return result.chain.predict(at_rest(q), result.theta)


def rms(vectors):
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def slope_of(poses):
    """dy/dq of the nominal machine by finite differences, (n, 3, 3)."""
    cell, h = Cell(SixRods()), 1e-6
    columns = [
        cell.reading(poses.joint + h * e) - cell.reading(poses.joint - h * e) for e in np.eye(3)
    ]
    return np.stack(columns, axis=-1) / (2 * h)
