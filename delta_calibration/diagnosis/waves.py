"""Inner products of columns that are waves of the joint angles, at hundreds of orders together.

A wave of order w needs sums over the samples,

    sum y sin(w q)        sum y cos(w q)

and two joints need the same over q_r - q_s and q_r + q_s. The samples are spread on a grid of the
angle once (`model/spreading.py`). The cost of an order is then proportional to the length of the
grid, whatever the number of samples, and all joints use the same waves on the grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from delta_calibration.lazy import cached_property
from delta_calibration.model.spreading import STEPS, kernel, spread

Array = NDArray[np.float64]

_QUADRATURE = 80  # points of the quadrature of the kernel's transform
_SEVERAL = 24  # least number of orders for which a grid saves time
_OVER = 2.0  # oversampling of the shortest wave: the grid is this much finer than Nyquist's


@dataclass(frozen=True)
class Grid:
    """Grid of an angle, fine enough for waves of some orders."""

    step: float

    @classmethod
    def of(cls, orders: Array) -> Grid:
        """Grid for waves of these orders [1/angle], (K,)."""
        return cls(np.pi / (_OVER * float(orders.max())))

    @classmethod
    def fine(cls, orders: Array, angle: Array) -> Grid | None:
        """Grid for these waves, or None if sums over the samples are less work.

        Args:
            orders: (K,).
            angle: of the joints at n samples, (n, m).
        """
        grid = cls.of(orders)
        width = float(np.ptp(angle, axis=0).max())
        few = len(orders) < _SEVERAL or grid.points(width) > len(angle)
        return None if few else grid

    def points(self, width: float) -> int:
        """Number of grid points for angles within a range of `width`."""
        return int(np.ceil(width / self.step)) + STEPS + 1

    def laid(self, angle: Array, columns: Array) -> Laid:
        """Spread columns (n, j) of samples at these angles, (n,), on the grid."""
        begin = float(angle.min()) - STEPS / 2 * self.step
        count = self.points(float(np.ptp(angle)))
        values = spread(angle, np.ascontiguousarray(columns), begin, self.step, count)
        return Laid(begin, values)


@dataclass(frozen=True)
class Laid:
    """Columns of samples, spread on a grid of an angle."""

    begin: float
    values: Array  # (G, j)


@dataclass(frozen=True)
class Waves:
    """Sines and cosines of some orders, at the points of a grid."""

    grid: Grid
    orders: Array  # (K,)
    points: int  # of the longest grid on which they are needed

    @cached_property
    def _phase(self) -> Array:
        return self.orders[:, None] * (self.grid.step * np.arange(self.points))

    @cached_property
    def _both(self) -> Array:
        """Sines, then cosines, (2 K, points)."""
        return np.concatenate([np.sin(self._phase), np.cos(self._phase)])

    @cached_property
    def _size(self) -> Array:
        """Step of the grid over the kernel's transform h / K(w), (K, 1)."""
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
    """Nodes of the kernel's quadrature, and weight times kernel at each, (k,) each."""
    x, weight = np.polynomial.legendre.leggauss(_QUADRATURE)
    return x, weight * np.array([kernel(float(each)) for each in x])
