"""One trial: a session is made and diagnosed, and the verdict is compared with the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from blind import Trial, hide
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import Diagnosis, Finding, calibrated, diagnose
from delta_calibration.diagnosis.candidates import Candidate, columns_of, subsets
from delta_calibration.diagnosis.fitted import beside
from delta_calibration.diagnosis.joint_fit import as_score
from delta_calibration.diagnosis.model import Model, fit
from delta_calibration.diagnosis.rivals import equivalents
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.errors import InputError
from delta_calibration.robot import Robot, load_robot
from study.trials import Task

_UM = 1e6
_WEAKEST, _MOST = 0.01, 5.0  # range of strengths that a real machine can have
_METAL = 1.7  # largest strength of thermal growth: no metal exceeds 40e-6 1/K
# Hidden value -> parameter of the finding with the same meaning; the joint's number is appended.
SAME = {
    "backlash": {"gap": "gap"},
    "joint_lag": {"lag": "lag"},
    "joint_compliance": {"give": "compliance"},
    "timestamp_latency": {"latency": "latency"},
    "thermal_growth_arm": {"expansion": "expansion"},
    "thermal_growth_base": {"expansion": "expansion"},
    "joint_scale": {"scale": "scale"},
    "forearm_compliance": {"give": "rod_compliance"},
    "reducer_compliance": {"give": "compliance"},
    "thermal_growth_link": {"expansion": "expansion"},
    "slider_pitch": {"pitch": "pitch"},
    "cable_elasticity": {"give": "compliance"},
    "cable_sag": {"weight_squared": "weight_squared"},
    "pulley_radius": {"radius": "radius"},
    "drum_build_up": {"build_up": "build_up"},
    "drum_eccentricity": {"sine": "sine", "cosine": "cosine"},
    "flange_compliance": {"shift": "shift", "turn": "turn"},
    "pretension_loss": {"strain": "strain"},
    "thermal_growth_screw": {"growth": "growth"},
}


def judge(key: str) -> dict[str, Any]:
    """The outcome of a trial, ready for JSON."""
    task = Task.of_key(key)
    trial, hidden = scaled(task)
    robot = load_robot(task.robot)
    effects = tuple(e for e in catalogue(robot, robot.model()) if e.cause != task.without)
    begin, busy = time.perf_counter(), time.process_time()
    seen = survey(trial.session, robot.joints.names, robot.commanded.joint_size)
    found = diagnose(seen, robot, effects=effects, seed=task.seed)
    took, worked = time.perf_counter() - begin, time.process_time() - busy
    laws = [asdict(law) for law in found.verdict.unknown_structure.laws]
    return {
        "key": key,
        "group": task.group,
        "robot": task.robot,
        "plan": task.plan,
        "seed": task.seed,
        "hidden": hidden,
        "location": trial.hidden.location,
        "findings": [
            _said(finding) | {"twin": _twin(finding, found, task, robot)}
            for finding in found.verdict.findings
        ],
        "unknown": found.verdict.unknown_structure.found,
        "laws": laws,
        "moves_with": found.verdict.unknown_structure.moves_with,
        "cannot_tell": [list(item.between) for item in found.verdict.cannot_tell],
        "noise_um": 1e3 * (found.verdict.noise_mm or 0.0),
        "error_um": _errors(trial, seen, robot, found),
        "intervals": _intervals(trial, found),
        "seconds": took,
        "processor": worked,  # [s] of all threads
    }


def scaled(task: Task, again: int = 0) -> tuple[Trial, dict[str, float]]:
    """The session with its causes scaled to the wanted strength, and the lambda of each.

    A cause is scaled within the range that a machine can have; lambda is proportional to the
    square of its size. With `again` the same machine is measured with other noise.
    """
    plain = _hide(task, {cause: 1.0 for cause, _ in task.causes})
    own = np.array([plain.strengths[cause.name] for cause in plain.causes])
    wanted = np.array([strength for _, strength in task.causes])
    most = [_METAL if name.startswith("thermal") else _MOST for name, _ in task.causes]
    size = np.clip(np.sqrt(wanted / np.maximum(own, 1e-9)), _WEAKEST, most)
    causes = {cause: s for (cause, _), s in zip(task.causes, size, strict=True)}
    trial = _hide(task, causes, again)
    names = [cause.name for cause in plain.causes]
    return trial, dict(zip(names, (own * size**2).tolist(), strict=True))


def _hide(task: Task, causes: Mapping[str, float], again: int = 0) -> Trial:
    return hide(causes, task.seed, task.plan, task.scatter, robot=task.robot, again=again)


def _said(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "location": finding.location,
        "equivalents": list(finding.equivalents),
        "separated_by": finding.separated_by,
        "confidence": finding.confidence,
        "signal": finding.signal,
        "gain": [finding.gain_low, finding.gain, finding.gain_high],
    }


def _twin(finding: Finding, found: Diagnosis, task: Task, robot: Robot) -> bool:
    """Whether the session cannot distinguish a finding from the cause that was removed."""
    named = (m for m in found.model.terms if m.cause == finding.cause)
    term = next((m for m in named if m.location == finding.location), None)
    if not task.without or term is None:
        return False
    rest = tuple(m for m in found.model.terms if m is not term)
    evidence = beside(found.model.evidence, rest)
    signal = columns_of(term, evidence) @ found.model.scaled(term)
    every = catalogue(robot, found.model.problem.chain.mechanism)
    effect = next(e for e in every if e.cause == task.without)
    shapes = (s for s in effect.shapes(evidence.at) if not s.missing(evidence.at))
    taken_out = [as_score(c, ()) for shape in shapes for c in subsets(shape) if c.sought]
    return bool(equivalents(evidence, signal, taken_out, max(1.0, found.model.misfit)))


def _errors(trial: Trial, seen: Survey, robot: Robot, found: Diagnosis) -> dict[str, float]:
    """Errors of the models' predictions where nothing was measured [um].

    Evaluated at rest or in motion, wherever the causes have the larger effect.
    """
    if not trial.causes:
        return {}
    held = survey(trial.truth.session, robot.joints.names, robot.commanded.joint_size)
    start = calibrated(seen, robot)
    moving = trial.signals.moving > trial.signals.still
    models = {"calibrated": start, "extended": found.model}
    true = true_terms(trial, start, robot)
    if true is not None:
        models["oracle"] = fit(start, true)
    return {name: _error(model, held, moving) for name, model in models.items()}


def _error(model: Model, held: Survey, moving: bool) -> float:
    part = held.paths if moving else held.poses
    point = part.conditions.reading if moving else held.poses.point
    predicted = model.extended.chain.predict(part.conditions, model.theta)
    return _UM * float(np.sqrt(np.mean(np.sum((predicted - point) ** 2, axis=1))))


def true_terms(trial: Trial, start: Model, robot: Robot) -> tuple[Candidate, ...] | None:
    """Hidden causes in their true shape as terms of a model; None if one is not available."""
    terms = []
    for cause in trial.causes:
        try:
            mechanism = start.problem.chain.mechanism
            effect = effect_named(cause.name, robot, mechanism, _shape(trial, cause.name))
        except InputError:
            return None
        every = enumerate(effect.parameters)
        rows = tuple(i for i, p in every if cause.location in (None, p.location))
        terms.append(Candidate(cause.name, effect.kind, cause.location, effect, rows))
    return tuple(terms)


def _shape(trial: Trial, cause: str) -> dict[str, float | str]:
    """True values of the fields that a detector has to search for."""
    values = trial.hidden.values[cause]
    if cause == "transmission_error":
        return {"cycles": float(values["cycles"])}
    if cause == "pretension_loss":
        return {"time_constant": float(values["constant"])}
    if cause == "flange_compliance":
        return {"behind": float(values["behind"])}
    if cause == "tracker_drift":
        return {"time_constant": float(values["constant"])} if values["constant"] < np.inf else {}
    if cause == "joint_zero_drift" and values["kind"] == "step":
        return {"step_at": float(values["share"]) * trial.cell.length}
    if cause == "thermal_growth_screw":
        return {"time_constant": float(values["constant"]), "bearing": float(values["fixed"])}
    part = cause.removeprefix("thermal_growth_")
    if part == cause:
        return {}
    if any(stream.part == part for stream in trial.session.temperature):
        return {"sensor": part}
    return {"time_constant": trial.cell.warming.constant[part]}


def _intervals(trial: Trial, found: Diagnosis) -> list[dict[str, Any]]:
    """Stated values with the true ones, of causes that are described alike on both sides."""
    said = {finding.cause: finding for finding in found.verdict.findings}
    rows = []
    for cause in trial.causes:
        if cause.name not in said or cause.name not in SAME:
            continue
        if {other.name for other in trial.causes} & _untold(said[cause.name], found):
            continue  # the session cannot distinguish the two, and the verdict says so
        for ours, theirs in SAME[cause.name].items():
            for name, estimate in said[cause.name].parameters.items():
                if name != theirs and name.rsplit("_", 1)[0] != theirs:
                    continue
                true = true_value(trial, cause.name, ours, name.removeprefix(theirs))
                rows.append(
                    {
                        "of": f"{cause.name}.{name}",
                        "true": true,
                        "value": estimate.value,
                        "std": estimate.std,
                    }
                )
    return [row for row in rows if row["true"] is not None]


def _untold(finding: Finding, found: Diagnosis) -> set[str]:
    """Causes that are listed as indistinguishable from a finding, or partly contained in it."""
    classes = (set(item.between) for item in found.verdict.cannot_tell)
    told = [some for some in classes if finding.cause in some]
    return set(finding.equivalents).union(*told) - {finding.cause}


def true_value(trial: Trial, cause: str, name: str, leg: str) -> float | None:
    """A hidden value; None if a leg has none."""
    values = trial.hidden.values[cause]
    return float(values[name + leg]) if name + leg in values else None
