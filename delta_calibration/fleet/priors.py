"""The file of priors: the prior that a fleet gives for the next machine of its type.

All values are absolute and in SI units. `mean` and `spread` are those of the crowd, `mean_std` is
the standard error of the mean, and `machines_worth` the effective number of machines that the
spread was estimated from: near zero if no session identifies the dimension, which then keeps the
tolerance of the drawing. `causes` gives the number of diagnosed machines in which each cause of
the catalogue was found. `effects` lists the effects that most machines have, in their shape, with
the share of machines in which each parameter does not belong to the crowd.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from delta_calibration.documents import load_schema, read_document, write_document
from delta_calibration.effects import SPREAD, Effect, catalogue, effect_named
from delta_calibration.errors import ConfigError, DataError, InputError
from delta_calibration.estimation import Population
from delta_calibration.fleet.evidence import Fitted, common_effects, together
from delta_calibration.fleet.population import (
    FEWEST,
    Estimated,
    Looked,
    estimate,
    expected,
    kinds_of,
)
from delta_calibration.mechanisms import Mechanism
from delta_calibration.parameters import Parameter
from delta_calibration.robot import Robot

SCHEMA = 1
_ODD = 0.5  # probability above which a dimension is reported as odd


def write_priors(path: Path, machines: Sequence[Fitted], robot: Robot) -> dict[str, Any]:
    """Estimate the population of machines, write it to a file and return the content.

    Args:
        path: file to write.
        machines: machines of one type; those without a calibration of their own, such as machines
            with updates only, are ignored.
        robot: robot of this type.

    Raises:
        DataError: too few machines, or a type whose dimensions have no tolerances.
        ConfigError: the file cannot be written.
    """
    machines = [machine for machine in machines if machine.calibrations]
    if len(machines) < FEWEST:
        raise DataError(
            f"{len(machines)} machines of robot {robot.name} with a fit of their own; priors need "
            f"{FEWEST} or more"
        )
    mechanism = machines[0].calibrations[0].chain.mechanism
    _require_tolerances(mechanism.parameters.items, robot)
    effects, found = population_of(machines)
    document = _document(machines, robot, mechanism, effects, found)
    write_document(path, document)
    return document


def population_of(machines: Sequence[Fitted]) -> tuple[tuple[Effect, ...], Estimated]:
    """Effects that most machines have, and the population of the dimensions and these effects.

    Raises:
        DataError: too few machines.
    """
    mechanism, effects = machines[0].calibrations[0].chain.mechanism, common_effects(machines)
    kinds = (
        *kinds_of(mechanism.parameters.names),
        *(f"{e.cause} {kind}" for e in effects for kind in kinds_of(e.parameters.names)),
    )
    looked = Looked(
        np.array([machine.diagnosed is not None for machine in machines]),
        np.stack([machine.has(effects) for machine in machines]),
    )
    return effects, estimate(together(machines, effects), kinds, looked)


def read_priors(path: Path, robot: Robot, model: str | None = None) -> Population:
    """Read the prior of the next machine of this type from a file of priors.

    Args:
        path: file to read.
        robot: robot of this type.
        model: name of the mechanism that is fitted; by default the robot file's own.

    Raises:
        ConfigError: it is not a file of priors, or is of another robot or model.
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
    rows = list(data["parameters"])
    odd = [float(data["odd_share"])] * len(rows)
    for entry in data.get("effects", []):
        rows += entry["parameters"]
        odd += [float(each["odd_share"]) for each in entry["parameters"]]
    value, nominal, tolerance, spread, told = (
        np.array([float(each[key]) for each in rows])
        for key in ("mean", "nominal", "tolerance", "spread", "machines_worth")
    )
    crowd = Population(
        (value - nominal) / tolerance,
        spread / tolerance,
        np.array(odd),
        tuple(_effect(path, entry, robot, mechanism) for entry in data.get("effects", [])),
        tuple((each["cause"], each["share"]) for each in data.get("causes", [])),
    )
    return expected(crowd, told)


def _effect(path: Path, entry: Mapping[str, Any], robot: Robot, mechanism: Mechanism) -> Effect:
    """Make an effect with the shape given in the file."""
    try:
        effect = effect_named(entry["cause"], robot, mechanism, entry["settings"])
        names = effect.parameters.names
    except InputError as error:
        raise ConfigError(f"{path}: effects: {error}") from error
    found = [each["name"] for each in entry["parameters"]]
    if found != list(names):
        raise ConfigError(
            f"{path}: effects: {entry['cause']}: parameters {', '.join(found)}; it has "
            f"{', '.join(names)}"
        )
    return effect


def _document(
    machines: Sequence[Fitted],
    robot: Robot,
    mechanism: Mechanism,
    effects: Sequence[Effect],
    found: Estimated,
) -> dict[str, Any]:
    dimensions = mechanism.parameters.items
    # an effect may exceed its typical size: the prior in a chain is wider by SPREAD
    wide = [replace(p, prior=SPREAD * p.prior) for e in effects for p in e.parameters]
    every = [*dimensions, *wide]
    entries = [_entry(p, found, k) for k, p in enumerate(every)]
    return {
        "schema": SCHEMA,
        "robot": {"name": robot.name, "sha256": robot.machine_hash},
        "model": mechanism.name,
        "machines": len(machines),
        "sessions": sum(len(each.calibrations) for each in machines),
        "odd_share": float(found.population.odd[0]),
        "parameters": entries[: len(dimensions)],
        "odd": _told_odd(machines, [p.name for p in dimensions], found),
        "causes": _causes(machines, robot, mechanism),
        "effects": _effects(effects, entries[len(dimensions) :], found),
    }


def _entry(parameter: Parameter, found: Estimated, row: int) -> dict[str, Any]:
    p, population = parameter, found.population
    return {
        "name": p.name,
        "unit": p.unit,
        "nominal": p.nominal,
        "tolerance": p.prior,
        "mean": float(p.nominal + p.prior * population.mean[row]),
        "mean_std": float(p.prior * found.mean_std[row]),
        "spread": float(p.prior * population.spread[row]),
        "machines_worth": round(float(found.told[row]), 2),
    }


def _told_odd(
    machines: Sequence[Fitted], names: Sequence[str], found: Estimated
) -> list[dict[str, Any]]:
    """List the dimensions that probably do not belong to the crowd, with their machines."""
    crowd = found.belief.crowd[:, : len(names)]
    return [
        {
            "machine": machines[i].machine,
            "parameter": names[k],
            "probability": round(float(1 - crowd[i, k]), 4),
        }
        for i, k in np.argwhere(crowd < 1 - _ODD).tolist()
    ]


def _causes(
    machines: Sequence[Fitted], robot: Robot, mechanism: Mechanism
) -> list[dict[str, Any]]:
    """Count the diagnosed machines in which each cause of the catalogue was found."""
    asked = [machine for machine in machines if machine.diagnosed is not None]
    if not asked:
        return []
    causes = dict.fromkeys(effect.cause for effect in catalogue(robot, mechanism))
    counted = Counter(cause for each in asked for cause in {e.cause for e in each.all_found})
    return [
        {
            "cause": cause,
            "found_in": counted[cause],
            "of": len(asked),
            "share": (counted[cause] + 1) / (len(asked) + 2),  # Laplace's rule
        }
        for cause in causes
    ]


def _effects(
    effects: Sequence[Effect], entries: Sequence[Mapping[str, Any]], found: Estimated
) -> list[dict[str, Any]]:
    """List the effects that most machines have, in the shape that fits the crowd's mean values."""
    every, row, odd = [], 0, found.population.odd[-len(entries) :]
    for effect in effects:
        own = slice(row, row + len(effect.parameters))
        row = own.stop
        each = [
            {**entry, "odd_share": float(share)}
            for entry, share in zip(entries[own], odd[own], strict=True)
        ]
        shape = effect.refined(np.array([entry["mean"] for entry in each]))
        settings = {k: list(v) if isinstance(v, tuple) else v for k, v in shape.settings.items()}
        every.append({"cause": effect.cause, "settings": settings, "parameters": each})
    return every


def _require_tolerances(parameters: Sequence[Parameter], robot: Robot) -> None:
    unknown = [p.name for p in parameters if not np.isfinite(p.prior)]
    if unknown:
        raise DataError(
            f"robot {robot.name}: {unknown[0]} has no tolerance in its file; priors need one of "
            "every dimension"
        )
