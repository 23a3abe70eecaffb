"""Compares joint commands with joint states and finds mistakes that make them differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Session
from delta_calibration.doctor.change import COMMAND, STATES, Change, joints_of
from delta_calibration.doctor.hypotheses import (
    DEGREES,
    LENGTHS,
    offset_joint,
    reversed_joints,
    swapped,
    turns_in,
    unit_of_joints,
)
from delta_calibration.doctor.placing import place
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_ALIKE = 0.02  # share of a joint's range by which the streams may differ
_APART = 5e-3  # [rad of a Delta] least constant difference that is an offset
_SCATTERS = 5.0  # least offset in units of the scatter
_NEAR = 0.03  # relative deviation of a slope from the factor of a unit
_CLEARLY = 0.5  # of the other stream's misfit


@dataclass(frozen=True)
class Relation:
    """Relation of a stream to the true joints: true_j = slope_j * recorded[order_j] + shift_j."""

    order: tuple[int, ...]
    slope: Array  # (m,)
    shift: Array  # (m,) in the unit of the true joints
    misfit: float  # largest share of a joint's range
    scatter: Array  # (m,)


def wiring(stops: Session, robot: Robot) -> list[tuple[Change, str]]:
    """Changes that make command and state agree, each with its evidence; usually none."""
    if stops.command is None or stops.states is None:
        return []
    size = robot.commanded.joint_size
    if _agree(stops.command.position, stops.states.position, size):
        return []
    wrong = _wrong_one(stops, robot)
    right = STATES if wrong == COMMAND else COMMAND
    recorded, true = joints_of(stops, wrong), joints_of(stops, right)
    assert recorded is not None
    assert true is not None
    relation = _related(recorded.position, true.position)
    if relation.misfit > _ALIKE:
        return []
    evidence = (
        f"at {len(true.position)} stops it then matches {right} within "
        f"{100 * relation.misfit:.2g} % of its range, and the tracker agrees with {right}"
    )
    return [(change, evidence) for change in _changes(relation, robot, wrong)]


def _agree(command: Array, states: Array, size: float) -> bool:
    apart = command - states
    span = np.maximum(np.ptp(states, axis=0), 1e-9)
    constant = np.abs(np.median(apart, axis=0))
    scatter = np.median(np.abs(apart - np.median(apart, axis=0)), axis=0)
    offset = (constant > _APART * size) & (constant > _SCATTERS * scatter)
    return not offset.any() and bool((np.sqrt((apart**2).mean(axis=0)) <= _ALIKE * span).all())


def _related(recorded: Array, true: Array) -> Relation:
    from scipy.optimize import linear_sum_assignment  # slow to load

    m = true.shape[1]
    slope, shift, misfit, scatter = (np.zeros((m, m)) for _ in range(4))
    span = np.maximum(np.ptp(true, axis=0), 1e-12)
    for j in range(m):
        for i in range(m):
            s, b, left = _straight(recorded[:, i], true[:, j])
            slope[j, i], shift[j, i], scatter[j, i] = s, b, left
            misfit[j, i] = left / span[j] + 1e-4 * (i != j) + 1e-5 * (s < 0)
    rows, order = linear_sum_assignment(np.minimum(misfit, 1e3))
    return Relation(
        tuple(int(k) for k in order),
        slope[rows, order],
        shift[rows, order],
        float(misfit[rows, order].max()),
        scatter[rows, order],
    )


def _straight(x: Array, y: Array) -> tuple[float, float, float]:
    """Slope, intercept and scatter (median distance) of a robust line through the points."""
    weight = np.ones(len(x))
    slope, shift, left = 0.0, 0.0, np.inf
    for _ in range(5):
        centre = np.average(x, weights=weight), np.average(y, weights=weight)
        spread = float((weight * (x - centre[0]) ** 2).sum())
        if spread <= 0:
            return 0.0, float(np.median(y)), float(np.ptp(y))
        slope = float((weight * (x - centre[0]) * (y - centre[1])).sum()) / spread
        shift = float(centre[1] - slope * centre[0])
        away = np.abs(y - slope * x - shift)
        left = float(np.median(away))
        weight = 1 / (1 + (away / max(3 * left, 1e-12)) ** 2)
    return slope, shift, left


def _wrong_one(stops: Session, robot: Robot) -> str:
    """Name of the stream that contradicts the tracker, or else the joint limits and home."""
    for apart in (False, True):  # left-handed frames only if neither fits: they fit too easily
        left = {n: place(stops, robot, n, True, apart).typical for n in (COMMAND, STATES)}
        low, high = sorted(left.values())
        if low < _CLEARLY * high:
            return max(left, key=lambda name: left[name])
    beyond = {}
    for name in (COMMAND, STATES):
        joints = joints_of(stops, name)
        assert joints is not None
        q, limits = joints.position, robot.joints
        out = np.maximum(q - limits.upper, 0) + np.maximum(limits.lower - q, 0)
        home = np.abs(np.median(q, axis=0) - robot.commanded.home).sum()
        beyond[name] = float(out.sum()), float(home)
    return STATES if beyond[STATES] > beyond[COMMAND] else COMMAND


def _changes(relation: Relation, robot: Robot, wrong: str) -> list[Change]:
    """The relation as a list of changes that are applied one after the other."""
    changes = []
    order, m = relation.order, len(relation.order)
    if order != tuple(range(m)):
        changes.append(swapped(robot, (wrong,), order))
    turning = robot.joints.unit == "rad"
    factors = (DEGREES,) if turning else tuple(f for _, _, f in LENGTHS)
    slope = np.abs(relation.slope)
    for change, factor in zip(unit_of_joints(robot, (wrong,)), factors, strict=True):
        if (np.abs(slope * factor - 1) < _NEAR).all():
            changes.append(change)
    changes += [reversed_joints(robot, (wrong,), (j,)) for j in range(m) if relation.slope[j] < 0]
    size = robot.commanded.joint_size
    for j in range(m):
        shift = float(relation.shift[j])
        if abs(shift) > max(_APART * size, _SCATTERS * relation.scatter[j]):
            turns = turns_in(robot, shift)
            value = 2 * np.pi * turns if turns else shift
            changes.append(offset_joint(robot, (wrong,), j, -value))
    return changes
