"""Moves the bodies: motors follow their commands, the engine computes everything else."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physics.bodies import STEP, model_of
from physics.machine import Machine

Array = NDArray[np.float64]


class Rig:
    """A machine that is moved from motion to motion, with one payload or another.

    Motors follow their course exactly: they are set to it at every step, and are too heavy to be
    moved by other forces in between.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._models: dict[float, mujoco.MjModel] = {}
        self._data: mujoco.MjData | None = None

    def follow(self, angle: Array, payload: float, every: int) -> tuple[Array, Array]:
        """Follow motor angles, (n, 3) [rad], one per step.

        Args:
            angle: of the motors.
            payload: on the platform [kg].
            every: steps between readings; the first reading is of the first step.

        Returns:
            Position of the platform (k, 3) [m], and its orientation: quaternions w x y z, (k, 4).
        """
        model, data = self._with(payload)
        motors = [model.joint(f"motor_{leg}").qposadr[0] for leg in range(3)]
        rates = [model.joint(f"motor_{leg}").dofadr[0] for leg in range(3)]
        rate = np.gradient(angle, STEP, axis=0) if len(angle) > 1 else np.zeros_like(angle)
        at = model.site("reflector").id
        places, turns = [], []
        for k in range(len(angle)):
            data.qpos[motors], data.qvel[rates] = angle[k], rate[k]
            if k % every == 0:
                mujoco.mj_kinematics(model, data)
                places.append(data.site_xpos[at].copy())
                turns.append(data.body("platform").xquat.copy())
            mujoco.mj_step(model, data)
        return np.array(places), np.array(turns)

    def settle(self, angle: Array, payload: float, seconds: float) -> tuple[Array, Array]:
        """Hold the motors and wait; return the platform's pose after that."""
        steps = round(seconds / STEP)
        places, turns = self.follow(np.tile(angle, (steps + 1, 1)), payload, steps)
        return places[-1], turns[-1]

    def _with(self, payload: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
        if payload not in self._models:
            self._models[payload] = model_of(self._machine, payload)
        model = self._models[payload]
        data = mujoco.MjData(model)
        if self._data is not None:
            data.qpos[:], data.qvel[:] = self._data.qpos, self._data.qvel
        self._data = data
        return model, data
