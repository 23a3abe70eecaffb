"""Compares a probe's rotations with the nominal robot's: wrong order, sense or axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Session
from delta_calibration.doctor import hypotheses
from delta_calibration.doctor.change import Answer
from delta_calibration.doctor.placing import Placed, place, turned_by
from delta_calibration.doctor.stops import thinned
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_TURNING = 0.02  # [rad] from which a platform counts as rotating
_STRAIGHT = 0.03, 0.15  # [rad] largest angle of a straight probe, least of one that is not
_CLEARLY = 4.0  # least factor by which the misfit must decrease
_TRIED = 80  # stops
DOUBTED = 0.03  # [rad] misfit of rotations from which they are in doubt


def turn_misfit(stops: Session, robot: Robot) -> tuple[float, bool] | None:
    """Misfit of the probe's rotations to the nominal robot [rad]; whether the platform rotates.

    If it does not rotate, the misfit is the angle of the probe from straight mounting. None if no
    rotations were recorded or the points do not fit.
    """
    if stops.tracker is None or stops.tracker.quaternion is None:
        return None
    placed = place(stops, robot)
    return _misfit(placed, stops.tracker.quaternion) if placed.found else None


def _misfit(placed: Placed, quaternion: Array) -> tuple[float, bool]:
    """The misfit of `turn_misfit`, for a nominal robot that was already fitted."""
    mount, about = turned_by(placed, quaternion)
    turned = placed.turned[np.isfinite(placed.pose).all(axis=1)]
    turning = float(np.median(np.linalg.norm(turned - turned.mean(axis=0), axis=(1, 2))))
    if turning > _TURNING:
        return float(np.median(about)), True
    angle = np.arccos(np.clip((np.trace(mount) - 1) / 2, -1.0, 1.0))
    return float(max(angle, np.median(about))), False


def doubt(score: tuple[float, bool] | None) -> float:
    """Misfit of rotations [rad]; infinite if not known."""
    return np.inf if score is None else score[0]


def turn_answer(stops: Session, robot: Robot) -> Answer | None:
    """Find a wrong order or sense of the rotations, or axes that only rotations show."""
    stops = thinned(stops, _TRIED)
    if stops.tracker is None or stops.tracker.quaternion is None:
        return None
    placed, quaternion = place(stops, robot), stops.tracker.quaternion
    if not placed.found:
        return None
    here = _misfit(placed, quaternion)
    if here[0] < (DOUBTED if here[1] else _STRAIGHT[1]):
        return None
    if not here[1] and _is_straight_some_way(placed, quaternion):
        return None
    scored = []
    for change in hypotheses.rotation_orders():  # these do not change the fit to the points
        tracker = change.undo(stops).tracker
        assert tracker is not None
        assert tracker.quaternion is not None
        scored.append((change, _misfit(placed, tracker.quaternion)[0]))
    for change in hypotheses.cyclic_axes():
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


def _is_straight_some_way(placed: Placed, quaternion: Array) -> bool:
    """Whether the axes of the probe are parallel to the platform's, in any order and sense."""
    mount, _ = turned_by(placed, quaternion)
    return bool(np.sort(np.abs(mount), axis=1)[:, 2].min() > np.cos(_STRAIGHT[0]))
