"""From a session to a verdict, in eight steps.

1 clean, 2 baseline, 3 candidates, 4 classes, 5 several effects, 6 confirmation on held-out data,
7 audit of what is left, 8 what cannot be told and what to measure next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.diagnosis.audit import MOTION, Audit, audit
from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.confirm import HeldOut, held_out
from delta_calibration.diagnosis.evidence import Cell
from delta_calibration.diagnosis.extension import extended
from delta_calibration.diagnosis.findings import (
    MM,
    HeldOutModels,
    of_dimension,
    of_geometry,
    of_member,
    of_reflector,
)
from delta_calibration.diagnosis.geometry import scatter_of, without_geometry
from delta_calibration.diagnosis.model import Model, fit, rested
from delta_calibration.diagnosis.rivals import scaled
from delta_calibration.diagnosis.search import ALPHA, Found, find
from delta_calibration.diagnosis.trust import signal_of, untrusted
from delta_calibration.diagnosis.unseen import unseen
from delta_calibration.diagnosis.verdict import (
    Finding,
    Held,
    SessionFacts,
    UnknownStructure,
    Verdict,
)
from delta_calibration.effects import Effect, catalogue
from delta_calibration.effects.unexplained import Unexplained
from delta_calibration.identification import Identification, chain_of, prepare, solve
from delta_calibration.robot import Robot
from delta_calibration.samples import Survey, require_poses

Array = NDArray[np.float64]

_FEWEST = 12  # different places
# what is left must exceed these shares, of the noise and of what the members explain, to matter
_MATERIAL, _SLIGHT = 0.3, 0.2
STEPS = ("geometry", "causes", "held-out data", "what is left")


@dataclass(frozen=True)
class Diagnosis:
    """The verdict, and the model that it extends the calibration to."""

    verdict: Verdict
    model: Model
    found: Found
    audit: Audit
    held: HeldOutModels  # the errors that the verdict tells, pose by pose
    before: HeldOut  # those of the baseline
    identification: Identification  # the same model as a fit has it, effects in its chain


def diagnose(
    survey: Survey,
    robot: Robot,
    model: str | None = None,
    effects: tuple[Effect, ...] | None = None,
    seed: int = 0,
    calibration: Calibration | None = None,
    step: Callable[[str], None] = lambda name: None,
) -> Diagnosis:
    """Say why the robot does not stand where its model says.

    Args:
        survey: poses and paths of a session.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.
        effects: what is tried; the whole catalogue where not given.
        seed: of bootstraps.
        calibration: what the robot is compensated by; held against the session as the baseline in
            the place of the drawing.
        step: is told of each of `STEPS` as it begins.

    Raises:
        DataError: too few different poses, or of another robot.
    """
    rng = np.random.default_rng(seed)
    step(STEPS[0])
    if calibration is not None:
        model = calibration.chain.mechanism.name
    start = calibrated(survey, robot, model)
    if effects is None:
        effects = catalogue(robot, start.problem.chain.mechanism)
    step(STEPS[1])
    sought = find(start, effects, rng)
    step(STEPS[2])
    found, held, said = _borne_out(sought, start, rng)
    members = found.model.members
    findings = [f for m, f in said.items() if not m.unexplained]
    step(STEPS[3])
    left = audit(found.model.beside, start.cell.noise_degrees, rng)
    before, after = (held.members(of, held.sectors).rms(held.poses) for of in ((), members))
    explained = float(np.sqrt(max(0.0, before**2 - after**2)))
    unknown = _unknown(found.model, sought.model, left, explained)
    findings += _of_what_is_fitted(found, held, unknown.found, rng)
    findings.sort(key=lambda finding: -finding.signal)
    baseline = _baseline(held, calibration)
    verdict = Verdict(
        session=_facts(survey),
        noise_mm=MM * start.cell.noise.floor,
        baseline=Held(_baseline_name(calibration), held.mm(baseline)),
        calibrated=Held("geometry + frame", held.mm(held.members((), held.sectors))),
        extended=Held(_name(members), held.mm(held.members(members, held.sectors))),
        findings=tuple(findings),
        unknown_structure=unknown,
        cannot_tell=unseen(found.model.beside, effects, findings),
    )
    whole = extended(found.model, held, seed)
    return Diagnosis(verdict, found.model, found, left, held, baseline, whole)


def _borne_out(
    found: Found, start: Model, rng: np.random.Generator
) -> tuple[Found, HeldOutModels, dict[Candidate, Finding]]:
    """Only the members whose names can be trusted and that hold on data not seen, one by one."""
    while True:
        weak = untrusted(found.model)
        if not weak:
            found = replace(found, model=rested(found.model))
            held = HeldOutModels(found.model.evidence)
            said = {m: of_member(found, m, held, rng) for m in found.model.members}
            good = {m: finding for m, finding in said.items() if finding is not None}
            weak = tuple(m for m in said if m not in good)
            if not weak:
                return found, held, good
        weakest = min(weak, key=lambda m: signal_of(found.model, m))
        kept = tuple(m for m in found.model.members if m is not weakest)
        found = replace(found, model=fit(found.model, kept) if kept else start)


def _of_what_is_fitted(
    found: Found, held: HeldOutModels, unknown: bool, rng: np.random.Generator
) -> list[Finding]:
    """Findings among what every calibration fits: one dimension or all, and the reflector.

    What nothing explains bends all that is fitted: beside it, scatter is no finding.
    """
    scatter = scatter_of(found.model.beside)
    one = None
    if scatter.outlier is not None:
        one = of_dimension(found, scatter.tau, scatter.outlier, held, rng)
    if unknown:
        return [] if one is None else [one]
    every = of_geometry(found, scatter, held, rng) if one is None else None
    return [f for f in (one, every, of_reflector(found, held, rng)) if f is not None]


def calibrated(survey: Survey, robot: Robot, model: str | None = None) -> Model:
    """The machine with its geometry identified and nothing else in the chain.

    Raises:
        DataError: too few different poses, or of another robot.
    """
    require_poses(survey.poses, _FEWEST)
    _, noise, problem = prepare(survey.poses, robot, chain_of(robot, model))
    solution = solve(problem)
    return Model(survey, problem, Cell(robot, noise, solution.weight), solution.theta)


def _baseline(held: HeldOutModels, calibration: Calibration | None) -> HeldOut:
    """The drawing, or the calibration in force, in the best frame."""
    if calibration is None:
        return held.frame
    evidence, items = held.evidence, calibration.chain.mechanism.parameters
    known = evidence.geometry @ ((calibration.geometry - items.nominal) / items.prior)
    values = calibration.chain.effect_values(calibration.theta)
    for effect, value in zip(calibration.chain.effects, values, strict=True):
        known = known + evidence.columns(effect) @ (value / effect.parameters.prior)
    fixed = replace(evidence, residual=evidence.residual - known.reshape(-1, 3))
    return held_out(without_geometry(fixed), held.sectors)


def _baseline_name(calibration: Calibration | None) -> str:
    if calibration is None:
        return "nominal + frame"
    return f"calibration of {Path(calibration.source).name} + frame"


def _facts(survey: Survey) -> SessionFacts:
    poses = survey.poses
    return SessionFacts(poses.readings, len(poses), poses.duration, poses.rejected.counts())


def _name(members: tuple[Candidate, ...]) -> str:
    return " + ".join(["geometry", "frame", *(m.label for m in members)])


def _unknown(model: Model, sought: Model, left: Audit, explained: float) -> UnknownStructure:
    """Structure that a smooth map follows, or that the audit finds in what is left.

    A map that chance is no reason for is structure, even where it foretells too little to be of
    use and was left out of the model again.

    Args:
        model: with what is borne out.
        sought: where the search ended.
        left: the audit of what the model leaves.
        explained: root mean square of what its members explain [m].
    """
    tests: dict[str, float | None] = dict(left.p)
    for with_map in (model, sought):
        for member in with_map.members:
            if member.unexplained:
                return _mapped(with_map, member, tests)
    least = max(_MATERIAL * model.cell.noise.floor, _SLIGHT * explained)
    size = {name: left.in_motion if name == MOTION else left.excess for name in left.p}
    shown = [n for n, p in left.p.items() if size[n] >= least and p * len(left.p) <= ALPHA]
    if not shown:
        return UnknownStructure(False, None, None, None, tests)
    worst = min(shown, key=lambda name: left.p[name])
    moves = worst.removeprefix("moran_") if worst != "lack_of_fit" else None
    where = None if worst == MOTION else _around(left.worst)
    return UnknownStructure(True, where, moves, MM * size[worst], tests)


def _mapped(
    model: Model, member: Candidate, tests: dict[str, float | None]
) -> UnknownStructure:
    """What the map says: how large it is, and where it is largest."""
    evidence = model.evidence
    moved = (columns_of(member, evidence) @ scaled(model, member)).reshape(len(evidence), 3)
    rows = np.flatnonzero(evidence.believed[: evidence.poses])
    shift = np.linalg.solve(evidence.whiten[rows], moved[rows, :, None])[..., 0]
    shift -= shift.mean(axis=0)
    size = np.linalg.norm(shift, axis=1)
    place = evidence.chain.mechanism.position(evidence.pose[rows])
    family = member.effect.family if isinstance(member.effect, Unexplained) else None
    where = _around(place[int(np.argmax(size))])
    return UnknownStructure(True, where, family, MM * float(np.sqrt(np.mean(size**2))), tests)


def _around(place: Array) -> str:
    x, y, z = (MM * place).tolist()
    return f"most around x = {x:.0f}, y = {y:.0f}, z = {z:.0f} mm"
