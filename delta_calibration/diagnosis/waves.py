"""Products of columns that are waves of the joints' angles, at hundreds of orders together.

Of a wave of order w what is asked is sums over the samples,

    sum y sin(w q)        sum y cos(w q)

and, of two joints, the same over q_r - q_s and q_r + q_s. The samples are laid on a grid of the
angle once (`model/spreading.py`); an order then costs as much as the grid is long, whatever the
number of samples, and the waves on the grid are those of all joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from delta_calibration.model.spreading import STEPS, kernel, spread

Array = NDArray[np.float64]

_QUADRATURE = 80  # points, of the kernel's transform
_SEVERAL = 24  # orders, from which on it is worth to lay the samples on a grid
_OVER = 2.0  # times as fine a grid as would do to draw the shortest wave


@dataclass(frozen=True)
class Grid:
    """Steps of an angle that are fine enough for waves of some orders."""

    step: float

    @classmethod
    def of(cls, orders: Array) -> Grid:
        """For waves of these orders [1/angle], (K,)."""
        return cls(np.pi / (_OVER * float(orders.max())))

    @classmethod
    def fine(cls, orders: Array, angle: Array) -> Grid | None:
        """The same, where sums over it are less work than sums over the samples.

        Args:
            orders: (K,).
            angle: of the joints at n samples, (n, m).
        """
        grid = cls.of(orders)
        width = float(np.ptp(angle, axis=0).max())
        few = len(orders) < _SEVERAL or grid.points(width) > len(angle)
        return None if few else grid

    def points(self, width: float) -> int:
        """How many it has where angles lie within so much of each other."""
        return int(np.ceil(width / self.step)) + STEPS + 1

    def laid(self, angle: Array, columns: Array) -> Laid:
        """Columns (n, j) of samples at these angles, (n,)."""
        begin = float(angle.min()) - STEPS / 2 * self.step
        count = self.points(float(np.ptp(angle)))
        values = spread(angle, np.ascontiguousarray(columns), begin, self.step, count)
        return Laid(begin, values)


@dataclass(frozen=True)
class Laid:
    """Columns of samples on a grid of an angle."""

    begin: float
    values: Array  # (G, j)


@dataclass(frozen=True)
class Waves:
    """Sines and cosines of some orders, at the points of a grid."""

    grid: Grid
    orders: Array  # (K,)
    points: int  # of the longest grid that they are asked for on

    @cached_property
    def _phase(self) -> Array:
        return self.orders[:, None] * (self.grid.step * np.arange(self.points))

    @cached_property
    def _both(self) -> Array:
        """Sines, then cosines, (2 K, points)."""
        return np.concatenate([np.sin(self._phase), np.cos(self._phase)])

    @cached_property
    def _size(self) -> Array:
        """Steps over the kernel's transform, (K, 1)."""
        x, values = _kernel()
        reach = STEPS / 2 * self.grid.step
        transform = np.cos(self.orders[:, None] * reach * x) @ values * reach
        return np.asarray(self.grid.step / transform)[:, None]

    def sums(self, laid: Laid) -> tuple[Array, Array]:
        """Sums over the samples of columns times sines and times cosines, (K, j) each."""
        count = len(self.orders)
        along = self._both[:, : len(laid.values)] @ laid.values
        sine, cosine = self._size * along[:count], self._size * along[count:]
        phase = (self.orders * laid.begin)[:, None]
        s, c = np.sin(phase), np.cos(phase)
        return c * sine + s * cosine, c * cosine - s * sine


@cache
def _kernel() -> tuple[Array, Array]:
    """Where the kernel is taken for its transform, and what it counts there, two (k,)."""
    x, weight = np.polynomial.legendre.leggauss(_QUADRATURE)
    return x, weight * np.array([kernel(float(each)) for each in x])
