"""Checks of what the benchmarks measure."""

from __future__ import annotations

import numpy as np

import compensation


def test_libraries_are_given_the_same_machine_as_the_swarm() -> None:
    """Positions by the compiled chain equal those of the mechanism's own forward kinematics."""
    task = compensation.make_task(20, 3)
    found = compensation.fast_point(task.machine)(task.q)
    np.testing.assert_allclose(found, compensation.point(task)(task.q), atol=1e-12)
