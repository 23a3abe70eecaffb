"""Layout of the parameter vector theta: which entries belong to which part.

    theta = (g, o, w, t, m, v_1 ... v_e)

    g    geometry of the mechanism                               (p,)    [m, rad]
    o    position of the reflector in the platform: the offset   (3,)    [m]
    w    rotation vector of the measuring device's frame         (3,)    [rad]
    t    position of that frame's origin                         (3,)    [m]
    m    rotation vector of the probe on the platform            (3,)    [rad]
    v_i  parameters of effect i of the chain                     (k_i,)  each in its own unit

The parts always come in this order, in theta, in its covariance and in the columns of a Jacobian.
A part that a model does not have is empty: a fit of observations has no offset, and only a fit
that uses measured rotations has the rotation of the probe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_AXES = "xyz"
_VECTOR = len(_AXES)  # size of an offset, a turn or a place


@dataclass(frozen=True)
class Parts:
    """The parts of a parameter vector; the arrays are views of it."""

    geometry: Array  # (p,) [m, rad]
    offset: Array  # (3,) [m] of the reflector in the platform; (0,) if there is none
    frame: Array  # (6,) rotation [rad] and position [m], as `Frame.from_vector` takes them
    effects: tuple[Array, ...]  # parameters of each effect, (k,)
    mount: Array  # (3,) [rad] rotation of the probe; (0,) if no rotations are measured


@dataclass(frozen=True)
class Layout:
    """Named slices of a parameter vector.

    Attributes:
        geometry_size: p, number of the mechanism's parameters.
        effect_sizes: cause and number of parameters of each effect, in the order of the chain.
        has_offset: whether the vector holds the reflector's offset.
        has_mount: whether it holds the rotation of a probe on the platform.
    """

    geometry_size: int
    effect_sizes: tuple[tuple[str, int], ...] = ()
    has_offset: bool = True
    has_mount: bool = False

    @cached_property
    def geometry(self) -> slice:
        """The mechanism's geometry."""
        return slice(0, self.geometry_size)

    @cached_property
    def offset(self) -> slice:
        """The reflector's offset in the platform."""
        return _behind(self.geometry, _VECTOR * self.has_offset)

    @cached_property
    def turn(self) -> slice:
        """Rotation of the device's frame."""
        return _behind(self.offset, _VECTOR)

    @cached_property
    def place(self) -> slice:
        """Position of the device's frame."""
        return _behind(self.turn, _VECTOR)

    @cached_property
    def each(self) -> tuple[slice, ...]:
        """Parameters of each effect, in the order of the chain."""
        sizes = (size for _, size in self.effect_sizes)
        ends = accumulate(sizes, initial=self.mount.stop)
        return tuple(slice(*span) for span in pairwise(ends))

    @cached_property
    def mount(self) -> slice:
        """Rotation of the probe on the platform."""
        return _behind(self.place, _VECTOR * self.has_mount)

    @cached_property
    def dimensions(self) -> slice:
        """Geometry and offset: the dimensions of the machine."""
        return slice(0, self.offset.stop)

    @cached_property
    def frame(self) -> slice:
        """Rotation and position of the device's frame."""
        return slice(self.turn.start, self.place.stop)

    @cached_property
    def base(self) -> slice:
        """Geometry, offset, frame and mount: everything before the effects."""
        return slice(0, self.mount.stop)

    @cached_property
    def effects(self) -> slice:
        """Parameters of all effects."""
        return slice(self.mount.stop, (self.mount, *self.each)[-1].stop)

    @cached_property
    def chain(self) -> Index:
        """Indices of the entries that the chain uses: all but the rotation of the probe."""
        return np.delete(np.arange(self.size, dtype=np.int64), entries(self.mount))

    @cached_property
    def size(self) -> int:
        """P, number of entries."""
        return int(self.effects.stop)

    def effect(self, number: int) -> slice:
        """Parameters of one effect, by its position in the chain."""
        return self.each[number]

    def __getitem__(self, cause: str) -> slice:
        """Parameters of the only effect of a cause.

        Raises:
            InputError: no effect of that cause, or several of them.
        """
        causes = [name for name, _ in self.effect_sizes]
        if causes.count(cause) != 1:
            found = "several effects" if cause in causes else "no effect"
            raise InputError(f"{found} {cause!r} in theta; it has: {', '.join(causes) or 'none'}")
        return self.each[causes.index(cause)]

    def with_effects(self, sizes: Sequence[tuple[str, int]]) -> Layout:
        """The same layout with these effects instead: cause and number of parameters of each."""
        return replace(self, effect_sizes=tuple(sizes))

    @cached_property
    def mounted(self) -> Layout:
        """The same layout with the rotation of the probe included."""
        return replace(self, has_mount=True)

    def mask(self, *parts: slice) -> Mask:
        """True at the entries of these parts, (P,)."""
        mask = np.zeros(self.size, dtype=bool)
        for part in parts:
            mask[part] = True
        return mask

    def split(self, theta: Array) -> Parts:
        """Split a vector (P,) into its parts."""
        return Parts(
            theta[self.geometry],
            theta[self.offset],
            theta[self.frame],
            tuple(theta[part] for part in self.each),
            theta[self.mount],
        )

    def join(self, parts: Parts) -> Array:
        """Join parts into a vector (P,): the inverse of `split`.

        Raises:
            InputError: a part whose size differs from this layout's.
        """
        every = (parts.geometry, parts.offset, parts.frame, parts.mount, *parts.effects)
        names = ("geometry", "offset", "frame", "mount", *(name for name, _ in self.effect_sizes))
        slices = (self.geometry, self.offset, self.frame, self.mount, *self.each)
        if len(every) != len(slices):
            raise InputError(f"theta: {len(parts.effects)} effects; it has {len(self.each)}")
        for name, values, part in zip(names, every, slices, strict=True):
            if values.shape != (length(part),):
                raise InputError(f"theta: {name} of shape {values.shape}; ({length(part)},)")
        return np.concatenate(every)

    def columns(
        self,
        geometry: Array,
        offset: Array | None = None,
        turn: Array | None = None,
        place: Array | None = None,
        mount: Array | None = None,
        effects: Sequence[Array] | None = None,
    ) -> Array:
        """Join the derivatives by each part, (n, d, size of the part), into one array (n, d, P).

        A part that is not given has no influence and gets columns of zeros.
        """
        by_effect = [None] * len(self.each) if effects is None else effects
        blocks = (geometry, offset, turn, place, mount, *by_effect)
        parts = (self.geometry, self.offset, self.turn, self.place, self.mount, *self.each)
        every = [
            np.zeros((*geometry.shape[:-1], length(part))) if block is None else block
            for block, part in zip(blocks, parts, strict=True)
            if block is not None or length(part)
        ]
        return np.concatenate(every, axis=-1)


def entries(part: slice) -> Index:
    """Indices of the entries of a part, (size of the part,)."""
    return np.arange(part.start, part.stop, dtype=np.int64)


def length(part: slice) -> int:
    """Number of entries of a part."""
    return int(part.stop - part.start)


def vector_names(what: str) -> tuple[str, ...]:
    """Names of the three components of an offset, a rotation or a position."""
    return tuple(f"{what}_{axis}" for axis in _AXES)


def frame_names(device: str) -> tuple[str, ...]:
    """Names of the six components of a device's frame."""
    return vector_names(f"{device}_turn") + vector_names(f"{device}_place")


def _behind(part: slice, size: int) -> slice:
    """The slice of this many entries that follows another slice."""
    return slice(part.stop, part.stop + size)
