"""Check whether what a mechanism defines fits together; most faults would give wrong commands."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain

import numpy as np

from delta_calibration.errors import ConfigError, InputError
from delta_calibration.mechanisms.base import Mechanism

_NAMES = ("x", "y", "z", "a turn about x", "a turn about y", "a turn about z")  # of freedoms
_TURNS = 3  # freedoms from here on are turns
_NEAR = 1e-3  # [m, rad] by which coordinates of the home pose are displaced
_SAME = 1e-9  # [m, rad, 1] up to which two numbers are the same
_OWN = __name__.partition(".")[0]


def require_consistent(model: Mechanism) -> None:
    """Check limbs, priors, task and freedoms of a mechanism against each other.

    Raises:
        ConfigError: names what does not fit.
    """
    for fault in chain(_faults_of_parts(model), _faults_of_freedoms(model)):
        raise ConfigError(f"mechanism {model.name}: {fault}")


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
        file = getattr(sys.modules[kind.__module__], "__file__", None) or kind.__module__
        frames = traceback.extract_tb(error.__traceback__)
        own = next((frame for frame in reversed(frames) if frame.filename == file), None)
        where = f"{file}, line {own.lineno}, in {own.name}" if own else file
        what = str(error).strip().partition("\n")[0] or "no reason given"
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


def _faults_of_freedoms(model: Mechanism) -> Iterator[str]:
    """Commanded coordinates have to be the first of a pose, and the freedoms that are stated."""
    size, freedoms = model.task_size, model.freedoms
    if len(freedoms) != size or not set(freedoms) <= set(range(len(_NAMES))):
        yield f"freedoms: {freedoms} is not allowed; {size} different ones of 0 to 5"
        return
    home = np.asarray(model.home_pose, dtype=float)
    poses = home + _NEAR * np.eye(size + 1, len(home), -1)  # home, then each displaced
    task = model.task(model.position(poses), model.turn(poses))
    if task.shape != (len(poses), size) or np.abs(task - poses[:, :size]).max() > _SAME:
        yield (
            f"task(position(x), turn(x)) is not the first {size} of the pose's coordinates: "
            "`point`, `turn`, `task` and `task_size` do not fit together"
        )
        return
    moved = model.point_by_pose(home[None], np.zeros(3))[0]
    for number, freedom in enumerate(freedoms):
        along = np.eye(3)[freedom] if freedom < _TURNS else np.zeros(3)
        if np.abs(moved[:, number] - along).max() > _SAME:
            yield (
                f"freedoms: coordinate {number + 1} of the pose is stated to be "
                f"{_NAMES[freedom]}, but moves the platform by "
                f"{np.round(moved[:, number], 6).tolist()}: `freedoms` and `point` do not fit "
                "together"
            )
            return
