"""Sentences on the console do not contradict each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.bench.shown import shown
from delta_calibration.cli.diagnose import describe as describe_verdict
from delta_calibration.cli.fit import describe, describe_poses
from delta_calibration.data import JointStream, Session, TrackerStream
from delta_calibration.data.readings import Rejected, match
from delta_calibration.diagnosis.candidates import Candidate, dimensions, subsets
from delta_calibration.diagnosis.experiments import ALREADY, further_experiment, next_experiment
from delta_calibration.diagnosis.findings import separated_by
from delta_calibration.diagnosis.verdict import CannotTell
from delta_calibration.effects import effect_named
from delta_calibration.estimation import Identification
from report_bench import ROBOT, found

NAMES = ("a", "b", "c")
SECOND_NS = 1_000_000_000


def one_joint(cause: str) -> Candidate:
    evidence = found().model.evidence
    shape = next(
        iter(effect_named(cause, ROBOT, evidence.chain.mechanism, {}).shapes(evidence.at))
    )
    return next(each for each in subsets(shape) if each.location == "joint_1")


def test_measurements_that_separate_two_causes_already_are_no_experiment() -> None:
    """A zero offset is a part of any curve over the joint: more poses do not part the two."""
    evidence, gap = found().model.evidence, one_joint("backlash")
    zero = next(
        each
        for each in dimensions(evidence)
        if (each.cause, each.location) == ("joint_zero_offset", "joint_1")
    )
    assert next_experiment(evidence, gap, zero) == ALREADY
    assert further_experiment(evidence, gap, zero) == ""
    assert separated_by(evidence, zero, (gap,)) is None


def test_an_experiment_that_is_not_known_is_not_told() -> None:
    verdict = found().verdict
    finding = replace(verdict.findings[0], equivalents=("joint_error_curve",), separated_by=None)
    same = CannotTell(("backlash", "joint_error_curve"), "they are alike", "")
    told = replace(verdict, findings=(finding,), cannot_tell=(same,))
    for text in (describe_verdict(told), f"{shown(told, ROBOT)}"):
        assert "to separate them" not in text
        assert "None" not in text
        assert "they are alike;" not in text.lower()
        assert "they are alike" in text.lower()
    known = replace(told, findings=(replace(finding, separated_by="repeat it"),))
    assert "joint_error_curve; to separate them: repeat it" in describe_verdict(known)


def weighing(down: int, gone: int) -> Identification:
    fit = found().identification
    weight = np.ones_like(fit.weight)
    weight[:down] = 0.5
    weight[:gone] = 0.0
    return replace(fit, weight=weight)


def test_what_was_set_aside_and_what_has_no_weight_are_told_apart() -> None:
    poses = replace(found().model.survey.poses, rejected=Rejected())
    assert "set aside: none" in describe_poses(poses)
    assert "set aside: none; without weight in the robust fit: 1 pose\n" in (
        f"{describe_poses(poses, 1)}\n"
    )
    said = describe(weighing(3, 1), False)
    assert "3 poses given less weight by the robust fit, 1 of them none\n" in said
    assert "left out" not in said
    assert "1 pose given less weight by the robust fit\n" in describe(weighing(1, 0), False)
    assert "less weight" not in describe(weighing(0, 0), False)


@pytest.mark.parametrize("stated", [False, True], ids=["unknown", "stated"])
def test_no_reversal_is_missed_where_the_directions_are_stated(stated: bool) -> None:
    """A table that states them has a command short of each stop, as `import` records it."""
    stamps = SECOND_NS * np.arange(1, 21) * 5
    q = np.linspace(-0.3, 0.3, 20)[:, None] * [1.0, -1.0, 0.5]
    command = JointStream(stamps, NAMES, q)
    if stated:
        at = np.concatenate([stamps - 5 * SECOND_NS // 2, stamps])
        order = np.argsort(at)
        command = JointStream(at[order], NAMES, np.concatenate([q - 0.01, q])[order])
    point = np.column_stack([q[:, 0], q[:, 0] ** 2, np.ones(20)])
    notes = match(Session("table", command, None, TrackerStream(stamps, point)), NAMES).notes
    assert any("a reversal of a joint" in note for note in notes) is not stated
