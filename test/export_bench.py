"""Exported machines, compiled here and called from Python through ctypes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.compensation import CommandStatus
from delta_calibration.data import Conditions, at_rest
from delta_calibration.estimation import chain_of
from delta_calibration.export import c_files
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import Robot

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc) here")
STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic"]
QUICK = [*STRICT, "-O0"]  # compiles in a quarter of the time
VERDICTS = (
    CommandStatus.CORRECTED,
    CommandStatus.NOT_FINITE,
    CommandStatus.JOINT_LIMIT,
    CommandStatus.OUT_OF_REACH,
    CommandStatus.OUTSIDE_REGION,
    CommandStatus.SINGULAR,
    CommandStatus.SLACK,
    CommandStatus.NOT_REACHED,
    CommandStatus.MISSING_CONDITION,
)
EVERYWHERE = Region(10.0 * (2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0))  # [m]
_DOUBLES = ctypes.POINTER(ctypes.c_double)


def machine(robot, model=None, effects=(), values=(), region=EVERYWHERE) -> Calibration:
    """Calibration of a machine with half of its tolerances, these effects and their values."""
    rng = np.random.default_rng(4)
    chain = chain_of(robot, model)
    parameters = chain.mechanism.parameters
    spread = np.where(np.isfinite(parameters.prior), parameters.prior, 0.0)
    g = parameters.nominal + 0.5 * spread * rng.standard_normal(len(parameters))
    base = chain.join(g, np.zeros(3), Frame.identity())
    chain = chain.with_effects(tuple(effects))
    theta = np.concatenate([base, *values])
    ends = robot.joints.lower, robot.joints.upper
    return Calibration(robot, chain, theta, region, *ends, 1e-5, "a session", "5ea1" * 16)


def commands(robot: Robot, mechanism: Mechanism, n: int, far: int, seed: int = 0) -> np.ndarray:
    """Commands around those of a plan, (n, m); the first `far` are far from it."""
    rng = np.random.default_rng(seed)
    plan = make_plan("identify", robot, count=40, both_sides=False).joint
    near = 0.02 if mechanism.joints == mechanism.task_size else 1e-3  # redundant cables fit little
    size = np.full(n, near)
    size[:far] = rng.choice([2.0, 0.3], far)
    spread = mechanism.joint_size * size[:, None] * rng.standard_normal((n, plan.shape[1]))
    return plan[rng.integers(len(plan), size=n)] + spread


def moving(q: np.ndarray, parts: tuple[str, ...] = (), size: float = 1.0) -> Conditions:
    """Conditions in motion, with varying loads and temperatures; `size` is that of a joint."""
    rng, n = np.random.default_rng(1), len(q)
    return replace(
        at_rest(q),
        velocity=0.3 * size * rng.standard_normal(q.shape),
        acceleration=size * rng.standard_normal(q.shape),
        direction=rng.choice([-1.0, 0.0, 1.0], q.shape),
        payload=rng.uniform(0.0, 2.0, n),
        payload_centre=rng.uniform(-0.05, 0.05, (n, 3)),
        temperature_parts=parts,
        temperature=rng.uniform(15.0, 35.0, (n, len(parts))),
    )


class Compiled:
    """A machine as C, compiled without a warning."""

    def __init__(
        self,
        calibration: Calibration,
        folder: Path,
        prefix: str = "",
        options: Sequence[str] = STRICT,
    ) -> None:
        files = c_files(calibration, "machine", prefix)
        self.prefix, self.parts = prefix, files.parts
        self.joints = len(calibration.robot.joints.names)
        self.room = int(files.header.partition("CORRECT_ROOM ")[2].split()[0])
        self.folder = folder
        folder.mkdir(exist_ok=True)
        (folder / "machine.h").write_text(files.header, encoding="utf-8")
        (folder / "machine.c").write_text(files.source, encoding="utf-8")
        made = ["-shared", "-fPIC", "machine.c", "-o", "machine.so", "-lm"]
        subprocess.run([COMPILER, *options, *made], cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "machine.so"))

    @cached_property
    def conditions(self) -> type[ctypes.Structure]:
        """The C structure of that name."""
        real, parts = ctypes.c_double, len(self.parts)
        each = [(name, real * self.joints) for name in ("rate", "acceleration", "direction")]
        rest = [("time", real), ("payload", real), ("payload_centre", real * 3)]
        warm = [("temperature", real * parts)] if parts else []
        return type("conditions", (ctypes.Structure,), {"_fields_": [*each, *rest, *warm]})

    def given(self, at: Conditions, row: int) -> ctypes.Structure:
        """The conditions of one command."""
        found = self.conditions()
        found.rate[:] = at.velocity[row]
        found.acceleration[:] = at.acceleration[row]
        found.direction[:] = at.direction[row]
        found.time, found.payload = at.time[row], at.payload[row]
        found.payload_centre[:] = at.payload_centre[row]
        if self.parts:
            found.temperature[:] = at.temperature[row]
        return found

    def correct(self, q: np.ndarray, at: Conditions | None = None) -> tuple[np.ndarray, list]:
        """Corrected commands, (n, m), and the verdict on each."""
        out, call = np.empty_like(q), self.library[f"{self.prefix}correct"]
        verdicts = []
        for row in range(len(q)):
            given = None if at is None else ctypes.byref(self.given(at, row))
            ends = q[row].ctypes.data_as(_DOUBLES), out[row].ctypes.data_as(_DOUBLES)
            verdicts.append(VERDICTS[call(ends[0], given, ends[1])])
        return out, verdicts


def doubles(values: np.ndarray):
    """Pointer to an array for C."""
    return values.ctypes.data_as(_DOUBLES)
