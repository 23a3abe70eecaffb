"""The chain of a machine taken backward, from the tool to the command, stage by stage.

    FK(q_b, g + S(c) v) = p*        joints q_b behind the drives: APSO or Newton at that geometry
    q' + D(c) v = q_b               what the drives are told, q': a few fixed-point steps

with c the conditions of the command, its joints those that are told. Effects of the measurement
are the tracker's and do not enter; what went by the clock of a session has ended with it.

A play is crossed as soon as the command turns round: the correction itself takes the joint across,
so that its travel since then, that of the *corrected* command, is never less than the gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.base import REACHED, Correction, Counts, distance
from delta_calibration.compensation.compiled import CompiledDrawing
from delta_calibration.compensation.machine import Machine
from delta_calibration.effects import Effect, Stage
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]
Live = list[tuple[Effect, Array]]

_STEP = 3e-4  # [m] no clearance that a machine is run with steps farther: see `Backward.correct`
_DRIVE_STEPS, _DRIVE_SETTLED = 20, 1e-9  # [rad]
_ROUNDS, _SAME = 3, 1e-7  # [m, rad] a geometry this near is the same


class Backward:
    """Finds the command for a point through geometry and drives of a calibrated machine.

    A command alone, compiled, takes 0.15 ms of one core without effects (2 GHz); drives by
    direction, speed or angle add 0.1 ms, by load 0.25, growth by a sensor 0.4 to 0.6. Dimensions
    that change with the load are computed anew for each command: 2 ms on three spheres, 8 on six
    rods, nearly all of it the load by numpy.

    Args:
        calibration: the identified chain.
        machine: at the identified geometry.
    """

    def __init__(self, calibration: Calibration, machine: Machine) -> None:
        self._machine = machine
        self._geometry = calibration.geometry
        self._last: tuple[bytes, Machine] = (self._geometry.tobytes(), machine)
        drawing = _drawing(calibration.robot, machine)
        self._drive: Live = [
            (replace(effect, mechanism=drawing), value)
            for effect, value in calibration.live
            if effect.stage is Stage.DRIVE
        ]
        self._structure: Live = [
            pair for pair in calibration.live if pair[0].stage is Stage.STRUCTURE
        ]

    @property
    def reshaping(self) -> tuple[str, ...]:
        """Causes by which the dimensions change from command to command."""
        return tuple(effect.cause for effect, _ in self._structure)

    @property
    def stages(self) -> bool:
        """Whether there is more than one geometry to go through."""
        return bool(self._drive or self._structure)

    def correct(self, at: Conditions, target: Array) -> Correction:
        """What to add to the commands at.joint (n, m) [rad] to reach the targets (n, d) [m].

        The error is that of the whole chain run forward at the corrected command. It is within
        `REACHED` where `converged`, but for one case: where a rod's force changes its sign with
        the correction itself, a clearance has no solution, and stays open by its own size at most.
        """
        if not self.stages:
            found = self._machine.solver.correct(at.joint, target)
            return replace(found, converged=found.error <= REACHED)
        at = replace(at, travel=np.full_like(at.travel, np.inf))
        geometry, evaluations = self._dimensions(at), np.zeros(len(at), dtype=np.int64)
        for _ in range(_ROUNDS):
            found = self._solve(geometry, at.joint, target)
            evaluations += found.evaluations
            told, stray = self._before_drives(at, at.joint + found.dq)
            before, geometry = geometry, self._dimensions(replace(at, joint=told))
            steady = (np.abs(geometry - before) <= _SAME).all(axis=-1)
            if steady.all():
                break
        error = self._missed(geometry, at.joint + found.dq + stray, target)
        good = (found.error <= REACHED) & (error <= np.where(steady, REACHED, _STEP))
        dq = np.where(np.isfinite(error)[:, None], told - at.joint, 0.0)
        return Correction(dq, error, evaluations, converged=good)

    def points(self, at: Conditions, told: Array) -> Array:
        """Where the chain run forward has the tool when told joints (n, m) [rad], (n, d) [m].

        The conditions are those of the commands, as in `correct`.
        """
        at = replace(at, joint=told, travel=np.full_like(at.travel, np.inf))
        behind = told + _shift(self._drive, at) if self._drive else told
        return self._points(self._dimensions(at), behind)

    def _dimensions(self, at: Conditions) -> Array:
        """Geometry under these conditions, (n, p), or (p,) where it is always the same."""
        if not self._structure:
            return self._geometry
        return self._geometry + _shift(self._structure, at)

    def _solve(self, geometry: Array, q: Array, target: Array) -> Correction:
        """Corrections of joints behind the drives."""
        found = Correction.none(*q.shape)
        for rows, machine in self._machines(geometry, len(q)):
            part = machine.solver.correct(q[rows], target[rows])
            found.dq[rows], found.error[rows] = part.dq, part.error
            found.evaluations[rows] = part.evaluations
        return found

    def _before_drives(self, at: Conditions, behind: Array) -> tuple[Array, Array]:
        """What to tell the drives for joints to stand at `behind`; how far they stray from it."""
        if not self._drive:
            return behind, np.zeros_like(behind)
        told = at.joint
        for _ in range(_DRIVE_STEPS):  # each with conditions of its own: they keep what they cost
            stray = told + _shift(self._drive, replace(at, joint=told)) - behind
            if not (np.abs(stray) > _DRIVE_SETTLED).any():
                break
            told = told - stray
        return told, stray

    def _missed(self, geometry: Array, behind: Array, target: Array) -> Array:
        """Distance of the tool from the target with joints at `behind`, (n,) [m]."""
        return distance(self._points(geometry, behind) - target)

    def _points(self, geometry: Array, behind: Array) -> Array:
        """Tool points with joints at `behind`, (n, d) [m]; NaN out of reach."""
        point = np.full((len(behind), self._machine.aim.size), np.nan)
        for rows, machine in self._machines(geometry, len(behind)):
            point[rows] = machine.point(behind[rows])
        return point

    def _machines(self, geometry: Array, n: int) -> Iterator[tuple[Counts, Machine]]:
        """Each different machine of n commands, with its rows; none of an unknown geometry."""
        if geometry.ndim == 1:
            yield np.arange(n), self._machine
            return
        known = np.flatnonzero(np.isfinite(geometry).all(axis=1))
        kinds, which = np.unique(geometry[known], axis=0, return_inverse=True)
        for kind, own in enumerate(kinds):
            key = own.tobytes()
            if self._last[0] != key:  # a temperature stays the same for many commands
                self._last = (key, self._machine.at(own))
            yield known[which.reshape(-1) == kind], self._last[1]


def _drawing(robot: Robot, machine: Machine) -> Mechanism:
    """What drives are loaded by.

    Loads are those of the drawing, and its platform does not tilt: whichever model was identified,
    three spheres give the same ones, for a fraction of the work.
    """
    if machine.fast is None:
        return robot.commanded
    return CompiledDrawing(robot.dimensions, robot.tolerances)


def _shift(effects: Live, at: Conditions) -> Array:
    """What the effects add together, (n, size of their stage)."""
    return np.asarray(sum(effect.columns_kept(at) @ value for effect, value in effects))
