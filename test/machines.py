"""The registered mechanisms, each with the nominal dimensions of a robot of the package."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delta_calibration.mechanisms import MECHANISMS, Mechanism
from delta_calibration.robot import known_robots, load_robot

STEP = 1e-30
ROBOTS = [load_robot(name) for name in known_robots()]


def _models() -> dict[str, Mechanism]:
    """Every model of every robot, and a serial arm with other joints and another tool."""
    models = {
        f"{robot.name}-{name}": robot.model(name)
        for robot in ROBOTS
        for name, kind in sorted(MECHANISMS.items())
        if isinstance(robot.dimensions, kind.Dimensions)
    }
    six = next(robot for robot in ROBOTS if robot.name == "ur10")
    mount, tool = np.array([0.4, np.pi / 2, -1.1]), np.array([0.02, -0.01, 0.09])
    for name, change in (
        ("mounted", {"mount": mount, "tool": tool}),
        (
            "three_axes",
            {
                "links": six.dimensions.links[:3],
                "tool": np.array([-0.57, 0.0, 0.16]),
                "home": six.dimensions.home[:3],
            },
        ),
    ):
        drawing = replace(six.dimensions, **change)
        models[f"{name}-serial_arm"] = MECHANISMS["serial_arm"](drawing, six.tolerances)
    return models


MODELS = _models()


def machine(mechanism: Mechanism, rng: np.random.Generator, scale: float = 5.0) -> np.ndarray:
    """Geometry with `scale` times the expected manufacturing errors."""
    parameters = mechanism.parameters
    return parameters.nominal + scale * parameters.prior * rng.standard_normal(len(parameters))


def places(
    mechanism: Mechanism, g: np.ndarray, rng: np.random.Generator, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Consistent joints and poses around home at geometry g, (n, m), (n, k)."""
    home, nominal = mechanism.home[None], mechanism.parameters.nominal
    way = mechanism.joint_size * rng.uniform(-0.2, 0.2, (n, mechanism.joints))
    x = mechanism.forward(home, nominal)
    if mechanism.joints == mechanism.task_size:
        x = mechanism.forward(home + way, nominal)
    else:  # arbitrary joints are not consistent
        x = x + way @ mechanism.velocity_jacobian(home, x, nominal)[0].T
    q = mechanism.inverse(x[:, : mechanism.task_size], g)
    return q, mechanism.forward(q, g)


def complex_step(function, x: np.ndarray) -> np.ndarray:
    """Derivative of function(x) by the components of x as last axis, without cancellation."""
    columns = []
    for k in range(x.shape[-1]):
        moved = x.astype(complex)
        moved[..., k] += 1j * STEP
        columns.append(np.imag(function(moved)) / STEP)
    return np.stack(columns, axis=-1)


def differences(function, x: np.ndarray, step: float = 2e-3) -> np.ndarray:
    """The same for functions of real numbers, by central differences with an error of step^6."""
    columns = []
    for way in step * np.eye(x.shape[-1]):
        sides = [function(x + i * way) - function(x - i * way) for i in (1, 2, 3)]
        columns.append((45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * step))
    return np.stack(columns, axis=-1)
