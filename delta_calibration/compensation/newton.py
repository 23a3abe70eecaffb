"""How far Newton's steps of a compensation go, and how long; backward_kernel.py has the method."""

from __future__ import annotations

from dataclasses import dataclass

from delta_calibration.compensation.base import require_positive, require_whole


@dataclass(frozen=True)
class NewtonSettings:
    """How far and how long Newton's steps go."""

    bound_rad: float = 0.03  # largest |dq_j|
    tolerance: float = 1e-9  # [m]
    iterations: int = 15
    halvings: int = 8  # of one step, before it is given up

    def __post_init__(self) -> None:
        """Refuse settings with which no step can be made."""
        require_positive("bound_rad", self.bound_rad, "rad")
        require_positive("tolerance", self.tolerance, "m")
        require_whole("iterations", self.iterations, 1)
        require_whole("halvings", self.halvings, 0)
