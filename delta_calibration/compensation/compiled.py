"""A Delta's geometry as compiled functions, in the form that the ways of compensating take.

numba is imported, and the functions compiled or loaded, with the first `CompiledGeometry` (the
swarm's with the first `CompiledApso`): a program that does not compensate at a high rate need not
pay for either.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.apso import (
    ApsoSettings,
    first_places,
    stream,
)
from delta_calibration.compensation.base import Correction, checked_commands
from delta_calibration.compensation.newton import NewtonSettings
from delta_calibration.errors import InputError
from delta_calibration.geometry import rotations
from delta_calibration.mechanisms import Mechanism, RotaryDelta, SixRodDelta
from delta_calibration.mechanisms import rotary_delta as three
from delta_calibration.mechanisms import six_rod_delta as six
from delta_calibration.mechanisms.delta_leg import (
    LEG_FRAMES,
    LEGS,
    DeltaDimensions,
    DeltaTolerances,
    arm_direction,
    tilt_vector,
)
from delta_calibration.swarm_law import entropy_terms

Array = NDArray[np.float64]

_DELTAS = (RotaryDelta, SixRodDelta)  # these and no kind of them, which may close otherwise


def available(mechanism: Mechanism) -> bool:
    """Whether there is a compiled form of this mechanism and numba to compile it; loads numba."""
    if type(mechanism) not in _DELTAS:
        return False
    try:
        _kernel()
    except ImportError:  # numba is absent, or does not go with this numpy
        return False
    return True


class CompiledGeometry:
    """Tool point, Jacobian and condition of one machine at constant geometry."""

    def __init__(self, mechanism: Mechanism, geometry: Array, offset: Array) -> None:
        """From a Delta, its parameters (p,) and the tool's place in the platform (3,) [m].

        Raises:
            InputError: no compiled form of this mechanism.
            ImportError: no numba that can be used.
        """
        if type(mechanism) not in _DELTAS:
            raise InputError(f"no compiled form of the mechanism {mechanism.name!r}")
        self._kernel = _kernel()
        self._mechanism = mechanism
        self._size = mechanism.pose_size
        self._offset = np.array(offset, dtype=np.float64)
        self._typical = _typical_gain(mechanism)
        self._set(geometry)

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """Legs, rods and offset, as the compiled functions take them: see kernel.py."""
        return self._geometry

    @property
    def typical(self) -> float:
        """Gain of the nominal machine at home [m/rad], as in `Mechanism.condition`."""
        return self._typical

    def at(self, geometry: Array) -> CompiledGeometry:
        """The same machine with other dimensions (p,); a third of a millisecond for six rods."""
        other = copy(self)
        other._set(geometry)
        return other

    def _set(self, geometry: Array) -> None:
        mechanism = self._mechanism
        if isinstance(mechanism, SixRodDelta):
            leg = three.legs(mechanism.three_spheres(geometry))
            rods = _rods(three.legs(geometry))
        else:
            leg, rods = three.legs(geometry), np.zeros((0, 7))
        self._geometry = (_legs(leg), rods, self._offset)
        self._centre = (*self._geometry[:2], np.zeros(3))

    def pose(self, q: Array) -> Array:
        """Platform's pose, (..., 3) -> (..., k) [m, rad]; NaN rows where there is none."""
        found = self._kernel.points(*self._geometry, _rows(q))[1][:, : self._size]
        return np.asarray(found).reshape((*q.shape[:-1], self._size))

    def point(self, q: Array) -> Array:
        """Tool points, (..., 3) -> (..., 3) [m]; NaN rows where there is no pose."""
        return np.asarray(self._kernel.points(*self._geometry, _rows(q))[0]).reshape(q.shape)

    def jacobian(self, q: Array) -> Array:
        """d(tool point)/dq, (..., 3) -> (..., 3, 3) [m/rad]."""
        found, _ = self._kernel.jacobians(*self._geometry, _rows(q))
        return np.asarray(found).reshape((*q.shape, 3))

    def condition(self, q: Array) -> Array:
        """`Mechanism.condition` of the pose at joints q, (n, 3) -> (n,)."""
        _, gains = self._kernel.jacobians(*self._centre, _rows(q))
        largest = np.fmax(gains[:, 0], self._typical)
        smallest = np.fmin(gains[:, 1], self._typical)
        if smallest.all():
            return np.asarray(largest / smallest)
        with np.errstate(divide="ignore"):
            return np.asarray(largest / smallest)

    def newton(self, q: Array, target: Array, s: NewtonSettings) -> Correction:
        """`Newton.correct`, for finite commands (n, 3) [rad] and targets (n, 3) [m]."""
        dq, error, evaluations = _newton_kernel().newton(
            *self._geometry,
            _rows(q),
            _rows(target),
            s.numbers,
        )
        return Correction(dq, error, evaluations, converged=error <= s.tolerance)

    def swarm(self, q: Array, target: Array, s: ApsoSettings) -> Correction:
        """`Apso.correct`, for finite commands (n, 3) [rad] and targets (n, 3) [m]."""
        out = _swarm_kernel().search(
            self._geometry,
            _rows(q),
            _rows(target),
            *drawn_beforehand(s),
            (s.bound_rad, s.tolerance, s.velocity_fraction, s.cognitive, s.social),
        )
        dq, error, evaluations = out[:, :3].copy(), out[:, 3].copy(), out[:, 4].astype(np.int64)
        return Correction(dq, error, evaluations, converged=error <= s.tolerance)


@dataclass(frozen=True)
class CompiledApso:
    """`Apso` as one compiled function: the same swarms on the same random numbers.

    The corrections are those of `Apso` but for rounding (1e-12 rad where the target is reached),
    and depend on neither row nor neighbours, to the last bit. Compiles, or loads what an earlier
    process compiled, when it is made.
    """

    geometry: CompiledGeometry
    settings: ApsoSettings = field(default_factory=ApsoSettings)

    def __post_init__(self) -> None:
        """Take the first command's delay now."""
        _swarm_kernel()
        drawn_beforehand(self.settings)

    def correct(self, q: Array, target: Array) -> Correction:
        """Search the correction of every command; see `Apso.correct`."""
        q, target, usable = checked_commands(q, target, 3)
        return self.geometry.swarm(q[usable], target[usable], self.settings).spread(usable)


@dataclass(frozen=True)
class CompiledNewton:
    """`Newton` as one compiled function: the same corrections."""

    geometry: CompiledGeometry
    settings: NewtonSettings = field(default_factory=NewtonSettings)

    def __post_init__(self) -> None:
        """Take the first command's delay now."""
        _newton_kernel()

    def correct(self, q: Array, target: Array) -> Correction:
        """Step to the correction of every command; see `Newton.correct`."""
        q, target, usable = checked_commands(q, target, 3)
        return self.geometry.newton(q[usable], target[usable], self.settings).spread(usable)


class CompiledDrawing(RotaryDelta):
    """Three spheres, quick where they are as drawn: loads are computed there, command by command.

    At any other geometry it is a `RotaryDelta` like all others.
    """

    def __init__(self, dimensions: DeltaDimensions, tolerances: DeltaTolerances) -> None:
        """From the drawing and the expected errors of the parts.

        Raises:
            ImportError: no numba that can be used.
        """
        super().__init__(dimensions, tolerances)
        self._drawn = self.parameters.nominal
        plain = RotaryDelta(dimensions, tolerances)
        self._compiled = CompiledGeometry(plain, self._drawn, np.zeros(3))

    def forward(self, q: Array, g: Array, guess: Array | None = None) -> Array:
        """Platform's place, (n, 3) [m]; NaN rows out of reach."""
        if np.array_equal(g, self._drawn):
            return self._compiled.pose(q)
        return super().forward(q, g, guess)

    def velocity_jacobian(self, q: Array, x: Array, g: Array) -> Array:
        """dx/dq, (n, 3, 3) [m/rad]."""
        if np.array_equal(g, self._drawn):
            return self._compiled.jacobian(q)
        return super().velocity_jacobian(q, x, g)


def _kernel() -> Any:
    """The compiled functions."""
    return import_module("delta_calibration.compensation.kernel")


def _newton_kernel() -> Any:
    """The compiled Newton's method."""
    return import_module("delta_calibration.compensation.newton_kernel")


def _swarm_kernel() -> Any:
    """The compiled swarm; apart, as who wants no swarm need not wait for it."""
    return import_module("delta_calibration.compensation.swarm_kernel")


@lru_cache(maxsize=8)
def drawn_beforehand(s: ApsoSettings) -> tuple[Array, Array, Array]:
    """First places, random numbers and gains of entropy: see swarm_kernel.py.

    All random numbers that a search can use up are a quarter of a megabyte at the usual settings.
    """
    draws = stream(s)
    start = first_places(draws, LEGS, s).ravel()
    moves = draws.random(s.iterations * 2 * start.size)
    gains = np.diff(entropy_terms(s.particles)) / np.log(s.particles)
    return start, moves, gains


def _typical_gain(mechanism: Mechanism) -> float:
    """Mean gain of the nominal machine at home [m/rad], as in `Mechanism.condition`."""
    home, nominal = mechanism.home[None], mechanism.parameters.nominal
    slope = mechanism.velocity_jacobian(home, mechanism.forward(home, nominal), nominal)
    gains = np.linalg.svd(slope[0, : mechanism.task_size], compute_uv=False)
    return float(np.exp(np.log(gains).mean()))


def _rows(values: Array) -> Array:
    """Rows of three in memory of their own, of the one layout the functions are compiled for."""
    return np.array(values, dtype=np.float64, order="C").reshape(-1, 3)


def _arms(leg: Array) -> tuple[Array, Array, Array]:
    """Hinge frame in the base T, and u, v of L u(q + z) = u cos q + v sin q turned into it.

    Columns of a leg, (3, 8) as in `RotaryDelta` -> (3, 3, 3), (3, 3) [m], (3, 3) [m].
    """
    frame = LEG_FRAMES @ rotations.exp(tilt_vector(leg[:, three.TILT_X], leg[:, three.TILT_Z]))
    arm = leg[:, three.ARM, None]
    start = arm * arm_direction(leg[:, three.ZERO])
    quarter = arm * arm_direction(leg[:, three.ZERO] + np.pi / 2)
    return frame, _turned(frame, start), _turned(frame, quarter)


def _legs(leg: Array) -> Array:
    """The spheres, (3, 8) -> (3, 10): see kernel.py."""
    _, u, v = _arms(leg)
    centre = _turned(LEG_FRAMES, leg[:, three.RADIAL : three.HEIGHT + 1])
    return np.concatenate([centre, u, v, leg[:, three.ROD, None]], axis=1)


def _rods(leg: Array) -> Array:
    """The rods, (3, 20) -> (6, 7): see kernel.py."""
    hinge = LEG_FRAMES @ rotations.exp(tilt_vector(leg[:, six.TILT_X], leg[:, six.TILT_Z]))
    elbow = rotations.exp(tilt_vector(leg[:, six.ELBOW_X], leg[:, six.ELBOW_Z]))[:, :, 1]
    line = rotations.exp(tilt_vector(leg[:, six.LINE_X], leg[:, six.LINE_Z]))[:, :, 1]
    rods = np.empty((LEGS, len(six.SIDE), 7))
    for j, side in enumerate(six.SIDE):
        width, spread = side * leg[:, six.ELBOW][:, j, None], side * leg[:, six.JOINT][:, j, None]
        rods[:, j, :3] = _turned(LEG_FRAMES, leg[:, six.BASE]) + _turned(hinge, width * elbow)
        rods[:, j, 3:6] = _turned(LEG_FRAMES, leg[:, six.PLATFORM] + spread * line)
        rods[:, j, 6] = leg[:, six.ROD] + side * leg[:, six.MISMATCH] / 2
    return rods.reshape(2 * LEGS, 7)


def _turned(frames: Array, vectors: Array) -> Array:
    """Each vector turned by its frame.  (3, 3, 3), (3, 3) -> (3, 3)."""
    return np.asarray((frames @ vectors[..., None])[..., 0])
