"""Settings of Newton's method for a compensation; the method is in backward_kernel.py."""

from __future__ import annotations

from dataclasses import dataclass

from delta_calibration.compensation.base import require_positive, require_whole


@dataclass(frozen=True)
class NewtonSettings:
    """Bound, tolerance and largest numbers of steps of Newton's method."""

    bound_rad: float = 0.03  # largest |dq_j|
    tolerance: float = 1e-9  # [m]
    iterations: int = 15
    halvings: int = 8  # largest number of halvings of one step

    def __post_init__(self) -> None:
        """Refuse settings with which no step can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_whole("iterations", self.iterations, 1)
        require_whole("halvings", self.halvings, 0)
