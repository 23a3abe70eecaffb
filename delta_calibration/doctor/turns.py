"""Turns of a probe against those of the drawing: order, sense, axes that only they tell."""

from __future__ import annotations

import numpy as np

from delta_calibration.doctor import hypotheses
from delta_calibration.doctor.change import Answer
from delta_calibration.doctor.placing import place, turned_by
from delta_calibration.doctor.stops import thinned
from delta_calibration.robot import Robot
from delta_calibration.samples import Session

_TURNING = 0.02  # [rad] by which a platform turns
_STRAIGHT = 0.03, 0.15  # [rad] of a probe mounted straight, and of one that is not
_CLEARLY = 4.0  # times less is left than before
_TRIED = 80  # stops
DOUBTED = 0.03  # [rad] of turns that a drawing leaves


def turn_misfit(stops: Session, robot: Robot) -> tuple[float, bool] | None:
    """How far turns of the probe are from the drawing's [rad], and whether the platform turns.

    On a platform that does not turn it is how far the probe is from being mounted straight. None
    where no turns were recorded or nothing fits.
    """
    if stops.tracker is None or stops.tracker.quaternion is None:
        return None
    placed = place(stops, robot)
    if not placed.found:
        return None
    mount, about = turned_by(placed, stops.tracker.quaternion, robot)
    pose = placed.pose[np.isfinite(placed.pose).all(axis=1)]
    turned = robot.model().rotation(pose)
    turning = float(np.median(np.linalg.norm(turned - turned.mean(axis=0), axis=(1, 2))))
    if turning > _TURNING:
        return float(np.median(about)), True
    angle = np.arccos(np.clip((np.trace(mount) - 1) / 2, -1.0, 1.0))
    return float(max(angle, np.median(about))), False


def doubt(score: tuple[float, bool] | None) -> float:
    """How far turns are from the drawing's [rad]; infinite where that is not known."""
    return np.inf if score is None else score[0]


def turn_answer(stops: Session, robot: Robot) -> Answer | None:
    """Order and sense of the tracker's turns, and axes that only turns tell."""
    stops = thinned(stops, _TRIED)
    here = turn_misfit(stops, robot)
    if here is None or here[0] < (DOUBTED if here[1] else _STRAIGHT[1]):
        return None
    if not here[1] and _is_straight_some_way(stops, robot):
        return None
    scored = []
    for change in (*hypotheses.rotation_orders(), *hypotheses.cyclic_axes()):
        score = turn_misfit(change.undo(stops), robot)
        if score is not None:
            scored.append((change, score[0]))
    change, least = min(scored, key=lambda pair: pair[1])
    if least > (DOUBTED if here[1] else _STRAIGHT[0]) or least * _CLEARLY > here[0]:
        return None
    evidence = (
        f"the probe's rotations then agree with the nominal robot within {1e3 * least:.2g} mrad, "
        f"as recorded within {1e3 * here[0]:.3g} mrad"
    )
    return Answer((change,), evidence)


def _is_straight_some_way(stops: Session, robot: Robot) -> bool:
    """Whether the probe is mounted at right angles: no reason for doubt."""
    placed = place(stops, robot)
    assert stops.tracker is not None
    assert stops.tracker.quaternion is not None
    mount, _ = turned_by(placed, stops.tracker.quaternion, robot)
    return bool(np.sort(np.abs(mount), axis=1)[:, 2].min() > np.cos(_STRAIGHT[0]))
