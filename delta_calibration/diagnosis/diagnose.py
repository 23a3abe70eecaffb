"""From a session to a verdict.

Fit the geometry, search for causes, confirm them on held-out data, test what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.data import Survey, require_poses
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.constants import SCATTERS
from delta_calibration.diagnosis.cross_validation import HeldOut, held_out
from delta_calibration.diagnosis.extension import extended
from delta_calibration.diagnosis.findings import HeldOutModels
from delta_calibration.diagnosis.geometry import as_known
from delta_calibration.diagnosis.judge import STEPS, Judgement, judged
from delta_calibration.diagnosis.law_search import Likely
from delta_calibration.diagnosis.linear_model import Cell, LinearizedModel
from delta_calibration.diagnosis.model import Model, solved
from delta_calibration.diagnosis.observed import Observed
from delta_calibration.diagnosis.residual_tests import ResidualTests
from delta_calibration.diagnosis.search import SearchResult
from delta_calibration.diagnosis.verdict import Verdict
from delta_calibration.effects import Effect, catalogue
from delta_calibration.estimation import (
    Identification,
    Measured,
    Near,
    Population,
    carried_by,
    chain_of,
    doubts,
    interval_of,
    never_turned,
    prepare,
    require_this_robot,
    solve,
    with_turns,
)
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import Robot
from delta_calibration.threads import one_thread
from delta_calibration.wording import listed, spoken

FEWEST = 12  # different places that a session must have
_REFUSED = (
    "{} is not in the extended calibration, because held-out poses are predicted worse with it"
)
_SCATTERED = (
    "visits of one place scatter {:.0f} times as much as the robot file states ({} of the {}): "
    "what changes from visit to visit counts as noise here, and smaller errors do not show; "
    "compare such visits over time, load and side of approach, or correct the file"
)
_RAISED = (
    "residuals are {:.2g} times as large as the noise in the robot file allows, but follow "
    "nothing; too few places were visited again to measure the noise, so that they count as noise "
    "here, and smaller errors do not show; visit some places again, or correct the file"
)
_NEVER_TURNED = "the probe's rotation never changes, so it is filled in: only positions are used"


@dataclass(frozen=True)
class Diagnosis:
    """The verdict, and the extended model with its calibration."""

    verdict: Verdict
    model: Model
    found: SearchResult
    audit: ResidualTests
    held: HeldOutModels  # the held-out errors of the verdict, pose by pose
    before: HeldOut  # held-out errors of the baseline
    after: HeldOut  # held-out errors of the extended model
    refused: tuple[Candidate, ...]  # found, but it makes predictions worse: not shipped
    laws: tuple[Likely, ...]  # of the unknown structure, likeliest first
    identification: Identification  # the extended model in the form of a fit

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings to heed before using the result, one sentence each; empty if there are none."""
        poses, robot = self.model.survey.poses, self.model.cell.robot
        unturned = never_turned(poses, robot, self.model.bare)
        refused = listed(spoken(term.label) for term in self.refused)
        return tuple(
            filter(
                None,
                (
                    *doubts(self.identification),
                    _REFUSED.format(refused) if refused else "",
                    unturned * _NEVER_TURNED,
                    _scattered(self.model.cell),
                ),
            )
        )


def _scattered(cell: Cell) -> str:
    """How much the noise exceeds that of the robot file, in words; empty if repeats show little.

    The scatter of tracker or joints may be wrong in the file. Or errors that neither time nor load
    nor side of approach tell apart are taken for noise. Joints are spoken of if their scatter is
    so large even at the lower end of its interval.
    """
    noise, robot = cell.noise, cell.robot
    if not noise.measured:
        return _RAISED.format(noise.raised) if noise.raised > 1.0 else ""
    filed, share = robot.joints.repeatability, interval_of(noise.freedom)[0]
    joints = share * noise.repeatability / filed if filed > 0 else 0.0  # 0: nothing was stated
    tracker = max(noise.radial_scale, noise.transverse_scale)
    if noise.in_proportion:
        ratio, entry, part = share * tracker, "noise", "tracker and the joints"
    elif joints > tracker:
        ratio, entry, part = joints, "repeatability", "joints"
    else:
        ratio, entry, part = tracker, "noise", "tracker"
    return _SCATTERED.format(ratio, entry, part) if ratio > SCATTERS else ""


def diagnose(
    survey: Survey,
    robot: Robot,
    model: str | None = None,
    effects: tuple[Effect, ...] | None = None,
    seed: int = 0,
    calibration: Calibration | None = None,
    step: Callable[[str], None] = lambda name: None,
    population: Population | None = None,
) -> Diagnosis:
    """Find the causes of a robot's pose errors in a measured session.

    Args:
        survey: poses and paths of a session.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.
        effects: candidate effects, at least one; the whole catalogue if not given.
        seed: seed of the random numbers.
        calibration: active calibration of the robot; it is the baseline instead of the drawing.
        step: progress callback, called with each of `STEPS` as it begins.
        population: statistics of the machines of this type: its dimensions replace the tolerances,
            and causes that are frequent in it are found more easily than others.

    Raises:
        DataError: too few different poses, or of another robot.
    """
    rng = np.random.default_rng(seed)
    step(STEPS[0])
    against = None
    if calibration is not None:
        model = calibration.chain.mechanism.name
    with one_thread():  # the search has threads of its own (`search.py`)
        start = calibrated(survey, robot, model, population=population)
        if calibration is not None:
            name = f"calibration of {Path(calibration.source).name} + frame"
            against = name, partial(_in_force, calibration, start)
        if effects is None:
            effects = catalogue(robot, start.problem.chain.mechanism)
        found = judged(start, effects, rng, against, step)
        assert isinstance(found.model, Model)  # as the search began
        whole = extended(found.model, seed)
    return Diagnosis(
        verdict=found.verdict,
        model=found.model,
        found=found.found,
        audit=found.audit,
        held=found.held,
        before=found.before,
        after=found.after,
        refused=found.refused,
        laws=found.laws,
        identification=whole,
    )


def diagnose_observations(
    measured: Sequence[Measured],
    mechanism: Mechanism,
    robot: Robot,
    frame: Frame | None = None,
    stated: bool = True,
    further: Sequence[tuple[str, Sequence[Measured]]] = (),
    effects: Sequence[Effect] | None = None,
    seed: int = 0,
    step: Callable[[str], None] = lambda name: None,
) -> Judgement:
    """Find the causes that a geometric model lacks, from observations of any kinds.

    The steps are those of a session: same candidates, penalties and confirmation on held-out data.

    Args:
        measured: observations and the conditions under which each was taken.
        mechanism: drawing and priors.
        robot: machine data that the effects read.
        frame: start value of `T_device_base`, if a device measures.
        stated: whether the stated noise of the observations is right; else a factor is estimated.
        further: measurements that could be added, in words, with made-up values; the verdict
            proposes the first of them that separates the causes.
        effects: candidate effects, at least one; if not given, the whole catalogue, but those that
            act on a tracker's readings only if all observations are such readings.
        seed: seed of the random numbers.
        step: progress callback, called with each of `STEPS` as it begins.

    Raises:
        InputError: no observation, or of a kind that has several sets of joints.
        DataError: samples out of reach, or a fit that does not converge.
    """
    step(STEPS[0])
    with one_thread():  # the search has threads of its own (`search.py`)
        start = Observed.of(mechanism, measured, frame, stated, further)
        if effects is None:
            every = catalogue(robot, mechanism)
            effects = [e for e in every if start.reads or not e.on_readings]
        return judged(start, effects, np.random.default_rng(seed), step=step)


@one_thread()
def calibrated(
    survey: Survey,
    robot: Robot,
    model: str | None = None,
    fewest: int = FEWEST,
    population: Population | None = None,
) -> Model:
    """The machine with its geometry identified and no effects in the chain.

    Args:
        survey: poses and paths of a session.
        robot: drawing, tolerances, tracker.
        model: name of a mechanism; the robot file's own where not given.
        fewest: least number of different places in the session.
        population: statistics of the machines of this type, instead of the tolerances.

    Raises:
        DataError: too few different poses, or of another robot.
    """
    require_poses(survey.poses, fewest)
    chain = chain_of(robot, model)
    _, noise, problem = prepare(survey.poses, robot, chain)
    problem = with_turns(problem, survey.poses, robot, noise)
    require_this_robot(problem, survey.poses, robot)
    cell, near = Cell(robot, noise, np.ones(len(survey.poses)), population), None
    if population is not None:
        population = population.shown_by(survey.poses.conditions)
        whole = prepare(survey.poses, robot, chain.with_effects(population.effects))[2]
        plain = solve(with_turns(whole, survey.poses, robot, noise))
        problem = carried_by(plain, population).bare.applied(problem)
        near = Near(problem.unknowns(plain.theta[problem.layout.base]))
    return solved(survey, cell, problem, near)


def _in_force(calibration: Calibration, start: Model, held: HeldOutModels) -> HeldOut:
    """Held-out errors of the active calibration in its best-fit frame."""
    placed = start.registered(calibration.geometry)
    fits, shown = (
        _less_effects(as_known(of), calibration) for of in (placed, placed.everything())
    )
    return held_out(fits, held.sectors, shown)


def _less_effects(evidence: LinearizedModel, calibration: Calibration) -> LinearizedModel:
    """The evidence with the effects of a calibration subtracted from its residuals."""
    known = np.zeros(evidence.size)
    values = calibration.chain.effect_values(calibration.theta)
    for effect, value in zip(calibration.chain.effects, values, strict=True):
        known = known + evidence.columns(effect) @ (value / effect.parameters.prior)
    left = evidence.residual - known.reshape(evidence.residual.shape)
    return replace(evidence, residual=left)
