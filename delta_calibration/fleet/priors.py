"""The file of priors: what a fleet says of the next machine of its type.

Dimensions are absolute and in SI units. `mean` and `spread` are those of the crowd, `mean_std` how
well the mean is known, `machines_worth` how many machines tell of the spread: near zero where no
session shows the dimension, which keeps the tolerance of the drawing. Of effects that diagnoses
found it says in how many machines, and their values.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.documents import load_schema, read_document, write_document
from delta_calibration.errors import ConfigError, DataError
from delta_calibration.estimation import Population
from delta_calibration.fleet.evidence import Fitted, together
from delta_calibration.fleet.population import FEWEST, Estimated, estimate, expected, kinds_of
from delta_calibration.parameters import Parameter
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

SCHEMA = 1
_ODD = 0.5  # probability from which on a dimension is told as odd


def write_priors(path: Path, machines: Sequence[Fitted], robot: Robot) -> dict[str, Any]:
    """Estimate the population of machines and write it; what was written.

    Args:
        path: the file.
        machines: of one type, with calibrations.
        robot: the type.

    Raises:
        DataError: too few machines, or a type whose dimensions have no tolerances.
        ConfigError: the file cannot be written.
    """
    if len(machines) < FEWEST:
        raise DataError(
            f"{len(machines)} machines of robot {robot.name}; priors need {FEWEST} or more"
        )
    parameters = machines[0].calibrations[0].chain.mechanism.parameters.items
    _require_tolerances(parameters, robot)
    kinds = kinds_of([p.name for p in parameters])
    document = _document(machines, robot, parameters, estimate(together(machines), kinds))
    write_document(path, document)
    return document


def read_priors(path: Path, robot: Robot, model: str | None = None) -> Population:
    """What a file of priors says of this type, in tolerances off the drawing.

    Args:
        path: the file.
        robot: the type.
        model: name of the mechanism that is fitted; the robot file's own where not given.

    Raises:
        ConfigError: no file of priors, or one of another robot or model.
    """
    data = read_document(path, lambda _: load_schema("priors"))
    made_for, mechanism = data["robot"], robot.model(model)
    if made_for["sha256"] != robot.machine_hash:
        raise ConfigError(
            f"{path}: robot: made for {made_for['name']!r} with hash {made_for['sha256'][:12]}, "
            f"but {robot.source} is {robot.name!r} with hash {robot.machine_hash[:12]}"
        )
    names = [each["name"] for each in data["parameters"]]
    if data["model"] != mechanism.name or names != list(mechanism.parameters.names):
        raise ConfigError(
            f"{path}: model: priors of the dimensions of a {data['model']}; {mechanism.name} is "
            "fitted"
        )
    entries = data["parameters"]
    value, nominal, tolerance, spread, told = (
        np.array([float(each[key]) for each in entries])
        for key in ("mean", "nominal", "tolerance", "spread", "machines_worth")
    )
    mean, odd = (value - nominal) / tolerance, float(data["odd_share"])
    return expected(Population(mean, spread / tolerance, odd), told)


def _document(
    machines: Sequence[Fitted],
    robot: Robot,
    parameters: Sequence[Parameter],
    found: Estimated,
) -> dict[str, Any]:
    population, crowd = found.population, found.belief.crowd
    entries = [
        {
            "name": p.name,
            "unit": p.unit,
            "nominal": p.nominal,
            "tolerance": p.prior,
            "mean": float(p.nominal + p.prior * population.mean[k]),
            "mean_std": float(p.prior * found.mean_std[k]),
            "spread": float(p.prior * population.spread[k]),
            "machines_worth": round(float(found.told[k]), 2),
        }
        for k, p in enumerate(parameters)
    ]
    odd = [
        {
            "machine": machines[i].machine,
            "parameter": parameters[k].name,
            "probability": round(float(1 - crowd[i, k]), 4),
        }
        for i, k in np.argwhere(crowd < 1 - _ODD).tolist()
    ]
    return {
        "schema": SCHEMA,
        "robot": {"name": robot.name, "sha256": robot.machine_hash},
        "model": machines[0].calibrations[0].chain.mechanism.name,
        "machines": len(machines),
        "sessions": sum(len(each.calibrations) for each in machines),
        "odd_share": population.odd,
        "parameters": entries,
        "odd": odd,
        "effects": _effects(machines),
    }


def _effects(machines: Sequence[Fitted]) -> list[dict[str, Any]]:
    """Of every effect that the last calibration of a machine has: where, and how large."""
    found: dict[tuple[str, str, str], list[tuple[float, float]]] = defaultdict(list)
    for machine in machines:
        for key, value in _values(machine):
            found[key].append(value)
    return [
        {
            "cause": cause,
            "parameter": name,
            "unit": unit,
            "found_in": len(values),
            "of": len(machines),
            "mean": float(np.mean([value for value, _ in values])),
            "spread": _between(values),
        }
        for (cause, name, unit), values in sorted(found.items())
    ]


def _values(machine: Fitted) -> Iterable[tuple[tuple[str, str, str], tuple[float, float]]]:
    last = machine.calibrations[-1]
    if last.uncertainty is None:
        return
    std = np.sqrt(np.diag(last.uncertainty.covariance))
    for effect, part in zip(last.chain.effects, last.chain.layout.each, strict=True):
        for p, value, error in zip(effect.parameters, last.theta[part], std[part], strict=True):
            yield (effect.cause, p.name, p.unit), (float(value), float(error))


def _between(values: Sequence[tuple[float, float]]) -> float:
    """Spread of values between machines, without what their own errors make of it."""
    if len(values) < 2:
        return 0.0
    value, error = np.array(values).T
    return float(np.sqrt(max(np.var(value, ddof=1) - np.mean(error**2), 0.0)))


def _require_tolerances(parameters: Sequence[Parameter], robot: Robot) -> None:
    unknown = [p.name for p in parameters if not np.isfinite(p.prior)]
    if unknown:
        raise DataError(
            f"robot {robot.name}: {unknown[0]} has no tolerance in its file; priors need one of "
            "every dimension"
        )
