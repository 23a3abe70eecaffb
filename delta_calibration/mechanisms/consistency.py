"""Check whether what a mechanism defines fits together; most faults would give wrong commands."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from delta_calibration.errors import ConfigError, InputError
from delta_calibration.mechanisms.base import Mechanism

FREEDOMS = ("x", "y", "z", "a turn about x", "a turn about y", "a turn about z")
_TURNS = 3  # freedoms from here on are turns
_NEAR = 1e-3  # [m, rad] by which coordinates of the home pose are displaced
_SAME = 1e-9  # [m, rad] up to which two coordinates are the same
_ALIKE = 0.1  # [1] up to which a displacement is that of a freedom; rotations are not quite linear
_OWN = __name__.partition(".")[0]


def require_consistent(model: Mechanism, masses: Any = None) -> None:
    """Check limbs, priors, task, freedoms and masses of a mechanism against each other.

    Args:
        model: the mechanism.
        masses: section of the robot file, if it has one.

    Raises:
        ConfigError: names what does not fit.
    """
    for fault in _faults(model, masses):
        raise ConfigError(f"mechanism {model.name}: {fault}")


def _faults(model: Mechanism, masses: Any) -> Iterator[str]:
    yield from _faults_of_parts(model)
    yield from _faults_of_freedoms(model)
    yield from _faults_of_masses(model, masses)


@contextmanager
def faults_told(kind: type[Mechanism], source: str) -> Iterator[None]:
    """Tell an error in the code of another package's mechanism by its place in that code.

    Raises:
        ConfigError: names the robot file, the mechanism, its file, line and function.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # whatever a foreign mechanism does
        if kind.__module__.partition(".")[0] == _OWN:
            raise
        file = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
        frames = traceback.extract_tb(error.__traceback__)
        own = next((frame for frame in reversed(frames) if frame.filename == file), None)
        where = f"{file}, line {own.lineno}, in {own.name}" if own else f"{file}, as it is used"
        what = next(filter(None, map(str.strip, str(error).splitlines())), "no reason given")
        raise ConfigError(
            f"{source}: mechanism {kind.name} ({where}): {type(error).__name__}: {what}"
        ) from error


def _faults_of_parts(model: Mechanism) -> Iterator[str]:
    for item in model.parameters:
        if not item.prior > 0:
            yield f"prior {item.prior:g} of parameter {item.name} is not allowed; more than 0"
    limbs, known = model.limbs, len(model.parameters) + len(model.fixed)
    for number, limb in enumerate(limbs, 1):
        for what, count in (("joints", model.joints), ("dimensions", known)):
            for index in getattr(limb, what):
                if not 0 <= index < count:
                    yield f"limb {number}: {what}: {index} is not allowed; 0 to {count - 1}"
        for what in ("joints", "dimensions", "rows", "constants"):
            own, first = len(getattr(limb, what)), len(getattr(limbs[0], what))
            if own != first:
                yield f"limb {number} has {own} {what}, limb 1 has {first}; all have as many"
    joints = {joint for limb in limbs for joint in limb.joints}
    if joints != set(range(model.joints)):
        yield f"limbs: no limb has joint {min(set(range(model.joints)) - joints)}"
    rows = {row for limb in limbs for row in limb.rows}
    if rows != set(range(len(rows))) or len(rows) < model.pose_size:
        yield (
            f"limbs: rows {sorted(rows)} of the closure are not allowed; all from 0 on, and at "
            f"least {model.pose_size}, as many as the pose has coordinates"
        )


def _faults_of_freedoms(model: Mechanism) -> Iterator[str]:
    """Commanded coordinates have to be the first of a pose, and the freedoms that are stated."""
    size, freedoms = model.task_size, model.freedoms
    if len(freedoms) != size or len(set(freedoms) & set(range(len(FREEDOMS)))) != size:
        yield f"freedoms: {freedoms} is not allowed; {size} different ones of 0 to 5"
        return
    home = np.asarray(model.home_pose, dtype=float)
    poses = home + _NEAR * np.eye(size + 1, len(home), -1)  # home, then each displaced
    position, turn = model.position(poses), model.turn(poses)
    task = model.task(position, turn)
    if task.shape != (len(poses), size) or np.abs(task - poses[:, :size]).max() > _SAME:
        yield (
            f"task(position(x), turn(x)) is not the first {size} of the pose's coordinates: "
            "`point`, `turn`, `task` and `task_size` do not fit together"
        )
        return
    moved = np.concatenate([position, turn], axis=1)
    moved = (moved[1:] - moved[0]) / _NEAR  # (size, 6)
    level = np.abs(turn[0]).max() <= _SAME  # else turns about several axes do not add up
    for number, freedom in enumerate(freedoms):
        if freedom < _TURNS:
            fits = np.abs(moved[number, :_TURNS] - np.eye(_TURNS)[freedom]).max() <= _ALIKE
        else:
            fits = not level or abs(moved[number, freedom] - 1) <= _ALIKE
        if not fits:
            yield (
                f"freedoms: coordinate {number + 1} of the pose is stated to be "
                f"{FREEDOMS[freedom]}, but moves and turns the platform by "
                f"{np.round(moved[number], 6).tolist()}: `freedoms`, `point` and `turn` do not "
                "fit together"
            )
            return


def _faults_of_masses(model: Mechanism, masses: Any) -> Iterator[str]:
    """Weights, inertia, levers and pivots belong to the same masses."""
    if masses is None:
        return
    count = len(model.weights(masses))
    each = {
        "weights(None)": model.weights(None),
        "moving": model.moving(masses),
        "levers": model.levers,
        "pivots": model.pivots,
    }
    for name, values in each.items():
        if len(values) != count:
            yield f"masses: weights gives {count} masses, {name} {len(values)}"
